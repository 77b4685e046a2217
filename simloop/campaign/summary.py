"""A campaign's rows summed up, cell by cell: rates with intervals, and figures' spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from simloop.campaign.work import Row

Cell = tuple[str, str, str]
FIGURES = ("sim_time_s", "path_ratio", "min_clearance_m", "ate_rmse_m", "energy_j")
"""What a summary and a report show of the runs that arrived."""


@dataclass(frozen=True, slots=True)
class CellSummary:
    """success: the share of runs that arrived, with Wilson's 95 % interval; outcomes: how many.

    figures: name -> mean, p50, p95, min, max over the runs that arrived.
    """

    cell: Cell
    runs: int
    success: float
    low: float
    high: float
    outcomes: dict[str, int]
    figures: dict[str, dict[str, float]]


def cells_of(rows: Sequence[Row]) -> dict[Cell, list[Row]]:
    """Rows by scenario, planner and sweep, in their order."""
    cells: dict[Cell, list[Row]] = {}
    for row in rows:
        cells.setdefault((row["scenario"], row["planner"], row["sweep"]), []).append(row)
    return cells


def summarise(rows: Sequence[Row]) -> list[CellSummary]:
    """Each cell's summary."""
    return [_summary(cell, mine) for cell, mine in cells_of(rows).items()]


def figure_of(row: Row, name: str) -> float | None:
    """A row's number by its name; path_ratio is the path over the shortest. None: there is none."""
    if name == "path_ratio":
        path, shortest = row.get("path_length_m"), row.get("shortest_path_m")
        return path / shortest if path is not None and shortest else None
    value = row.get(name)
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if numeric else None  # type: ignore[arg-type]


def spread(values: Sequence[float]) -> dict[str, float]:
    """mean, p50, p95, min and max."""
    array = np.array(values)
    return {
        "mean": float(array.mean()),
        "p50": float(np.percentile(array, 50)),
        "p95": float(np.percentile(array, 95)),
        "min": float(array.min()),
        "max": float(array.max()),
    }


def to_table(summary: CellSummary) -> dict[str, Any]:
    """For JSON."""
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
    arrived = [row for row in rows if row["success"]]
    interval = binomtest(len(arrived), len(rows)).proportion_ci(0.95, method="wilson")
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
    figures = {}
    for name in FIGURES:
        values = [v for row in arrived if (v := figure_of(row, name)) is not None]
        if values:
            figures[name] = spread(values)
    share = len(arrived) / len(rows)
    return CellSummary(
        cell, len(rows), share, float(interval.low), float(interval.high), outcomes, figures
    )
