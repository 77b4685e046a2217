"""Figures of a comparison: one planner on one scene, and all planners against the lead planner.

Gaps are in percent of the best known J. They are gaps of the score, which includes penalties for
missing clearance and for the distance left to the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from simloop.benchmarks.planners.trials import Trial
from simloop.evaluation.statistics import compare

Gaps = dict[tuple[str, int], float]
"""Instance and seed of a trial -> its gap, %."""


def gaps_of(trials: Sequence[Trial], best: dict[str, float | None]) -> list[float]:
    """Compute the gaps of trials whose instance has a known best J.

    Args:
        trials: Trials.
        best: Instance -> best known J, None if unknown.

    Returns:
        Gaps, %, in the order of the trials; trials without a known best J are left out.
    """
    found = []
    for trial in trials:
        least = best[trial.instance]
        if least is not None:
            found.append(100.0 * (trial.verdict.score / least - 1.0))
    return found


def summary(
    trials: Sequence[Trial],
    best: dict[str, float | None],
    ms: Sequence[float],
    measured: dict[str, float] | None = None,
) -> dict[str, float | int | None]:
    """Compute the figures of one planner on one scene.

    Args:
        trials: The planner's trials on the scene.
        best: Instance -> best known J, None if unknown.
        ms: Planning times, ms.
        measured: Figures from `judge.measure`, which replace those of the same name.

    Returns:
        Figures by name: times in ms, gaps in %, shares from 0 to 1; None if unknown.
    """
    gaps = gaps_of(trials, best)
    spread: dict[str, list[float]] = {}
    for trial in trials:
        spread.setdefault(trial.instance, []).append(trial.verdict.score)
    figures: dict[str, float | int | None] = {
        "ms_p50": float(np.percentile(ms, 50)) if ms else None,
        "ms_p99": float(np.percentile(ms, 99)) if ms else None,
        "gap_p50": float(np.percentile(gaps, 50)) if gaps else None,
        "gap_p95": float(np.percentile(gaps, 95)) if gaps else None,
        "safe": float(np.mean([trial.verdict.safe for trial in trials])),
        "success": float(np.mean([trial.verdict.success for trial in trials])),
        "std": float(np.mean([np.std(scores) for scores in spread.values()])),
        "evaluations": float(np.mean([trial.evaluations for trial in trials])),
        "length": float(np.median([trial.verdict.length_m for trial in trials])),
        "turning": float(np.median([trial.verdict.turning_rad for trial in trials])),
        "plans": len(trials),
        "timed": len(ms),
    }
    if measured is not None:
        figures |= {**measured, "timed": int(measured["plans"])}
    return figures


def compare_with_lead(named: dict[str, Gaps], lead: str) -> dict[str, Any]:
    """Compare the lead planner's gaps with each rival's, paired by instance and seed.

    Args:
        named: Planner -> gaps of its trials.
        lead: Name of the lead planner.

    Returns:
        Rival -> result of `simloop.evaluation.statistics.compare`; empty without common trials.
    """
    mine = named.get(lead, {})
    rivals = [name for name in named if name != lead]
    # The test corrects for the number of rivals, so all rivals are compared on the same pairs.
    keys = sorted(set(mine).intersection(*[set(keyed) for keyed in named.values()]))
    if not keys or not rivals:
        return {}
    found = compare(
        [mine[key] for key in keys],
        {name: [named[name][key] for key in keys] for name in rivals},
    )
    return {name: asdict(one) for name, one in found.items()}


def rank(figures: dict[str, Any]) -> tuple[float, float]:
    """Return the sort key of a planner: success first, then the median gap.

    Args:
        figures: Figures of a planner on a scene, see `summary`.

    Returns:
        The key; the best planner has the smallest.
    """
    gap = figures["gap_p50"]
    return (-figures["success"], np.inf if gap is None else gap)
