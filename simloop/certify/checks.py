"""One check of the certificate: a measured figure, what theory expects, and the tolerance."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Check:
    """A figure of the simulation against what theory expects.

    Attributes:
        group: the check's group in the table.
        name: what was measured, and under which conditions.
        value: the measured figure.
        expected: what theory gives.
        error: of ``value``; relative to ``expected``, or in the figure's unit.
        tolerance: largest error.
        unit: of ``value`` and ``expected``; empty for ratios.
        informative: whether the check is a comparison that does not count.
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
        """Collect what ``--json`` writes.

        Returns:
            The fields and ``ok``; figures that are not finite are None.
        """
        figures = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(self).items()
        }
        return {**figures, "ok": self.ok}


def relative(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """Check a figure to a relative tolerance.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the figure.
        expected: what theory gives, not 0.
        tolerance: largest error over ``expected``.
        unit: of the figure.

    Returns:
        The check.
    """
    error = abs(value - expected) / abs(expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def absolute(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """Check a figure to a tolerance in its own unit.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the figure.
        expected: what theory gives.
        tolerance: largest error, in ``unit``.
        unit: of the figure.

    Returns:
        The check.
    """
    error = abs(value - expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def at_most(group: str, name: str, value: float, bound: float, unit: str = "") -> Check:
    """Check that a figure does not exceed a bound.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the figure.
        bound: its largest value.
        unit: of the figure.

    Returns:
        The check, whose error is the excess.
    """
    excess = value - bound if value > bound else (0.0 if value <= bound else math.nan)
    return Check(group, name, float(value), bound, excess, 0.0, unit)


def verdict(group: str, name: str, happened: bool, expected: bool) -> Check:
    """Check that something happens, or does not.

    Args:
        group: the check's group in the table.
        name: what may happen.
        happened: whether it did.
        expected: whether theory says so.

    Returns:
        The check, of figures 1 and 0.
    """
    return absolute(group, name, float(happened), float(expected), 0.0)
