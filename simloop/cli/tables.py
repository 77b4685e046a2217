"""Results as tables in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape

from simloop.certify.checks import Check
from simloop.common.terminal import print_table

_OUTCOMES = {
    "reached": ("green", "goal reached"),
    "collision": ("red", "collision"),
    "timeout": ("red", "out of time"),
    "stuck": ("red", "stuck: it gave up"),
    "lost": ("red", "lost: it does not know where it is, and stopped"),
    "missed": ("red", "it stopped short, believing to be there"),
    "interrupted": ("yellow", "interrupted"),
}


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


def _figure(value: float | None, form: str, unit: str = "") -> str:
    return "none" if value is None else f"{value:{form}}{unit}"


def _gap(clearance_m: float | None) -> str:
    return "none in this arena" if clearance_m is None else f"{clearance_m:.3f} m at the closest"
