"""Summarise the rows of a campaign by cell: success rates with intervals, spread of the figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from simloop.campaign.spec import Cell
from simloop.campaign.work import TIMING, Row

FIGURES = ("sim_time_s", "path_ratio", "min_clearance_m", "ate_rmse_m", "energy_j")
"""The figures of a summary and a report. They are taken over the successful runs."""

NUMBERS = (
    "seed",
    "sim_time_s",
    "path_length_m",
    "shortest_path_m",
    "spl",
    "min_clearance_m",
    "contact_count",
    "hit_count",
    "ate_rmse_m",
    "yaw_rmse_rad",
    "nees_mean",
    "distance_to_go_m",
    "replans",
    "plan_evaluations",
    "energy_j",
    "shear_work_j",
    *TIMING,
)
"""The columns of a row that hold a number, or None where a run has no such figure."""


@dataclass(frozen=True, slots=True)
class CellSummary:
    """Summary of the runs of one cell.

    Attributes:
        cell: Scenario, planner and sweep.
        runs: The number of runs.
        reached: The number of runs that reached the goal.
        success: The share of runs that reached the goal, 0 to 1.
        low: Lower end of Wilson's 95 % interval of ``success``.
        high: Upper end of that interval.
        outcomes: The number of runs with each outcome.
        figures: For each name in ``FIGURES`` that was measured, its ``spread`` over the successful
            runs.
    """

    cell: Cell
    runs: int
    reached: int
    success: float
    low: float
    high: float
    outcomes: dict[str, int]
    figures: dict[str, dict[str, float]]


def name_of(cell: Cell) -> str:
    """Name a cell in one line.

    Args:
        cell: Scenario, planner and sweep.

    Returns:
        The parts that are not empty, separated by commas.
    """
    return ", ".join(part for part in cell if part)


def cells_of(rows: Sequence[Row]) -> dict[Cell, list[Row]]:
    """Group rows by cell.

    Args:
        rows: Rows of one campaign.

    Returns:
        The rows of each cell. Cells and rows keep their order.
    """
    cells: dict[Cell, list[Row]] = {}
    for row in rows:
        cells.setdefault((row["scenario"], row["planner"], row["sweep"]), []).append(row)
    return cells


def summarise(rows: Sequence[Row]) -> list[CellSummary]:
    """Summarise every cell.

    Args:
        rows: Rows of one campaign.

    Returns:
        One summary for each cell.
    """
    return [_summary(cell, mine) for cell, mine in cells_of(rows).items()]


def figure_of(row: Row, name: str) -> float | None:
    """Look up a number in a row.

    Args:
        row: A run's row, or its metrics.
        name: A column's name, or ``path_ratio``: the path length divided by the length of the
            shortest safe path.

    Returns:
        The number, or None if the row has no such number.
    """
    if name == "path_ratio":
        path, shortest = row.get("path_length_m"), row.get("shortest_path_m")
        return path / shortest if path is not None and shortest else None
    value = row.get(name)
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if numeric else None  # type: ignore[arg-type]


def wrong_column(rows: Sequence[Row]) -> str:
    """Find a column of numbers that holds something else.

    Args:
        rows: Rows.

    Returns:
        The first of ``NUMBERS`` of which a value is neither a number nor None; empty if there is
        none.
    """
    for name in NUMBERS:
        for value in (row.get(name) for row in rows):
            if value is not None and (
                not isinstance(value, int | float) or isinstance(value, bool)
            ):
                return name
    return ""


def spread(values: Sequence[float]) -> dict[str, float]:
    """Describe how values are distributed.

    Args:
        values: At least one number.

    Returns:
        The mean, the median (p50), the 95th percentile (p95), the minimum and the maximum.
    """
    array = np.array(values)
    return {
        "mean": float(array.mean()),
        "p50": float(np.percentile(array, 50)),
        "p95": float(np.percentile(array, 95)),
        "min": float(array.min()),
        "max": float(array.max()),
    }


def to_table(summary: CellSummary) -> dict[str, Any]:
    """Convert a summary for JSON.

    Args:
        summary: A cell's summary.

    Returns:
        Its values by name.
    """
    scenario, planner, sweep = summary.cell
    return {
        "scenario": scenario,
        "planner": planner,
        "sweep": sweep,
        "runs": summary.runs,
        "success_rate": summary.success,
        "success_interval": [summary.low, summary.high],
        "outcomes": summary.outcomes,
        "figures": summary.figures,
    }


def _summary(cell: Cell, rows: Sequence[Row]) -> CellSummary:
    succeeded = [row for row in rows if row["success"]]
    interval = binomtest(len(succeeded), len(rows)).proportion_ci(0.95, method="wilson")
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
    figures = {}
    for name in FIGURES:
        values = [v for row in succeeded if (v := figure_of(row, name)) is not None]
        if values:
            figures[name] = spread(values)
    return CellSummary(
        cell=cell,
        runs=len(rows),
        reached=len(succeeded),
        success=len(succeeded) / len(rows),
        low=float(interval.low),
        high=float(interval.high),
        outcomes=outcomes,
        figures=figures,
    )
