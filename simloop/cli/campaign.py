"""``simloop campaign``: many runs, resumable, judged and reported."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from simloop.cli.common import INTERRUPTED, JsonFile, Overrides, check_json, stop_asked, write_json
from simloop.common.errors import InputError

if TYPE_CHECKING:
    from simloop.campaign.compare import Change
    from simloop.campaign.execute import Make
    from simloop.campaign.journal import Journal
    from simloop.campaign.spec import RunSpec
    from simloop.campaign.thresholds import Threshold, Verdict
    from simloop.campaign.work import Row


def campaign(
    scenarios: Annotated[
        list[str] | None, typer.Argument(metavar="SCENARIO...", help="Names, or TOML files.")
    ] = None,
    seeds: Annotated[str, typer.Option(metavar="A:B", help="From A to before B.")] = "0:20",
    planner: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A planner by name (repeatable).")
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=V1,V2,...", help="A key's values, or FIRST:LAST:STEP."),
    ] = None,
    overrides: Overrides = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as cores unless given.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler instead.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Journal, results and report.")
    ] = None,
    require: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME>=VALUE", help="A threshold, e.g. success_rate>=0.98."),
    ] = None,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE.xml", help="The verdict as JUnit XML.")
    ] = None,
    record_failures: Annotated[
        int, typer.Option(min=0, metavar="N", help="Recordings of the first N failures.")
    ] = 10,
    report: Annotated[bool, typer.Option(help="Write report.html.")] = True,
    compare: Annotated[
        tuple[Path, Path] | None,
        typer.Option(metavar="A B", help="What got better or worse from campaign A to B."),
    ] = None,
    json_file: JsonFile = None,
) -> int:
    """Many runs: exit code 0 if all arrive, or all that is required holds; else 1.

    A campaign that was killed goes on where it stopped when the same line is given again.
    """
    check_json(json_file)
    if compare is not None:
        return _compare(*compare, json_file)
    if not scenarios or out is None:
        raise InputError("a campaign needs at least one SCENARIO and --out DIR")
    from simloop.campaign.journal import Journal
    from simloop.campaign.report import check as check_report
    from simloop.campaign.spec import Request, parse_seeds
    from simloop.campaign.thresholds import parse
    from simloop.common.files import check_file

    request = Request(
        tuple(map(_named, scenarios)), parse_seeds(seeds), *map(_tuple, (planner, overrides, sweep))
    )
    thresholds = [parse(text) for text in require or ()]
    request.check()
    if report:
        check_report()
    if junit is not None:
        check_file(junit, "--junit")
    specs = request.runs()
    with Journal(out, request) as journal:
        stopped = _run(journal, specs, workers or os.cpu_count() or 1, dask)
        runs = [(s, journal.rows[s.key]) for s in specs if s.key in journal.rows]
        if runs:
            good = _tell(out, runs, thresholds, junit, json_file)
    if stopped:
        print(f"interrupted: {len(runs)} of {len(specs)} runs are kept; the same line goes on")
        sys.exit(INTERRUPTED)
    _look_closer(out, runs, thresholds, record_failures, report)
    return 0 if good else 1


def _tuple(values: list[str] | None) -> tuple[str, ...]:
    return tuple(values or ())


def _named(scenario: str) -> str:
    """A scenario's file by its full path, so that workers elsewhere find it; a name as it is."""
    path = Path(scenario)
    return str(path.resolve()) if path.suffix else scenario


def _run(journal: Journal, specs: Sequence[RunSpec], workers: int, address: str | None) -> bool:
    """Do what is not done yet; whether it was stopped before the end."""
    from simloop.campaign import execute

    missing = journal.missing(specs)
    if not missing:
        return False
    bar = _bar(len(specs), len(missing))
    with _pool(workers, address) as (make, count), bar as show, stop_asked() as stop:
        for spec, row in execute.run_all(missing, make, count, stop):
            journal.add(spec, row)
            show(row)
    return bool(journal.missing(specs))


