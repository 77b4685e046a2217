"""Compare planners statistically: paired tests, and the effort to come near the optimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from simloop.messages import FloatArray

TARGETS = (0.1, 0.03, 0.01, 0.003, 0.001)
"""Relative gaps to the best known J at which a run is solved, for the ECDFs."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One planner (the lead) compared with another (the rival) on the same tasks.

    Attributes:
        difference: Median of rival - lead, in the unit of the scores. Lower scores are better.
        p: Two-sided p-value of Wilcoxon's signed-rank test.
        p_holm: The same, corrected for the comparison with several rivals.
        pairs: Number of tasks.
        lead_wins: Tasks in which the lead has the lower score.
        rival_wins: Tasks in which the rival has the lower score.
    """

    difference: float
    p: float
    p_holm: float
    pairs: int
    lead_wins: int
    rival_wins: int


def holm(p: Sequence[float]) -> list[float]:
    """Correct p-values for multiple tests.

    Args:
        p: The p-values.

    Returns:
        The corrected p-values in the same order (Holm 1979, "A Simple Sequentially Rejective
        Multiple Test Procedure").
    """
    order, count = np.argsort(p, kind="mergesort"), len(p)
    corrected, most = [0.0] * count, 0.0
    # From the smallest p on: each is multiplied by the number of tests that are left, and none may
    # be smaller than an earlier one.
    for rank, k in enumerate(order):
        most = max(most, min(1.0, (count - rank) * p[k]))
        corrected[k] = most
    return corrected


def wilcoxon(lead: Sequence[float], rival: Sequence[float]) -> float:
    """Test whether two paired samples differ, with Wilcoxon's signed-rank test.

    Args:
        lead: Scores of the lead.
        rival: Scores of the rival on the same tasks.

    Returns:
        The two-sided p-value. Pairs with equal scores are included after Pratt (1959). If all
        pairs are equal, it is 1.
    """
    apart = np.asarray(rival) - np.asarray(lead)
    if not apart.any():
        return 1.0
    return float(stats.wilcoxon(apart, zero_method="pratt", method="approx").pvalue)


def compare(lead: Sequence[float], rivals: Mapping[str, Sequence[float]]) -> dict[str, Comparison]:
    """Compare the lead with each rival.

    Args:
        lead: Scores of the lead, one for each task.
        rivals: Name to scores, in the same order of tasks.

    Returns:
        Name to comparison.
    """
    p = [wilcoxon(lead, rival) for rival in rivals.values()]
    found = {}
    for (name, rival), raw, corrected in zip(rivals.items(), p, holm(p), strict=True):
        apart = np.asarray(rival) - np.asarray(lead)
        found[name] = Comparison(
            difference=float(np.median(apart)),
            p=raw,
            p_holm=corrected,
            pairs=len(apart),
            lead_wins=int((apart > 0.0).sum()),
            rival_wins=int((apart < 0.0).sum()),
        )
    return found


def evaluations_to(history: FloatArray, target: float) -> float:
    """Count the evaluations until the best score is at most a target.

    Args:
        history: (H, 2) evaluations and the best score from then on, one row for each improvement.
        target: The target score.

    Returns:
        Number of evaluations; inf if the target is never reached.
    """
    hit = np.flatnonzero(history[:, 1] <= target)
    return float(history[hit[0], 0]) if len(hit) else np.inf


def ecdf(
    histories: Sequence[FloatArray],
    best: Sequence[float],
    grid: FloatArray,
    targets: Sequence[float] = TARGETS,
) -> FloatArray:
    """Compute the empirical distribution of the effort, over all pairs of run and target.

    This is the ECDF of COCO (Hansen et al. 2021).

    Args:
        histories: One history (H, 2) for each run, see ``evaluations_to``.
        best: Best known score of each run's task.
        grid: (G,) numbers of evaluations.
        targets: Relative gaps to the best known score.

    Returns:
        (G,) share, 0 to 1, of the pairs that are solved within this number of evaluations.
    """
    needed = np.array([
        evaluations_to(history, (1.0 + share) * optimum)
        for history, optimum in zip(histories, best, strict=True)
        for share in targets
    ])  # fmt: skip
    return np.asarray((needed[None] <= np.asarray(grid)[:, None]).mean(axis=1))


def convergence(
    histories: Sequence[FloatArray], best: Sequence[float], grid: FloatArray
) -> FloatArray:
    """Compute how the best score so far approaches the best known score.

    Args:
        histories: One history (H, 2) for each run, see ``evaluations_to``.
        best: Best known score of each run's task.
        grid: (G,) numbers of evaluations.

    Returns:
        (G,) median relative gap, %; inf before the first score.
    """
    rows = []
    for history, optimum in zip(histories, best, strict=True):
        # The row that is valid at each grid point; -1 before the first score.
        at = np.searchsorted(history[:, 0], grid, side="right") - 1
        score = np.where(at >= 0, history[np.maximum(at, 0), 1], np.inf)
        rows.append(100.0 * (score / optimum - 1.0))
    return np.asarray(np.median(np.array(rows), axis=0))
