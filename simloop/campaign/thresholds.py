"""What a campaign must hold, as ``name>=value``, in each of its cells."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from simloop.campaign.summary import Cell, cells_of, figure_of, spread
from simloop.campaign.work import Row
from simloop.common.errors import InputError, did_you_mean
from simloop.evaluation.referee import Outcome

_FORM = re.compile(r"\s*(\w+?)\s*(>=|<=|>|<|==)\s*([-+\d.eE]+)\s*\Z")
_COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt, "==": operator.eq,
}  # fmt: skip
_STATISTICS = ("mean", "p50", "p95", "min", "max")
_SUFFIX = "_rate"


@dataclass(frozen=True, slots=True)
class Threshold:
    """name: success_rate, the rate of any other outcome (collision_rate, ...), or a figure with
    its statistic (sim_time_s_p95), over the runs that arrived."""

    name: str
    sign: str
    limit: float

    def __str__(self) -> str:
        return f"{self.name} {self.sign} {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A threshold in a cell. value: None where there is nothing to measure: it does not hold."""

    threshold: Threshold
    cell: Cell
    value: float | None

    @property
    def holds(self) -> bool:
        """Whether it is kept."""
        if self.value is None:
            return False
        return _COMPARE[self.threshold.sign](self.value, self.threshold.limit)


def parse(text: str) -> Threshold:
    """Raises InputError for what is not a threshold."""
    form = _FORM.match(text)
    if form is None:
        raise InputError(f"--require {text}: write e.g. success_rate>=0.98 or sim_time_s_p95<=30")
    name, sign, number = form.groups()
    try:
        limit = float(number)
    except ValueError:
        raise InputError(f"--require {text}: {number} is not a number") from None
    if not name.endswith(_SUFFIX) and name.rpartition("_")[2] not in _STATISTICS:
        choices = [f"{name}_{one}" for one in _STATISTICS]
        raise InputError(f"--require {text}: say which of {', '.join(choices)}, or a rate")
    return Threshold(name, sign, limit)


def judge(thresholds: Sequence[Threshold], rows: Sequence[Row]) -> list[Verdict]:
    """Every threshold in every cell. Raises InputError for a figure that no row has."""
    for threshold in thresholds:
        if not threshold.name.endswith(_SUFFIX):
            _check_figure(threshold, rows)
    return [
        Verdict(threshold, cell, _value(threshold.name, mine))
        for cell, mine in cells_of(rows).items()
        for threshold in thresholds
    ]


def _value(name: str, rows: Sequence[Row]) -> float | None:
    if name.endswith(_SUFFIX):
        outcome = name.removesuffix(_SUFFIX)
        wanted = Outcome.REACHED if outcome == "success" else outcome
        return sum(row["outcome"] == wanted for row in rows) / len(rows)
    figure, _, statistic = name.rpartition("_")
    values = [v for row in rows if row["success"] and (v := figure_of(row, figure)) is not None]
    return spread(values)[statistic] if values else None


def _check_figure(threshold: Threshold, rows: Sequence[Row]) -> None:
    figure = threshold.name.rpartition("_")[0]
    known = {name for row in rows for name in row if figure_of(row, name) is not None}
    if any(row["success"] for row in rows) and figure not in known | {"path_ratio"}:
        hint = did_you_mean(figure, known)
        raise InputError(f"--require {threshold}: no figure '{figure}'{hint}")
