"""``simloop bench logs``: map the recorded logs of a folder, and measure each trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from simloop.cli.common import (
    INTERRUPTED,
    JsonFile,
    NumberOfWorkers,
    compiling_shown,
    write_json,
)
from simloop.cli.stopping import leaves_at_once, stopping

if TYPE_CHECKING:
    from simloop.benchmarks.logs.bench import Task

_NOTE = "stopping: the logs that are mapped are kept; once more to end at once"


Folder = Annotated[Path, typer.Argument(metavar="DIR", help="A folder of recorded logs.")]
Report = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write an HTML page for each log into this directory."),
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Logs, by name or its beginning; repeatable or with commas. Default: all.",
    ),
]
Thin = Annotated[
    list[str] | None,
    typer.Option(
        metavar="M",
        help="Map each log also with a scan each M metres or 30 degrees; repeatable or with "
        "commas.",
    ),
]


@leaves_at_once
def bench_logs(
    folder: Folder,
    json_file: JsonFile = None,
    report: Report = None,
    only: Only = None,
    thin: Thin = None,
    workers: NumberOfWorkers = 0,
) -> int:
    """Map the recorded logs of a folder with the same settings.

    The figures are the errors against the logs' references and relations, and the speed. Ctrl-C
    keeps the logs that are mapped. Exit code 0: every log has a result of use. 1: one has not.
    \f

    Args:
        folder: The folder.
        json_file: File for the figures as JSON.
        report: The directory of the HTML pages.
        only: Names of logs.
        thin: Steps of the thinned logs, m.
        workers: The number of processes. 0: the number of cores.

    Returns:
        The exit code.
    """
    from simloop.benchmarks.logs import bench, tables
    from simloop.benchmarks.planners.bench import names
    from simloop.common.pool import processes
    from simloop.common.terminal import counting, print_lines
    from simloop.graph_slam.warmup import warm_up

    found, said = bench.find_logs(folder)
    logs = bench.choose(found, names(only))
    tasks = bench.tasks_of(logs, bench.parse_steps(names(thin)), report)
    _check(tasks, list(found.values()), json_file, report)
    notes = Console(stderr=True)
    print_lines(notes, said)
    with compiling_shown(notes) as compiled:
        warm_up(compiled)  # the processes take the kernels from the cache
    rows: list[bench.Row] = []
    with stopping(_NOTE) as stop, counting(notes, "logs", len(tasks)) as show:
        for row in bench.run(tasks, processes(workers), stop):
            rows.append(row)
            show(len(rows))
    figures = bench.figures_of(tasks, rows)
    tables.print_figures(Console(), figures)
    write_json(json_file, figures)
    if report is not None:
        tables.write_index(report, tasks, figures)
    if figures["interrupted"]:
        return INTERRUPTED
    return 0 if figures["ok"] else 1


def _check(
    tasks: list[Task], logs: list[Path], json_file: Path | None, report: Path | None
) -> None:
    """Check that all outputs can be written, and that none replaces a log."""
    from simloop.benchmarks.logs.tables import INDEX
    from simloop.common.files import FilePlan
    from simloop.replay.report import page

    plan = FilePlan()
    plan.reads_all({path: f"the log {path}" for path in logs})
    pages = [task.page.name for task in tasks if task.page is not None]
    plan.writes_into(report, "--report", [INDEX, *pages])
    plan.writes(json_file, "--json")
    plan.check()
    if report is not None:
        page.check()
