"""Do the work of ``simloop bench papers``: the drives, then the papers' tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from simloop.benchmarks.papers import tables
from simloop.benchmarks.papers.drive import drive
from simloop.benchmarks.papers.entries import Drives
from simloop.campaign.journal import Journal
from simloop.campaign.work import Row
from simloop.cli.runs import How, do_missing, take_up, workers_at
from simloop.cli.stopping import stopping
from simloop.common.terminal import counting


def do_papers(
    request: Drives, out: Path, how: How, with_tables: bool
) -> tuple[Mapping[str, Row], dict[str, Any] | None]:
    """Do what is not finished in a folder yet.

    Args:
        request: The drives.
        out: The folder of journal and tables.
        how: How the drives are done.
        with_tables: Whether the papers' tables are measured.

    Returns:
        The row of each finished run by ``RunSpec.key``, and the tables by name. The tables are
        None if the work was stopped before their end.

    Raises:
        InputError: If the folder cannot be used, or holds other runs.
    """
    with Journal(out, request, repair=how.repair) as journal:
        specs = request.runs()
        take_up(journal, specs, how)
        stopped = do_missing(journal, specs, how, drive)
        if stopped:
            return dict(journal.rows), None
        if not with_tables:
            return dict(journal.rows), {}
        done = len(tables.read(out))
        with (
            workers_at(how.workers, how.dask) as where,
            stopping(
                "stopping: the tables under way are finished; once more to end at once"
            ) as stop,
            counting(Console(stderr=True), "tables", len(tables.PARTS)) as show,
        ):
            show(done)
            for _ in tables.measure_missing(out, where, stop):
                done += 1
                show(done)
        found = tables.read(out)
        return dict(journal.rows), found if len(found) == len(tables.PARTS) else None
