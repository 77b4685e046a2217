"""Find the ranges of a log that mean that no echo came back.

A laser reports such a beam as its largest value, e.g. 81.91 m, or 8.19, 31.9 or 50 m by its
settings. So one value near the top of all readings stands out: it is frequent, and few others are
near it. Single readings above it are glitches.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Ranges = NDArray[np.float32]
"""Measured ranges, m."""

_WIDTH = 1e-3  # readings that differ by less are one value: share of the value, or m if larger
_BELOW, _BELOW_M = 0.05, 0.5  # the next lower readings: share of the value, at least these metres
_STANDS_OUT = 0.5  # an error value occurs at least this often, as a share of those readings
_LEAST, _LEAST_SHARE = 4, 1e-5  # and at least so often in all, number and share of all readings
_GLITCHES = 0.05  # readings above an error value, as a share of its number
_MOST_GLITCHES = 1e-3  # the same as a share of all readings
_ALL = 0.98  # a value with this share of all readings may be a round room
_SAMPLE = 4_000_000  # about this many readings are enough
# SICK's LMS sends integers of 13, 14 or 15 bits in mm or cm; the nine largest are error codes.
_SICK = ((8.183, 8.191), (16.375, 16.383), (32.759, 32.767), (81.83, 81.91))


def longest_hit_m(ranges_m: Ranges, stated_m: float = math.inf) -> tuple[float, int]:
    """Find the greatest range that is a hit.

    Args:
        ranges_m: (n, beams); inf where nothing came back.
        stated_m: the laser's maximum range by the log; inf if it states none.

    Returns:
        The limit, m: larger ranges mean that nothing came back, or are wrong. 0 if no reading is a
        hit. And about how many ranges are wrong: larger than the limit, and no error value.
    """
    step = max(1, ranges_m.size // _SAMPLE)
    some = ranges_m[::step]
    readings = np.sort(some[np.isfinite(some)])
    total, wrong = len(readings), 0
    while (found := _error_value(readings, total)) is not None:
        least, above = found
        wrong += above
        readings = readings[:least]
    if math.isfinite(stated_m):
        limit = stated_m - _WIDTH * max(1.0, stated_m)
        hits = int(np.searchsorted(readings, limit, side="right"))
        wrong += len(readings) - hits
        readings = readings[:hits]
    return float(readings[-1]) if len(readings) else 0.0, wrong * step


def _error_value(readings: Ranges, total: int) -> tuple[int, int] | None:
    """Find the greatest error value in sorted readings.

    Returns:
        The index of its first reading, and the number of readings above; None if there is none.
    """
    top = len(readings)
    while top and len(readings) - top <= max(3.0, _MOST_GLITCHES * total):
        value = float(readings[top - 1])
        first = int(np.searchsorted(readings, value - _WIDTH * max(1.0, value), side="right"))
        count, above = top - first, len(readings) - top
        frequent = count >= max(_LEAST, _LEAST_SHARE * total) and above <= _GLITCHES * count
        if frequent and (_is_sicks(value) or _stands_out(readings, first, count, value, total)):
            return first, above
        top = first
    return None


def _is_sicks(value: float) -> bool:
    return any(low - 0.005 <= value <= high + 0.005 for low, high in _SICK)


def _stands_out(readings: Ranges, first: int, count: int, value: float, total: int) -> bool:
    """Return whether a value occurs more often than surfaces would show it."""
    if count >= _ALL * total:
        return False
    near = value - max(_BELOW_M, _BELOW * value)
    below = first - int(np.searchsorted(readings, near, side="left"))
    return count >= _STANDS_OUT * below
