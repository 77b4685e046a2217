"""``simloop campaign``: do many runs, judge them and write a report. A campaign can be resumed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from simloop.cli.apart import Redo, Repair, check_apart, check_redo, files_in, outputs_of
from simloop.cli.common import (
    INTERRUPTED,
    JsonFile,
    NumberOfWorkers,
    Overrides,
    check_json,
    write_json,
)
from simloop.cli.stopping import leaving_at_once, stopping
from simloop.cli.world import print_notes
from simloop.common.errors import InputError, printable

if TYPE_CHECKING:
    from simloop.campaign.journal import Journal
    from simloop.campaign.spec import Request, RunSpec
    from simloop.campaign.summary import CellSummary
    from simloop.campaign.thresholds import Threshold, Verdict
    from simloop.campaign.work import Row
    from simloop.cli.runs import How

Scenarios = Annotated[
    list[str] | None,
    typer.Argument(metavar="SCENARIO", help="Names of scenarios, or TOML files."),
]
Seeds = Annotated[
    str, typer.Option(metavar="A:B", help="The seeds from A to B-1. A single number N means 0:N.")
]
Planners = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="A planner; repeatable. Default: the scenario's own."),
]
Sweeps = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=V1,V2,...",
        help="Values of a scenario key, or KEY=FIRST:LAST:STEP; repeatable, all combinations run.",
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Run on the Dask cluster with this scheduler instead."),
]
Out = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Directory for journal, results and report.")
]
Requirements = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME>=VALUE",
        help="A threshold for every cell, e.g. success_rate>=0.98; repeatable.",
    ),
]
JUnitFile = Annotated[
    Path | None, typer.Option(metavar="FILE.xml", help="Write the verdict as JUnit XML.")
]
FailuresToRecord = Annotated[
    int, typer.Option(min=0, metavar="N", help="Record the first N runs that failed.")
]
WriteReport = Annotated[bool, typer.Option(help="Write report.html into the directory.")]
Compared = Annotated[
    tuple[Path, Path] | None,
    typer.Option(
        metavar="A B", help="Run nothing; print what differs between the campaigns A and B."
    ),
]


def campaign(
    context: typer.Context,
    scenarios: Scenarios = None,
    seeds: Seeds = "0:20",
    planner: Planners = None,
    sweep: Sweeps = None,
    overrides: Overrides = None,
    workers: NumberOfWorkers = 0,
    dask: Dask = None,
    out: Out = None,
    require: Requirements = None,
    junit: JUnitFile = None,
    record_failures: FailuresToRecord = 10,
    report: WriteReport = True,
    redo: Redo = None,
    repair: Repair = False,
    compare: Compared = None,
    json_file: JsonFile = None,
) -> int:
    """Do many runs and judge them.

    Runs each scenario with each planner, each combination of sweep values and each seed. If a
    campaign is stopped or killed, give the same command again: it continues where it stopped.

    Exit code 0: all runs reach the goal or, with --require, all thresholds hold. 1: otherwise, or
    if --compare finds that something got worse. 2: wrong input. 130: stopped by Ctrl-C.
    \f

    Each argument is the option of the same name; see its help text above.

    Args:
        context: The command line, to tell which options were given.
        scenarios, seeds, planner, sweep, overrides: The runs.
        workers, dask: The processes that do the runs.
        out, require, junit, record_failures, report, json_file: The thresholds and the outputs.
        redo: ``errors`` to repeat the runs that ended with the outcome ``error``.
        repair: Whether damaged files of an earlier campaign in ``out`` are repaired.
        compare: The directories or result files of two campaigns, to compare them instead.

    Returns:
        The exit code.

    Raises:
        InputError: If an option is wrong or an output cannot be written.
    """
    with leaving_at_once():
        check_json(json_file)
        if compare is not None:
            _refuse_with_compare(context)
            return _compare(*compare, json_file)
        if not scenarios or out is None:
            raise InputError("campaign: give at least one SCENARIO and --out DIR, or --compare A B")
        check_redo(redo)
        from simloop.cli.runs import How
        from simloop.common.pool import processes

        request = _request(scenarios, seeds, planner, overrides, sweep)
        outputs = _Outputs(out, junit, json_file, record_failures, report)
        how = How(processes(workers), dask, redo is not None, repair)
        return _campaign(request, require or (), outputs, how)


def _refuse_with_compare(context: typer.Context) -> None:
    """Raise InputError for what is given beside --compare and --json."""
    others = [
        "SCENARIO" if one.param_type_name == "argument" else one.opts[0]
        for one in context.command.params
        if one.name not in ("compare", "json_file", "help", None)
        and getattr(context.get_parameter_source(one.name), "name", "") == "COMMANDLINE"
    ]
    if others:
        given = ", ".join(others)
        raise InputError(f"--compare runs nothing; it goes with --json only, not with {given}")


def _request(scenarios: Sequence[str], seeds: str, *rest: Sequence[str] | None) -> Request:
    from simloop.campaign.spec import Request
    from simloop.campaign.sweeps import parse_seeds

    places = tuple(_absolute(scenario) for scenario in scenarios)
    return Request(places, parse_seeds(seeds), *(tuple(values or ()) for values in rest))


@dataclass(frozen=True, slots=True)
class _Outputs:
    """The output files and directories of a campaign."""

    folder: Path
    junit: Path | None
    json_file: Path | None
    recorded_failures: int
    report: bool

    def check(self, request: Request) -> None:
        """Raise InputError for an output that cannot be written, before the first run."""
        from simloop.campaign import report
        from simloop.common.files import check_directory, check_file
        from simloop.scenario.inputs import all_input_files
        from simloop.scenario.load import resolve

        if self.report:
            report.check()
        if self.junit is not None:
            check_file(self.junit, "--junit")
        check_directory(self.folder, "--out")
        written = outputs_of(self.folder)
        # Recordings and copies of an earlier start of this campaign are there to be kept.
        check_apart({"--junit": self.junit, "--json": self.json_file}, files_in(self.folder))
        sources = [resolve(one) for one in request.scenarios]
        check_apart(
            {**written, "--junit": self.junit, "--json": self.json_file},
            all_input_files([cell.load() for cell in request.cells()], sources),
        )


def _campaign(request: Request, required: Sequence[str], outputs: _Outputs, how: How) -> int:
    from simloop.campaign.journal import Journal
    from simloop.campaign.thresholds import parse
    from simloop.cli.runs import do_missing

    thresholds = [parse(text) for text in required]
    request.check()
    outputs.check(request)
    specs = request.runs()
    with Journal(outputs.folder, request, repair=how.repair) as journal:
        _prepare(journal, request, specs, how)
        stopped = do_missing(journal, specs, how)
        runs = [(spec, journal.rows[spec.key]) for spec in specs if spec.key in journal.rows]
        with stopping("") as stop:
            verdicts = _write_results(outputs, runs, thresholds) if runs else []
            stopped = stopped or stop()
            if not stopped:
                _look_closer(outputs, runs, verdicts, stop)
                stopped = stop()
    if stopped:
        print(
            f"interrupted: {len(runs)} of {len(specs)} runs are finished and kept; "
            "give the same command again to continue"
        )
        sys.exit(INTERRUPTED)  # the line above replaces the general message
    good = [v.holds for v in verdicts] if verdicts else [row["success"] for _, row in runs]
    return 0 if all(good) else 1


def _prepare(journal: Journal, request: Request, specs: Sequence[RunSpec], how: How) -> None:
    """Take up what is finished, and check each world that is still to be run."""
    from simloop.campaign.work import check_worlds
    from simloop.cli.runs import take_up
    from simloop.common.terminal import counting

    take_up(journal, specs, how)
    missing = {spec.cell for spec in journal.missing(specs)}
    cells = [one for one in request.cells() if one.cell in missing]
    console = Console(stderr=True)
    with counting(console, "worlds checked", len(cells)) as show:
        notes = check_worlds(cells, request.seeds, show)
    print_notes(console, notes)


def _absolute(scenario: str) -> str:
    """Make the path of a scenario file absolute for workers elsewhere; a name stays unchanged."""
    from simloop.scenario.catalog import scenario_files
    from simloop.scenario.load import resolve

    return scenario if scenario in scenario_files() else str(resolve(scenario).resolve())


def _write_results(
    outputs: _Outputs, runs: Sequence[tuple[RunSpec, Row]], thresholds: Sequence[Threshold]
) -> list[Verdict]:
    """Write the results and the verdicts, print them as a table, and return the verdicts."""
    from simloop.campaign import summary
    from simloop.campaign.journal import write_results
    from simloop.campaign.junit import write_junit
    from simloop.campaign.thresholds import judge, to_table

    rows = [row for _, row in runs]
    file = write_results(outputs.folder, rows)
    verdicts = judge(thresholds, rows)
    if outputs.junit is not None:
        outputs.junit.parent.mkdir(parents=True, exist_ok=True)
        write_junit(outputs.junit, runs, verdicts)
    summaries = summary.summarise(rows)
    _print(summaries, verdicts)
    _print_file("results", file)
    write_json(
        outputs.json_file,
        {
            "cells": [summary.to_table(one) for one in summaries],
            "thresholds": [to_table(verdict) for verdict in verdicts],
        },
    )
    return verdicts


def _print(summaries: Sequence[CellSummary], verdicts: Sequence[Verdict]) -> None:
    from simloop.campaign.summary import name_of
    from simloop.common.terminal import print_table

    rows = []
    for one in summaries:
        time = one.figures.get("sim_time_s")
        rows.append(
            [
                name_of(one.cell),
                f"{one.reached}/{one.runs}",
                f"{100 * one.low:.1f} to {100 * one.high:.1f} %",
                ", ".join(f"{name} {count}" for name, count in one.outcomes.items()),
                "-" if time is None else f"{time['mean']:.2f} / {time['max']:.2f} s",
            ]
        )
    header = ["cell", "goal reached", "95 % interval", "outcomes", "time, mean / max"]
    print_table(Console(), "campaign", header, rows)
    for verdict in verdicts:
        state = "holds" if verdict.holds else "FAILS"
        print(f"  {state}  {verdict.threshold}: {verdict.measured}  ({name_of(verdict.cell)})")


def _look_closer(
    outputs: _Outputs,
    runs: Sequence[tuple[RunSpec, Row]],
    verdicts: Sequence[Verdict],
    stop: Callable[[], bool],
) -> None:
    """Record failed runs, and write the report with pictures of the worst runs."""
    from simloop.campaign import closer_look, report
    from simloop.campaign.work import ERROR

    errors = [(spec, row) for spec, row in runs if row["outcome"] == ERROR]
    if errors:
        spec, row = errors[0]
        print(f"  {len(errors)} runs ended in an error; --redo errors does them again. The first:")
        print(f"  {spec.command()}: {printable(row['error'])}")
    failed = closer_look.failures(runs, outputs.recorded_failures)
    for file in closer_look.record(failed, outputs.folder / "failures", stop):
        _print_file("failure", file)
    if outputs.report and not stop():
        _print_file("report", report.write(outputs.folder, runs, verdicts, stop))


def _print_file(what: str, file: Path) -> None:
    Console().print(f"  {what:8} {file}", markup=False, highlight=False, soft_wrap=True)


def _results(path: Path) -> list[Path]:
    """List the files of a campaign that is given by its folder or its file of results."""
    return files_in(path) if path.is_dir() else [path, *files_in(path.parent)]


def _compare(before: Path, after: Path, json_file: Path | None) -> int:
    """Print the differences; return exit code 1 if something got significantly worse."""
    from simloop.campaign import compare
    from simloop.campaign.journal import read_results
    from simloop.campaign.summary import name_of
    from simloop.common.terminal import print_table

    check_apart({"--json": json_file}, [one for path in (before, after) for one in _results(path)])
    changes = compare.compare(read_results(before), read_results(after))
    rows = [
        [
            name_of(one.cell),
            one.figure,
            str(one.pairs),
            f"{one.before:.5g}",
            f"{one.after:.5g}",
            f"{one.p_holm:.2g}",
            one.verdict,
        ]
        for one in changes
    ]
    header = ["cell", "figure", "pairs", str(before), str(after), "p (Holm)", "verdict"]
    print_table(Console(), "comparison", header, rows)
    write_json(json_file, {"changes": [compare.to_table(one) for one in changes]})
    return 1 if any(one.verdict == "worse" for one in changes) else 0
