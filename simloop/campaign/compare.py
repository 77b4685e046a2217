"""Two campaigns side by side: what got significantly better or worse.

Runs are paired by scenario, planner, sweep and seed. Success: McNemar's exact test; figures of runs
that arrived in both: Wilcoxon's signed ranks. All p are corrected together by Holm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from simloop.campaign.summary import FIGURES, Cell, cells_of, figure_of
from simloop.campaign.work import Row
from simloop.common.errors import InputError
from simloop.evaluation.statistics import holm, wilcoxon

_LEVEL = 0.05
_MORE_IS_BETTER = ("success", "min_clearance_m")


@dataclass(frozen=True, slots=True)
class Change:
    """A figure in a cell: its means over the pairs, before and after, and how likely by chance.

    verdict: ``better``, ``worse``, or ``same`` where nothing significant is known.
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
    """All changes. Raises InputError where the two have no run in common."""
    found = []
    others = cells_of(after)
    for cell, rows in cells_of(before).items():
        by_seed = {row["seed"]: row for row in others.get(cell, [])}
        pairs = [(row, by_seed[row["seed"]]) for row in rows if row["seed"] in by_seed]
        found += _of_cell(cell, pairs) if pairs else []
    if not found:
        raise InputError("--compare: the two campaigns have no run in common")
    corrected = holm([p for *_, p in found])
    return [
        Change(cell, name, count, old, new, p, adjusted, _verdict(name, old, new, adjusted))
        for (cell, name, count, old, new, p), adjusted in zip(found, corrected, strict=True)
    ]


def to_table(change: Change) -> dict[str, Any]:
    """For JSON."""
    return asdict(change)


_Raw = tuple[Cell, str, int, float, float, float]


def _of_cell(cell: Cell, pairs: Sequence[tuple[Row, Row]]) -> list[_Raw]:
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
    if not p < _LEVEL or before == after:
        return "same"
    return "better" if (after > before) == (name in _MORE_IS_BETTER) else "worse"
