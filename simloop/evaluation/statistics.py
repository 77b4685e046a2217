"""Whether one planner is better than another, and how soon each comes near the optimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from simloop.messages import FloatArray

TARGETS = (0.1, 0.03, 0.01, 0.003, 0.001)
"""Shares over the best known J that count as reached, for the ECDFs."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """lead against a rival on the same pairs. difference: median of rival - lead; p: two-sided
    Wilcoxon; p_holm: corrected for all the rivals at once."""

    difference: float
    p: float
    p_holm: float
    pairs: int
    lead_wins: int
    rival_wins: int


def holm(p: Sequence[float]) -> list[float]:
    """Holm's step-down correction (1979), in the order given."""
    order, count = np.argsort(p, kind="mergesort"), len(p)
    corrected, most = [0.0] * count, 0.0
    for rank, k in enumerate(order):
        most = max(most, min(1.0, (count - rank) * p[k]))
        corrected[k] = most
    return corrected


def wilcoxon(lead: Sequence[float], rival: Sequence[float]) -> float:
    """Two-sided p of the signed ranks, equal pairs counted in as Pratt (1959) does."""
    apart = np.asarray(rival) - np.asarray(lead)
    if not apart.any():
        return 1.0
    return float(stats.wilcoxon(apart, zero_method="pratt", method="approx").pvalue)


def compare(lead: Sequence[float], rivals: Mapping[str, Sequence[float]]) -> dict[str, Comparison]:
    """The lead's scores against each rival's, paired by position."""
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
    """Evaluations after which the best score is at most ``target``; inf if it never is."""
    hit = np.flatnonzero(history[:, 1] <= target)
    return float(history[hit[0], 0]) if len(hit) else np.inf


def ecdf(
    histories: Sequence[FloatArray],
    best: Sequence[float],
    grid: FloatArray,
    targets: Sequence[float] = TARGETS,
) -> FloatArray:
    """(G,) share of all pairs of run and target reached within grid (G,) evaluations."""
    needed = np.array([
        evaluations_to(history, (1.0 + share) * optimum)
        for history, optimum in zip(histories, best, strict=True)
        for share in targets
    ])  # fmt: skip
    return np.asarray((needed[None] <= np.asarray(grid)[:, None]).mean(axis=1))


def convergence(
    histories: Sequence[FloatArray], best: Sequence[float], grid: FloatArray
) -> FloatArray:
    """(G,) median gap, %, of the best so far at grid (G,) evaluations; inf before a first score."""
    rows = []
    for history, optimum in zip(histories, best, strict=True):
        at = np.searchsorted(history[:, 0], grid, side="right") - 1
        score = np.where(at >= 0, history[np.maximum(at, 0), 1], np.inf)
        rows.append(100.0 * (score / optimum - 1.0))
    return np.asarray(np.median(np.array(rows), axis=0))
