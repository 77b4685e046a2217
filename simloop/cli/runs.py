"""Do the runs that a journal lacks, with a progress bar and a clean stop at Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from simloop.campaign import execute
from simloop.campaign.journal import Journal
from simloop.campaign.spec import RunSpec
from simloop.campaign.work import Row, do_run
from simloop.cli.stopping import stopping
from simloop.common.pool import Workers, local_workers

_NOTE = "stopping: the runs under way are finished and kept; once more to end them at once"


@dataclass(frozen=True, slots=True)
class How:
    """How runs are done.

    Attributes:
        workers: Number of local processes.
        dask: Address of a Dask scheduler whose workers are used instead; None: local processes.
        redo: Whether runs that ended with the outcome ``error`` are done again.
        repair: Whether damaged files of the folder are repaired.
    """

    workers: int
    dask: str | None = None
    redo: bool = False
    repair: bool = False


def take_up(journal: Journal, specs: Sequence[RunSpec], how: How) -> None:
    """Tell what the journal has dropped, and forget the errors if they are done again.

    Args:
        journal: The open journal.
        specs: All runs.
        how: How they are done.
    """
    for note in journal.notes:
        print(note)
    if how.redo:
        print(f"{journal.forget_errors(specs)} runs with the outcome error are done again")


def do_missing(
    journal: Journal,
    specs: Sequence[RunSpec],
    how: How,
    work: Callable[[RunSpec], Row] = do_run,
) -> bool:
    """Do the runs that a journal lacks, and add each to the journal as soon as it is finished.

    Args:
        journal: The open journal.
        specs: All runs.
        how: How they are done.
        work: Function that makes the row of a run.

    Returns:
        Whether the runs were stopped by Ctrl-C or SIGTERM before the end.

    Raises:
        InputError: If the Dask cluster cannot be used.
    """
    missing = journal.missing(specs)
    if not missing:
        return False
    bar = _bar(len(specs), len(missing))
    with (
        workers_at(how.workers, how.dask) as where,
        bar as show,
        stopping(_NOTE) as stop,
        closing(execute.run_all(missing, where, stop, work)) as finished,
    ):
        for spec, row in finished:
            journal.add(spec, row)
            show(row)
    return bool(journal.missing(specs))


@contextmanager
def workers_at(count: int, dask: str | None) -> Iterator[Workers]:
    """Prepare local processes, or connect to the workers of a Dask cluster.

    Args:
        count: Number of local processes.
        dask: Address of a Dask scheduler, or None for local processes.

    Yields:
        The workers.

    Raises:
        InputError: If the Dask cluster cannot be used.
    """
    if dask is not None:
        with execute.dask_cluster(dask) as cluster:
            yield cluster
    else:
        yield local_workers(count)


@contextmanager
def _bar(total: int, missing: int) -> Iterator[Callable[[Row], None]]:
    """Show the number of finished runs, the number of failed runs, and the time left."""
    console, failed = Console(stderr=True), 0
    columns = (
        TextColumn("runs"),
        BarColumn(bar_width=32),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=total, completed=total - missing, failed=0)

        def show(row: Row) -> None:
            nonlocal failed
            failed += not row["success"]
            bar.update(task, advance=1, failed=failed)

        yield show
