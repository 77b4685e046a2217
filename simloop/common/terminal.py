"""What a person reads in the terminal: progress while it runs, a table once it is over."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

if TYPE_CHECKING:
    from simloop.certify.checks import Check

_OUTCOMES = {
    "reached": ("green", "goal reached"),
    "collision": ("red", "collision"),
    "timeout": ("red", "out of time"),
    "stuck": ("red", "stuck: it gave up"),
    "lost": ("red", "lost: it does not know where it is, and stopped"),
    "missed": ("red", "it stopped short, believing to be there"),
    "interrupted": ("yellow", "interrupted"),
}


@contextmanager
def compiling(console: Console) -> Iterator[Callable[[str, int], None]]:
    """A spinner with a count, which appears only once a kernel is really compiled."""
    status = console.status("")
    began = False

    def report(name: str, count: int) -> None:
        nonlocal began
        text = f"compiling kernel {count}: {name} (first run only; kept for the next)"
        if console.is_terminal:
            status.update(text)
        if not began:
            began = True
            if console.is_terminal:
                status.start()
            else:
                console.print("compiling the kernels (first run only; kept for the next)")

    try:
        yield report
    finally:
        if began:
            status.stop()


@contextmanager
def progress_bar(
    console: Console, distance_m: float, time_limit_s: float
) -> Iterator[Callable[[float, float], None]]:
    """A bar over the way to the goal, with simulated time and distance to go; on terminals only."""
    columns = (
        TextColumn("{task.fields[t]:6.1f} s simulated (limit {task.fields[limit]:g} s)"),
        BarColumn(bar_width=32),
        TextColumn("{task.fields[to_go]:5.2f} m to go"),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar:
        task = bar.add_task("", total=1.0, t=0.0, limit=time_limit_s, to_go=distance_m)

        def advance(sim_time_s: float, to_go_m: float) -> None:
            share = 1.0 - to_go_m / distance_m if distance_m > 0.0 else 1.0
            bar.update(task, completed=max(0.0, share), t=sim_time_s, to_go=to_go_m)

        yield advance


@contextmanager
def counting(console: Console, what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar over ``total`` things that are done one by one; on terminals only."""
    columns = (
        TextColumn(what),
        BarColumn(bar_width=32),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def checking(console: Console) -> Iterator[Callable[[str, int], None]]:
    """A spinner with what is being checked; on terminals only."""
    status = console.status("checking")
    if console.is_terminal:
        status.start()
    try:
        yield lambda group, count: status.update(f"{count} checks done: {group}")
    finally:
        status.stop()


def print_certificate(console: Console, checks: Sequence[Check]) -> None:
    """One table a group, and the verdict; informative rows are for comparison only."""
    groups: dict[str, list[Check]] = {}
    for check in checks:
        groups.setdefault(check.group, []).append(check)
    for group, members in groups.items():
        rows = [
            [
                check.name,
                f"{check.value:.5g} {check.unit}".rstrip(),
                f"{check.expected:.5g}",
                f"{check.error:.2g}",
                f"{check.tolerance:g}",
                "compared" if check.informative else ("ok" if check.ok else "FAILED"),
            ]
            for check in members
        ]
        header = ["check", "value", "expected", "error", "tolerance", ""]
        print_table(console, group, header, rows)
    counted = [check for check in checks if not check.informative]
    failed = sum(not check.ok for check in counted)
    verdict = f"[bold red]{failed} of {len(counted)} checks failed[/]"
    if not failed:
        verdict = f"[bold green]all {len(counted)} checks hold[/]"
    console.print(verdict, highlight=False)


def print_result(console: Console, metrics: Mapping[str, Any]) -> None:
    """The figures of a run in the order in which a person asks for them."""
    colour, text = _OUTCOMES.get(metrics["outcome"], ("red", metrics["outcome"]))
    heading = f"{metrics['scenario']}, seed {metrics['seed']}, planner {metrics['planner']}"
    heading = f"{escape(heading)}: [bold {colour}]{text}[/]"
    console.print(heading, highlight=False, soft_wrap=True)
    for name, value in result_rows(metrics):
        line = f"  [dim]{name:13}[/] {escape(value)}"
        console.print(line, highlight=False, soft_wrap=True)


def result_rows(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(name, text) rows of the result table."""
    path, shortest = metrics["path_length_m"], metrics["shortest_path_m"]
    way = f"{path:.2f} m"
    if shortest:
        way += f"; shortest safe way {shortest:.2f} m ({path / shortest:.2f} x)"
    yaw = metrics["yaw_rmse_rad"]
    yaw_deg = None if yaw is None else math.degrees(yaw)
    factor = _figure(metrics["real_time_factor"], ".1f", " x real time")
    return [
        ("time", f"{metrics['sim_time_s']:.2f} s, simulated in {metrics['wall_time_s']:.2f} s "
                 f"of wall time ({factor})"),
        ("path", f"{way}, SPL {metrics['spl']:.3f}"),
        ("obstacles", f"{_gap(metrics['min_clearance_m'])}, "
                      f"{metrics['contact_count']} contacts"),
        ("localisation", f"{_figure(metrics['ate_rmse_m'], '.4f', ' m')} and "
                         f"{_figure(yaw_deg, '.3f', ' deg')} RMS error, "
                         f"NEES {_figure(metrics['nees_mean'], '.2f')} (ideal 3)"),
        ("planning", f"{metrics['replans']} replans, "
                     f"{_figure(metrics['plan_ms_p50'], '.2f')} ms median, "
                     f"{_figure(metrics['plan_ms_p99'], '.2f')} ms p99, "
                     f"{metrics['plan_evaluations']:,} evaluations"),
        ("energy", f"{metrics['energy_j']:.0f} J"),
        ("state hash", str(metrics["state_hash"])),
    ]  # fmt: skip


def print_table(
    console: Console, title: str, header: Sequence[str], rows: Sequence[Sequence[str]]
) -> None:
    """Columns aligned to the left under their names; never wrapped, so that scripts can read it."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True))

    if title:
        console.print(f"[bold]{escape(title)}[/]", highlight=False)
    console.print(f"  [dim]{escape(line(header).rstrip())}[/]", highlight=False, soft_wrap=True)
    for row in rows:
        console.print(f"  {escape(line(row).rstrip())}", highlight=False, soft_wrap=True)


def _figure(value: float | None, form: str, unit: str = "") -> str:
    return "none" if value is None else f"{value:{form}}{unit}"


def _gap(clearance_m: float | None) -> str:
    return "none in this arena" if clearance_m is None else f"{clearance_m:.3f} m at the closest"
