"""``simloop replay``: map or localise with a recorded log of a real robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from simloop.cli.common import INTERRUPTED, compiling_shown, stop_asked, write_json
from simloop.common.json_text import json_text

Log = Annotated[
    Path, typer.Argument(help="A CARMEN .log, .clf or .log.gz file, or an .npz file of scans.")
]
JsonOrStdout = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write all figures as JSON; - means stdout."),
]
Out = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write map, trajectory (TUM format) and recording here."),
]
Relations = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Reference relations to judge the trajectory by."),
]
Reference = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.tum", help="Another trajectory (TUM format) to compare the trajectory with."
    ),
]
ReportDir = Annotated[
    Path | None, typer.Option("--report", metavar="DIR", help="Write an HTML page here.")
]
Prior = Annotated[
    Path | None,
    typer.Option("--map", metavar="FILE.yaml", help="Localise in this map instead of making one."),
]


def replay(
    log: Log,
    json_file: JsonOrStdout = None,
    out: Out = None,
    relations: Relations = None,
    prior: Prior = None,
    reference: Reference = None,
    report_dir: ReportDir = None,
) -> int:
    """Map or localise with a recorded log of a real robot.

    Exit code 0: the result is of use. 1: it is worthless. 2: wrong input. 130: stopped by Ctrl-C,
    which ends the log early and keeps the results so far.
    \f

    Args:
        log: The log.
        json_file: File for the figures as JSON; ``-`` means stdout.
        out: The directory of map, trajectory and recording.
        relations: The file of reference relations between poses of the trajectory.
        prior: The YAML file of a map to localise in.
        reference: The TUM file of a reference, with times on the log's clock.
        report_dir: The directory of the HTML page.

    Returns:
        The exit code.
    """
    from simloop.common.map_server import picture_of
    from simloop.common.terminal import counting, print_lines
    from simloop.common.waiting import said_if_slow
    from simloop.graph_slam.settings import MappingConfig
    from simloop.replay import outputs, session

    files = outputs.ReplayFiles(out, json_file, report_dir)
    files.check(log, relations, reference, prior, prior and picture_of(prior))
    read, truth = session.load(log, relations, reference)
    config = MappingConfig()
    notes = Console(stderr=True)
    with said_if_slow(notes, "reading the known map"):
        known = session.load_prior(prior, config) if prior is not None else None
    print_lines(notes, read.notes)
    bar = counting(notes, "scans", len(read.t_s))
    with stop_asked() as stop, compiling_shown(notes) as report, bar as show:
        replayed = session.run(
            read, truth, config, known, lambda done: show(done) or not stop(), report
        )
        outputs.write(replayed, files, log.name)
    figures = replayed.figures
    print_lines(notes, figures["notes"][len(read.notes) :])
    if json_file == outputs.STDOUT:
        print(json_text(figures), end="")
    else:
        outputs.print_figures(Console(), figures)
        write_json(json_file, figures)
    if figures["interrupted"]:
        return INTERRUPTED
    if figures["worthless"]:
        print_lines(notes, [f"the result is worthless: {figures['worthless']}"])
        return 1
    return 0