@contextmanager
def _pool(workers: int, address: str | None) -> Iterator[tuple[Make, int]]:
    from simloop.campaign import execute

    if address is not None:
        with execute.dask(address) as cluster:
            yield cluster
    else:
        yield execute.local(workers), workers


@contextmanager
def _bar(total: int, missing: int) -> Iterator[Callable[[Row], None]]:
    """Runs done, failures so far, and the time that is left."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

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


def _tell(
    out: Path,
    runs: Sequence[tuple[RunSpec, Row]],
    thresholds: Sequence[Threshold],
    junit: Path | None,
    json_file: Path | None,
) -> bool:
    """Write results and verdict, print the table; whether all is as it must be."""
    from simloop.campaign import summary
    from simloop.campaign.journal import write_results
    from simloop.campaign.junit import write_junit
    from simloop.campaign.thresholds import judge

    rows = [row for _, row in runs]
    file = write_results(out, rows)
    verdicts = judge(thresholds, rows)
    if junit is not None:
        junit.parent.mkdir(parents=True, exist_ok=True)
        write_junit(junit, runs, verdicts)
    summaries = summary.summarise(rows)
    _print(summaries, verdicts)
    Console().print(f"  results  {file}", markup=False, highlight=False, soft_wrap=True)
    write_json(
        json_file,
        {
            "cells": [summary.to_table(one) for one in summaries],
            "thresholds": [
                {"cell": list(v.cell), "threshold": str(v.threshold), "value": v.value,
                 "holds": v.holds} for v in verdicts
            ],
        },
    )  # fmt: skip
    return all(v.holds for v in verdicts) if verdicts else all(row["success"] for row in rows)


def _print(summaries: Sequence[object], verdicts: Sequence[Verdict]) -> None:
    from simloop.campaign.summary import CellSummary
    from simloop.common.terminal import print_table

    rows = []
    for one in summaries:
        assert isinstance(one, CellSummary)
        time = one.figures.get("sim_time_s")
        rows.append(
            [
                ", ".join(part for part in one.cell if part),
                f"{one.outcomes.get('reached', 0)}/{one.runs}",
                f"{100 * one.low:.1f} to {100 * one.high:.1f} %",
                ", ".join(f"{name} {count}" for name, count in one.outcomes.items()),
                "-" if time is None else f"{time['mean']:.2f} / {time['max']:.2f} s",
            ]
        )
    header = ["cell", "arrived", "95 % interval", "outcomes", "time, mean / worst"]
    print_table(Console(), "campaign", header, rows)
    for verdict in verdicts:
        value = "nothing to measure" if verdict.value is None else f"{verdict.value:.5g}"
        state = "holds" if verdict.holds else "MISSED"
        where = ", ".join(part for part in verdict.cell if part)
        print(f"  {state}  {verdict.threshold}: {value}  ({where})")


def _look_closer(
    out: Path,
    runs: Sequence[tuple[RunSpec, Row]],
    thresholds: Sequence[Threshold],
    most: int,
    report: bool,
) -> None:
    """Recordings of failures, and the page with pictures of the worst."""
    from simloop.campaign import closer_look
    from simloop.campaign import report as page
    from simloop.campaign.thresholds import judge

    console = Console()
    for file in closer_look.record(closer_look.failures(runs, most), out / "failures"):
        console.print(f"  failure  {file}", markup=False, highlight=False, soft_wrap=True)
    if report:
        file = page.write(out, runs, judge(thresholds, [row for _, row in runs]))
        console.print(f"  report   {file}", markup=False, highlight=False, soft_wrap=True)


def _compare(before: Path, after: Path, json_file: Path | None) -> int:
    """Exit code 1 where something got significantly worse."""
    from simloop.campaign import compare
    from simloop.campaign.journal import read_results
    from simloop.common.terminal import print_table

    changes: list[Change] = compare.compare(read_results(before), read_results(after))
    rows = [
        [
            ", ".join(part for part in one.cell if part),
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
    print_table(Console(), "compared", header, rows)
    write_json(json_file, {"changes": [compare.to_table(one) for one in changes]})
    return 1 if any(one.verdict == "worse" for one in changes) else 0
