"""One check of the certificate: a measured value, the theoretical value, and the tolerance."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Check:
    """A value of the simulation, compared with theory.

    Attributes:
        group: the check's group in the table.
        name: what was measured, and under which conditions.
        value: the measured value.
        expected: the value of theory.
        error: error of ``value``; relative to ``expected``, or in the value's unit.
        tolerance: largest error that passes.
        unit: unit of ``value`` and ``expected``; empty for ratios.
        informative: whether the check is only a comparison, which cannot fail the certificate.
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
        """Whether the error is within its tolerance. A NaN never is."""
        return self.error <= self.tolerance

    def as_dict(self) -> dict[str, Any]:
        """Collect the check's fields for ``--json``.

        Returns:
            The fields and ``ok``; values that are not finite are None.
        """
        figures = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(self).items()
        }
        return {**figures, "ok": self.ok}


def relative(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """Check a value with a relative tolerance.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the measured value.
        expected: the value of theory, not 0.
        tolerance: largest error over ``expected``.
        unit: unit of the value.

    Returns:
        The check.
    """
    error = abs(value - expected) / abs(expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def absolute(
    group: str, name: str, value: float, expected: float, tolerance: float, unit: str = ""
) -> Check:
    """Check a value with a tolerance in its own unit.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the measured value.
        expected: the value of theory.
        tolerance: largest error, in ``unit``.
        unit: unit of the value.

    Returns:
        The check.
    """
    error = abs(value - expected)
    return Check(group, name, float(value), float(expected), float(error), tolerance, unit)


def at_most(group: str, name: str, value: float, bound: float, unit: str = "") -> Check:
    """Check that a value does not exceed a bound.

    Args:
        group: the check's group in the table.
        name: what was measured.
        value: the measured value.
        bound: its largest allowed value.
        unit: unit of the value.

    Returns:
        The check. Its error is the excess.
    """
    excess = value - bound if value > bound else (0.0 if value <= bound else math.nan)
    return Check(group, name, float(value), bound, excess, 0.0, unit)


def verdict(group: str, name: str, happened: bool, expected: bool) -> Check:
    """Check that something happens, or that it does not.

    Args:
        group: the check's group in the table.
        name: the event.
        happened: whether it happened.
        expected: whether it happens in theory.

    Returns:
        The check. Its values are 1 (yes) and 0 (no).
    """
    return absolute(group, name, float(happened), float(expected), 0.0)
