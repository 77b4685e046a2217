"""Runs through the standard Executor: processes here by default, a cluster by the same code."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from multiprocessing import get_context

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import Row, do_run, leave_interrupts_to_the_parent, row_of
from simloop.common.errors import InputError

_AHEAD = 2  # runs handed out for each worker: none waits, and few are lost with a pool
_LOOK_S = 0.2
_MOST_CRASHES = 2

Make = Callable[[], Executor]


def local(workers: int) -> Make:
    """Processes of this machine, each begun afresh."""
    return lambda: ProcessPoolExecutor(
        workers, get_context("spawn"), leave_interrupts_to_the_parent
    )


@contextmanager
def dask(address: str) -> Iterator[tuple[Make, int]]:
    """A Dask cluster: how to make its executor, and how many workers' threads it has."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask needs Dask: pip install 'simloop[dask]'") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--dask {address}: {str(error).splitlines()[0]}") from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError(f"--dask {address}: the cluster has no workers")
        yield client.get_executor, threads


def run_all(
    specs: Sequence[RunSpec],
    make: Make,
    workers: int,
    stop: Callable[[], bool] = lambda: False,
    work: Callable[[RunSpec], Row] = do_run,
) -> Iterator[tuple[RunSpec, Row]]:
    """Each run with its row, as they are finished. stop: asked now and then; ends it early.

    A pool whose worker died is made anew. The runs that were in it are suspects: they are tried
    one at a time, and one that kills its worker again is told as an error.
    """
    waiting, suspects = deque(specs), deque[RunSpec]()
    crashes: dict[RunSpec, int] = {}
    under_way: dict[Future[Row], RunSpec] = {}
    pool = make()
    try:
        while (waiting or suspects or under_way) and not stop():
            queue, most = (suspects, 1) if suspects else (waiting, _AHEAD * workers)
            while queue and len(under_way) < most:
                spec = queue.popleft()
                under_way[pool.submit(work, spec)] = spec
            done, _ = wait(under_way, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            broken: list[RunSpec] = []
            for future in done:
                spec = under_way.pop(future)
                try:
                    yield spec, future.result()
                except BrokenExecutor:
                    broken.append(spec)
            if broken:
                broken += under_way.values()
                under_way.clear()
                for spec in broken:
                    crashes[spec] = crashes.get(spec, 0) + (1 if len(broken) > 1 else _MOST_CRASHES)
                    if crashes[spec] >= _MOST_CRASHES and len(broken) == 1:
                        yield spec, row_of(spec, "error", error="its worker process died")
                    else:
                        suspects.append(spec)
                pool.shutdown(wait=False)
                pool = make()
        for future in under_way:
            future.cancel()
        for future, spec in under_way.items():  # stopped: what has begun is finished
            if not future.cancelled():
                with suppress(BrokenExecutor):
                    yield spec, future.result()
    finally:
        for future in under_way:
            future.cancel()
        pool.shutdown(wait=True)
