"""Figures of the benchmark: a cell for each planner in each world, as the JSON file holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from simloop.benchmarks.papers.drive import TIMES
from simloop.benchmarks.papers.entries import Drives, Entry
from simloop.benchmarks.papers.reasons import contradicted, reason_of
from simloop.campaign.summary import figure_of
from simloop.campaign.work import Row
from simloop.evaluation.provenance import machine, versions

Cell = dict[str, Any]
"""The figures of one planner in one world, by name."""


def cells_of(request: Drives, rows: Mapping[str, Row]) -> list[Cell]:
    """Compute the figures of all entries that have runs.

    Args:
        request: The request.
        rows: The row of each finished run, by ``RunSpec.key``.

    Returns:
        A cell for each entry, in the order of the request.
    """
    cells = []
    for entry in request.chosen():
        mine = [rows[spec.key] for spec in request.runs_of(entry) if spec.key in rows]
        if mine:
            cells.append(cell_of(entry, mine))
    return cells


def cell_of(entry: Entry, rows: Sequence[Row]) -> Cell:
    """Compute the figures of one entry.

    Args:
        entry: The entry.
        rows: The rows of its runs, at least one.

    Returns:
        The figures that docs/benchmarks.md lists. Times, path ratio and path length are taken over
        the runs that arrived; None if no run did. A row with an error counts as a run.
    """
    arrived = [row for row in rows if row["success"]]
    interval = binomtest(len(arrived), len(rows)).proportion_ci(0.95, method="wilson")
    times = _values(arrived, "sim_time_s")
    frames = [ms for row in rows for ms in row.get("frame_ms", ())]
    evaluations = [float(row.get("plan_evaluations") or 0) for row in rows]
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
    return {
        "group": entry.group,
        "world": entry.world,
        "planner": entry.planner,
        "role": entry.role,
        "runs": len(rows),
        "arrivals": len(arrived),
        "arrival_interval": [float(interval.low), float(interval.high)],
        "outcomes": outcomes,
        "contacts": int(sum(row.get("contact_count") or 0 for row in rows)),
        "hits": int(sum(row.get("hit_count") or 0 for row in rows)),
        "time_mean_s": _mean(times),
        "time_median_s": _quantile(times, 50),
        "path_m": _mean(_values(arrived, "path_length_m")),
        "path_ratio": _quantile(_values(arrived, "path_ratio"), 50),
        "min_clearance_m": min(_values(rows, "min_clearance_m"), default=None),
        "frames": len(frames),
        "frame_ms_p50": _quantile(frames, 50),
        "frame_ms_p99": _quantile(frames, 99),
        "evaluations": _mean(evaluations),
        "evaluations_per_frame": sum(evaluations) / len(frames) if frames else None,
        "cpu_s": _mean(_values(rows, "cpu_s")),
        "reason": reason_of(entry.planner, entry.world, len(arrived), len(rows)),
        "errors": sorted({row["error"] for row in rows if row["error"]}),
    }


def figures_of(
    request: Drives,
    rows: Mapping[str, Row],
    tables: Mapping[str, Any] | None,
    missing: Sequence[str] = (),
) -> dict[str, Any]:
    """Compute everything that the JSON file holds.

    Args:
        request: The request.
        rows: The row of each finished run, by ``RunSpec.key``.
        tables: The measured parts of `tables.measure`, by name; None if they were interrupted.
        missing: Planners that are left out because their libraries are not installed.

    Returns:
        The figures, see docs/benchmarks.md.
    """
    cells = cells_of(request, rows)
    specs = request.runs()
    parts = tables or {}
    done = {(cell["planner"], cell["world"]): (cell["arrivals"], cell["runs"]) for cell in cells}
    return {
        "cells": cells,
        "tables": {name: part for name, part in parts.items() if name != "weights"},
        "weights": parts.get("weights"),
        "contradicted_reasons": [list(key) for key in contradicted(done)],
        "missing_planners": list(missing),
        "seeds": list(request.seeds),
        "runs": len(specs),
        "runs_finished": sum(spec.key in rows for spec in specs),
        "interrupted": tables is None or any(spec.key not in rows for spec in specs),
        "cpu_s": sum(rows[spec.key].get("cpu_s", 0.0) for spec in specs if spec.key in rows),
        "machine": machine(),
        "versions": versions(),
    }


def without_times(found: Any) -> Any:
    """Leave out everything that depends on the machine's speed.

    Args:
        found: The figures, or a part of them.

    Returns:
        The same without these entries.
    """
    if isinstance(found, dict):
        kept = {key: value for key, value in found.items() if not _is_time(key)}
        return {key: without_times(value) for key, value in kept.items()}
    return [without_times(value) for value in found] if isinstance(found, list) else found


def _is_time(key: str) -> bool:
    return key in TIMES or key.startswith("frame_ms") or key in ("machine", "seconds")


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [value for row in rows if (value := figure_of(row, name)) is not None]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _quantile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None
