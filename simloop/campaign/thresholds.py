"""Thresholds that each cell of a campaign must meet, written as ``name>=value``."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from simloop.campaign.spec import Cell
from simloop.campaign.summary import NUMBERS, cells_of, figure_of, spread
from simloop.campaign.work import OUTCOMES, REACHED, Row
from simloop.common.errors import InputError, did_you_mean

_FORM = re.compile(r"\s*(\w+?)\s*(>=|<=|>|<|==)\s*([-+\d.eE]+)\s*\Z")
_COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt, "==": operator.eq,
}  # fmt: skip
_STATISTICS = ("mean", "p50", "p95", "min", "max")
_RATE, _SUCCESS = "_rate", "success"


@dataclass(frozen=True, slots=True)
class Threshold:
    """A limit for a rate or for a statistic of a figure.

    Attributes:
        name: ``success_rate``, the rate of another outcome (e.g. ``collision_rate``), or a figure
            with a statistic over the successful runs (e.g. ``sim_time_s_p95``).
        sign: One of ``>= <= > < ==``.
        limit: The limit, in the figure's unit; a rate is a share from 0 to 1.
    """

    name: str
    sign: str
    limit: float

    def __str__(self) -> str:
        return f"{self.name} {self.sign} {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a threshold holds in a cell.

    Attributes:
        threshold: The threshold.
        cell: Scenario, planner and sweep.
        value: The measured value. None if there was nothing to measure; then it does not hold.
    """

    threshold: Threshold
    cell: Cell
    value: float | None

    @property
    def holds(self) -> bool:
        """Whether the measured value is within the limit."""
        if self.value is None:
            return False
        return _COMPARE[self.threshold.sign](self.value, self.threshold.limit)

    @property
    def measured(self) -> str:
        """The measured value as text."""
        return "nothing to measure" if self.value is None else f"{self.value:.6g}"


def parse(text: str) -> Threshold:
    """Read a threshold.

    Args:
        text: For example ``success_rate>=0.98``.

    Returns:
        The threshold.

    Raises:
        InputError: If the text is not a threshold, names an unknown outcome or figure, or its limit
            is no possible value.
    """
    form = _FORM.match(text)
    if form is None:
        raise InputError(
            f"--require {text}: not a threshold; write NAME>=VALUE with one of >= <= > < ==, "
            "e.g. success_rate>=0.98 or sim_time_s_p95<=30"
        )
    name, sign, number = form.groups()
    try:
        limit = float(number)
    except ValueError:
        raise InputError(f"--require {text}: {number} is not a number") from None
    if not math.isfinite(limit):
        raise InputError(f"--require {text}: the limit is not finite")
    if name.endswith(_RATE):
        _check_rate(text, name.removesuffix(_RATE))
        if not 0.0 <= limit <= 1.0:
            raise InputError(f"--require {text}: a rate is a share from 0 to 1, not in percent")
    elif name.rpartition("_")[2] not in _STATISTICS:
        statistics = ", ".join(f"_{one}" for one in _STATISTICS)
        raise InputError(
            f"--require {text}: unknown '{name}'; use a rate, such as success_rate, or a column "
            f"with one of {statistics}, such as sim_time_s_p95"
        )
    else:
        _check_figure(text, name.rpartition("_")[0])
    return Threshold(name, sign, limit)


def judge(thresholds: Sequence[Threshold], rows: Sequence[Row]) -> list[Verdict]:
    """Check every threshold in every cell.

    Args:
        thresholds: The thresholds.
        rows: Rows of one campaign.

    Returns:
        The verdicts, cell by cell.
    """
    return [
        Verdict(threshold, cell, _value(threshold.name, mine))
        for cell, mine in cells_of(rows).items()
        for threshold in thresholds
    ]


def to_table(verdict: Verdict) -> dict[str, Any]:
    """Convert a verdict for JSON.

    Args:
        verdict: A verdict.

    Returns:
        Its values by name.
    """
    return {
        "cell": list(verdict.cell),
        "threshold": str(verdict.threshold),
        "value": verdict.value,
        "holds": verdict.holds,
    }


def _value(name: str, rows: Sequence[Row]) -> float | None:
    if name.endswith(_RATE):
        outcome = name.removesuffix(_RATE)
        wanted = REACHED if outcome == _SUCCESS else outcome
        return sum(row["outcome"] == wanted for row in rows) / len(rows)
    figure, _, statistic = name.rpartition("_")
    values = [v for row in rows if row["success"] and (v := figure_of(row, figure)) is not None]
    return spread(values)[statistic] if values else None


def _check_rate(text: str, outcome: str) -> None:
    """Raise InputError for an unknown outcome, whose rate would meet every upper limit."""
    choices = {_SUCCESS, *OUTCOMES}
    if outcome not in choices:
        hint = did_you_mean(f"{outcome}{_RATE}", [f"{one}{_RATE}" for one in choices])
        raise InputError(f"--require {text}: unknown rate '{outcome}{_RATE}'{hint}")


def _check_figure(text: str, figure: str) -> None:
    """Raise InputError for a figure that no run has."""
    choices = {*NUMBERS, "path_ratio"}
    if figure not in choices:
        raise InputError(
            f"--require {text}: unknown figure '{figure}'{did_you_mean(figure, choices)}"
        )
