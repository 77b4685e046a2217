"""Compare two campaigns and tell what got significantly better or worse.

Runs are paired by scenario, planner, sweep and seed. Success is compared by McNemar's exact test.
Figures are compared by Wilcoxon's signed-rank test over the pairs in which both runs reached the
goal. All p values are corrected together by Holm's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from simloop.campaign.spec import Cell
from simloop.campaign.summary import FIGURES, cells_of, figure_of
from simloop.campaign.work import Row
from simloop.common.errors import InputError
from simloop.evaluation.statistics import holm, wilcoxon

_SIGNIFICANCE = 0.05
_MORE_IS_BETTER = ("success", "min_clearance_m")


@dataclass(frozen=True, slots=True)
class Change:
    """Difference of one figure in one cell.

    Attributes:
        cell: Scenario, planner and sweep.
        figure: ``success`` or one of ``summary.FIGURES``.
        pairs: The number of pairs of runs.
        before: The mean over the pairs in the first campaign.
        after: The mean over the pairs in the second campaign.
        p: The p value of this comparison alone.
        p_holm: The p value, corrected for the number of comparisons.
        verdict: ``better`` or ``worse`` if the difference is significant, else ``same``.
    """

    cell: Cell
    figure: str
    pairs: int
    before: float
    after: float
    p: float
    p_holm: float
    verdict: str


def compare(before: Sequence[Row], after: Sequence[Row]) -> list[Change]:
    """Compare every figure in every cell that both campaigns have.

    Args:
        before: The rows of the first campaign.
        after: The rows of the second campaign.

    Returns:
        One change for each cell and figure, including those with the verdict ``same``.

    Raises:
        InputError: If the two campaigns have no run in common.
    """
    found = []
    others = cells_of(after)
    for cell, rows in cells_of(before).items():
        by_seed = {row["seed"]: row for row in others.get(cell, [])}
        pairs = [(row, by_seed[row["seed"]]) for row in rows if row["seed"] in by_seed]
        found += _of_cell(cell, pairs) if pairs else []
    if not found:
        raise InputError(
            "--compare: the two campaigns have no run in common: no scenario, planner, sweep and "
            "seed occurs in both"
        )
    corrected = holm([p for *_, p in found])
    return [
        Change(cell, name, count, old, new, p, adjusted, _verdict(name, old, new, adjusted))
        for (cell, name, count, old, new, p), adjusted in zip(found, corrected, strict=True)
    ]


def to_table(change: Change) -> dict[str, Any]:
    """Convert a change for JSON.

    Args:
        change: A change.

    Returns:
        Its values by name.
    """
    return asdict(change)


_Raw = tuple[Cell, str, int, float, float, float]


def _of_cell(cell: Cell, pairs: Sequence[tuple[Row, Row]]) -> list[_Raw]:
    """Compute cell, figure, pairs, mean before, mean after and p, for each figure."""
    # McNemar's exact test: among the pairs that differ, is each direction equally likely?
    won = sum(new["success"] and not old["success"] for old, new in pairs)
    lost = sum(old["success"] and not new["success"] for old, new in pairs)
    p = float(binomtest(won, won + lost).pvalue) if won + lost else 1.0
    shares = [float(np.mean([side[k]["success"] for side in pairs])) for k in (0, 1)]
    found: list[_Raw] = [(cell, "success", len(pairs), shares[0], shares[1], p)]
    both = [pair for pair in pairs if pair[0]["success"] and pair[1]["success"]]
    for name in FIGURES:
        values = [(figure_of(old, name), figure_of(new, name)) for old, new in both]
        known = np.array([v for v in values if None not in v], dtype=float).reshape(-1, 2)
        if len(known):
            old_mean, new_mean = known.mean(axis=0).tolist()
            p = wilcoxon(known[:, 0].tolist(), known[:, 1].tolist())
            found.append((cell, name, len(known), old_mean, new_mean, p))
    return found


def _verdict(name: str, before: float, after: float, p: float) -> str:
    if not p < _SIGNIFICANCE or before == after:
        return "same"
    return "better" if (after > before) == (name in _MORE_IS_BETTER) else "worse"
