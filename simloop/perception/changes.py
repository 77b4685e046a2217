"""Detect the points of a scan that lie in space that an earlier scan saw free.

An earlier beam towards a static surface hits it, or hits something nearer. So a point well in
front of everything that an earlier scan hit in its direction must have moved there since. The test
compares scans only. It needs no map, and errors of the map do not affect it.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

BINS = 360
"""Number of directions around the laser, one degree each, for which a scan's range is kept."""

_SCANS_BACK = (3, 6, 12, 20)  # ages of the compared scans, in scans; slow obstacles need old ones
_WINDOW_BINS = 2  # number of neighbour bins on either side that must have been free as well
_LASER_SHIFT_M = 0.06  # motion of the laser in one sweep: near points need a wider window
_LEAST_KNOWN_BINS = 3  # with fewer known bins in the window, the earlier scan saw too little
_MARGIN_M = 0.10  # constant part of the distance by which the earlier beam must pass a point
_MARGIN_SHARE = 0.02  # part of that distance that grows with the range, m/m
_FAR_M = 7.0  # farther points are not tested: thin objects fall between the beams


@njit(cache=True)
def _bin(dx: float, dy: float) -> int:
    """Return the bin of the direction (dx, dy)."""
    return int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * BINS) % BINS


@njit(cache=True)
def nearest_ranges(points: FloatArray, laser: FloatArray) -> FloatArray:
    """Reduce a scan to the nearest range in each direction.

    Args:
        points: (n, 2) hits in map, m.
        laser: (2,) the laser's position in map, m.

    Returns:
        (BINS,) distance from ``laser`` to the nearest point of each bin, m; inf where the bin is
        empty, which means that nothing is known there. Bin 0 begins at bearing -pi in map.
    """
    out = np.full(BINS, np.inf)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - laser[0], points[i, 1] - laser[1]
        bearing = _bin(dx, dy)
        out[bearing] = min(out[bearing], math.hypot(dx, dy))
    return out


@njit(cache=True)
def mark_moved(
    points: FloatArray, laser: FloatArray, ranges: FloatArray, moved: NDArray[np.bool_]
) -> None:
    """Mark the points that lie where an earlier scan saw free space.

    Args:
        points: (n, 2) hits of the new scan in map, m.
        laser: (2,) the laser's position in map at the earlier scan, m.
        ranges: (BINS,) the earlier scan's ``nearest_ranges``, m.
        moved: (n,) changed in place: set where a point moved, never cleared.
    """
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - laser[0], points[i, 1] - laser[1]
        far = math.hypot(dx, dy)
        if moved[i] or far > _FAR_M:
            continue
        # The earlier beam must have passed the point clearly, because noise and the error of the
        # pose must not count as motion.
        bearing, needed = _bin(dx, dy), far * (1.0 + _MARGIN_SHARE) + _MARGIN_M
        if not ranges[bearing] > needed:
            continue  # nearly every point is done here, without the search of the window
        # A beam that just misses an edge passes a static object. So the neighbours must have been
        # free too. The window is wider for near points, because the laser itself has moved.
        least, known = np.inf, 0
        window = _WINDOW_BINS + int(_LASER_SHIFT_M / max(far, 0.05) * BINS / (2.0 * math.pi))
        for k in range(-window, window + 1):
            seen = ranges[(bearing + k) % BINS]
            known += np.isfinite(seen)
            least = min(least, seen)
        if known >= _LEAST_KNOWN_BINS and least > needed:
            moved[i] = True


class ChangeDetector:
    """Comparison of each scan with scans of the last two seconds."""

    def __init__(self) -> None:
        self._past: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=max(_SCANS_BACK))

    def reset(self) -> None:
        """Forget all scans. Call this when the pose has jumped: they no longer fit together."""
        self._past.clear()

    def detect(self, points_m: FloatArray, laser_m: FloatArray) -> NDArray[np.bool_]:
        """Compare a scan with the earlier ones, and remember it.

        Args:
            points_m: (n, 2) hits in map.
            laser_m: (2,) the laser's position in map.

        Returns:
            (n,) whether each point lies where an earlier scan saw free space.
        """
        moved = np.zeros(len(points_m), np.bool_)
        for scans_back in _SCANS_BACK:
            if scans_back <= len(self._past):
                mark_moved(points_m, *self._past[-scans_back], moved)
        self._past.append((np.array(laser_m, np.float64), nearest_ranges(points_m, laser_m)))
        return moved
