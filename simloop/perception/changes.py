"""What has come to where nothing was: points of a scan in space that an earlier scan saw through.

A surface that has always stood there was met by whoever looked that way, or hidden behind another;
so a point that lies well before all that an earlier scan met in its direction has moved there
since. No map is needed, and a map's own mistakes are not taken over.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_BINS = 360
_AGES = (3, 6, 12, 20)  # scans back: what is slow takes long to leave its place
_WINDOW = 2  # bins on either side that must have been seen through as well
_WANDERS_M = 0.06  # how far the laser goes in one turn: the nearer, the wider the window
_LEAST_KNOWN = 3
_MARGIN_M = 0.10
_MARGIN_SHARE = 0.02  # of the distance
_FAR_M = 7.0  # beyond, things fall between the beams


@njit(cache=True)
def _bin(dx: float, dy: float) -> int:
    """The number of the direction of (dx, dy)."""
    return int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * _BINS) % _BINS


@njit(cache=True)
def reaches(points: FloatArray, centre: FloatArray) -> FloatArray:
    """(bins,) m from ``centre`` (2,) to the nearest of points (n, 2) in each direction; inf where
    there is none: nothing is known there."""
    out = np.full(_BINS, np.inf)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - centre[0], points[i, 1] - centre[1]
        bearing = _bin(dx, dy)
        out[bearing] = min(out[bearing], math.hypot(dx, dy))
    return out


@njit(cache=True)
def seen_through(
    points: FloatArray, centre: FloatArray, reach: FloatArray, moved: NDArray[np.bool_]
) -> None:
    """Mark in ``moved`` (n,) the points (n, 2) before all that ``reach`` met from ``centre``."""
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - centre[0], points[i, 1] - centre[1]
        far = math.hypot(dx, dy)
        if moved[i] or far > _FAR_M:
            continue
        bearing, enough = _bin(dx, dy), far * (1.0 + _MARGIN_SHARE) + _MARGIN_M
        if not reach[bearing] > enough:
            continue  # as mostly, and soon told
        least, known = np.inf, 0
        window = _WINDOW + int(_WANDERS_M / max(far, 0.05) * _BINS / (2.0 * math.pi))
        for k in range(-window, window + 1):
            there = reach[(bearing + k) % _BINS]
            known += np.isfinite(there)
            least = min(least, there)
        if known >= _LEAST_KNOWN and least > enough:
            moved[i] = True


class ChangeDetector:
    """Remembers two seconds of scans."""

    def __init__(self) -> None:
        self._past: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=max(_AGES))

    def forget(self) -> None:
        """The robot stands elsewhere than was thought: all is new, and nothing has changed."""
        self._past.clear()

    def look(self, points_m: FloatArray, centre_m: FloatArray) -> NDArray[np.bool_]:
        """(n,) which of a scan's points (n, 2), cast from ``centre_m`` (2,), both in map, lie where
        nothing was."""
        moved = np.zeros(len(points_m), np.bool_)
        for age in _AGES:
            if age <= len(self._past):
                seen_through(points_m, *self._past[-age], moved)
        self._past.append((np.array(centre_m, np.float64), reaches(points_m, centre_m)))
        return moved
