"""Print results as tables in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape

from simloop.certify.checks import Check
from simloop.common.errors import printable
from simloop.common.terminal import print_table
from simloop.evaluation.referee import Outcome


def print_certificate(console: Console, checks: Sequence[Check]) -> None:
    """Print one table for each group of checks, then the verdict.

    Args:
        console: Console to print to.
        checks: The checks. Informative checks are shown for comparison and do not count.
    """
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
    """Print how a run ended, and its figures.

    Args:
        console: Console to print to.
        metrics: The figures of the run, see ``RunMetrics.result``.
    """
    outcome = Outcome(metrics["outcome"])
    colour = "yellow" if outcome is Outcome.INTERRUPTED else "green" if outcome.success else "red"
    heading = f"{metrics['scenario']}, seed {metrics['seed']}, planner {metrics['planner']}"
    heading = f"{escape(printable(heading))}: [bold {colour}]{outcome.description}[/]"
    console.print(heading, highlight=False, soft_wrap=True)
    for name, value in result_rows(metrics):
        line = f"  [dim]{name:13}[/] {escape(value)}"
        console.print(line, highlight=False, soft_wrap=True)


def result_rows(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Format the figures of a run for display.

    Args:
        metrics: The figures of the run, see ``RunMetrics.result``.

    Returns:
        Rows of name and text, the most important first.
    """
    path, shortest = metrics["path_length_m"], metrics["shortest_path_m"]
    length = f"{path:.2f} m"
    if shortest:
        length += f"; shortest safe path {shortest:.2f} m ({path / shortest:.2f} x)"
    yaw = metrics["yaw_rmse_rad"]
    yaw_deg = None if yaw is None else math.degrees(yaw)
    factor = _figure(metrics["real_time_factor"], ".1f", " x real time")
    return [
        ("time", f"{metrics['sim_time_s']:.2f} s, simulated in {metrics['wall_time_s']:.2f} s "
                 f"of wall time ({factor})"),
        ("path", f"{length}, SPL {_figure(metrics['spl'], '.3f')}"),
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
