"""One check of the certificate: a figure, what theory says of it, and how far apart they may be."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Check:
    """error: relative to ``expected``, or absolute where that is 0 or ``absolute`` asked for it.

    informative rows stand beside the others for comparison and count for nothing.
    """

    group: str
    name: str
    value: float
    expected: float
    error: float
    tolerance: float
    unit: str = ""
    informative: bool = False

    @property
    def ok(self) -> bool:
        """Whether the error is within its tolerance; a NaN never is."""
        return self.error <= self.tolerance

    def as_dict(self) -> dict[str, Any]:
        """As ``--json`` writes it; a figure that is no number is null."""
        figures = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(self).items()
        }
        return {**figures, "ok": self.ok}


def relative(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """A figure that must equal ``expected`` to a share of it."""
    error = abs(value - expected) / abs(expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def absolute(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """A figure that must equal ``expected`` to a tolerance in its own unit."""
    error = abs(value - expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def at_most(group: str, name: str, value: float, bound: float, unit: str = "") -> Check:
    """A figure that must not exceed a bound; its error is by how much it does."""
    excess = value - bound if value > bound else (0.0 if value <= bound else math.nan)
    return Check(group, name, float(value), bound, excess, 0.0, unit)


def verdict(group: str, name: str, happened: bool, expected: bool) -> Check:
    """Something that must happen, or must not: 1 and 0."""
    return absolute(group, name, float(happened), float(expected), 0.0)
