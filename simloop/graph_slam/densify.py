"""Fill the gaps between the hits of one scan on one surface.

A laser with a beam each degree leaves 0.17 m between its hits at 10 m, and metres along a wall
that it sees at a grazing angle. In a map of such scans a wall is a row of dots: the next scan's
hits lie between them, and the scan fits best where its dots happen to meet the map's dots.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

_NEAR_M = 0.3  # hits of neighbouring beams no farther apart are on one surface
_FAR_M = 2.0  # farther ones, up to this, if their outer neighbours lie on the same line
_OFF_M, _OFF_SHARE = 0.03, 0.03  # largest distance from this line: constant, and of the gap
_NEIGHBOURS = 1.7  # beams are neighbours if the angle between them is at most so many usual ones


@njit(cache=True)
def densified(
    points: FloatArray, origins: FloatArray, spacing_m: float
) -> tuple[FloatArray, FloatArray]:
    """Add points between the hits of neighbouring beams on one surface.

    Args:
        points: (n, 2) hits in base_link, m, in the order of the beams.
        origins: (n, 2) origin of each beam in base_link, m.
        spacing_m: distance of the added points, m.

    Returns:
        Hits and origins, (m, 2) each: the given ones and the added ones.
    """
    n = points.shape[0]
    if n < 4:
        return points, origins
    bearing, gap = np.empty(n), np.empty(n - 1)
    for i in range(n):
        bearing[i] = math.atan2(points[i, 1] - origins[i, 1], points[i, 0] - origins[i, 0])
    for i in range(n - 1):
        turn = bearing[i + 1] - bearing[i]
        gap[i] = abs((turn + math.pi) % (2.0 * math.pi) - math.pi)
    most = _NEIGHBOURS * np.median(gap)
    added, count = np.empty(n - 1, np.int64), n
    for i in range(n - 1):
        added[i] = 0
        apart = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        if gap[i] > most or apart > _FAR_M:
            continue
        if apart <= _NEAR_M or _on_one_line(points, gap, most, i, apart):
            added[i] = int(apart / spacing_m)
            count += added[i]
    hits, starts = np.empty((count, 2)), np.empty((count, 2))
    hits[:n], starts[:n] = points, origins
    at = n
    for i in range(n - 1):
        for k in range(added[i]):
            share = (k + 1.0) / (added[i] + 1.0)
            hits[at] = points[i] + share * (points[i + 1] - points[i])
            starts[at] = origins[i]
            at += 1
    return hits, starts


@njit(cache=True)
def _on_one_line(points: FloatArray, gap: FloatArray, most: float, i: int, apart: float) -> bool:
    """Return whether the hits before and after the pair i, i + 1 lie on the line through it."""
    nx = -(points[i + 1, 1] - points[i, 1]) / apart
    ny = (points[i + 1, 0] - points[i, 0]) / apart
    off = _OFF_M + _OFF_SHARE * apart
    tested = 0
    for outer, between in ((i - 1, i - 1), (i + 2, i + 1)):
        if 0 <= outer < points.shape[0] and 0 <= between < gap.shape[0] and gap[between] <= most:
            side = (points[outer, 0] - points[i, 0]) * nx + (points[outer, 1] - points[i, 1]) * ny
            if abs(side) > off:
                return False
            tested += 1
    return tested == 2
