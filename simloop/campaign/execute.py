"""Run the runs of a campaign, on processes of this machine or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import ERROR, Row, do_run, row_of
from simloop.common import pool
from simloop.common.errors import InputError
from simloop.common.pool import Workers


@contextmanager
def dask_cluster(address: str) -> Iterator[Workers]:
    """Connect to a Dask cluster for the duration of the context.

    Args:
        address: The address of the Dask scheduler, e.g. ``tcp://10.0.0.1:8786``.

    Yields:
        The cluster's workers. Each of their threads does one run at a time.

    Raises:
        InputError: If Dask is not installed, the scheduler does not answer, or the cluster has no
            workers.
    """
    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError(
            "--dask: Dask is not installed; install it with: pip install 'simloop[dask]'"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--dask {address}: {str(error).splitlines()[0]}") from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError(f"--dask {address}: the cluster has no workers")
        yield Workers(
            # Not pure: a repeated run must be a new task, not the failed one.
            lambda: client.get_executor(pure=False),
            threads,
            (BrokenExecutor, KilledWorker),
        )


def run_all(
    specs: Sequence[RunSpec],
    workers: Workers,
    stop: Callable[[], bool] = lambda: False,
    work: Callable[[RunSpec], Row] = do_run,
) -> Generator[tuple[RunSpec, Row], None, None]:
    """Do the runs and yield each row as soon as its run is finished.

    A run whose worker process dies is tried once more, alone. If the worker dies again, the run
    gets a row with the outcome ``error``.

    Args:
        specs: The runs.
        workers: The workers that do the runs.
        stop: Called several times a second. Once it returns True, no further run starts; the runs
            that have started are finished.
        work: Function that makes the row of a run.

    Returns:
        A generator of pairs of a run and its row, in the order in which they are finished. Closing
        it early ends the workers.
    """
    return pool.run_all(
        specs,
        work,
        workers,
        when_lost=lambda spec: row_of(spec, ERROR, error="its worker process died twice"),
        stop=stop,
    )
