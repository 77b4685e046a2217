"""Geometry of a walk through a distance field: bounds on a segment, and from cell to cell."""

from __future__ import annotations

import math

from numba import njit

from simloop.geometry.distance_field import FREE_M


@njit(cache=True, forceinline=True)
def lens_bound(a: float, b: float, s: float) -> float:
    """Least possible clearance on a segment of length s whose ends have clearances a and b.

    The two discs about the ends hold no obstacle, so the nearest possible one sits where their
    circles meet; its height over the segment is the bound.
    """
    if a + b <= s:
        return 0.0
    h = (a * a - b * b + s * s) / (2.0 * s)
    if h <= 0.0 or h >= s:
        return min(a, b)
    return math.sqrt(max(0.0, a * a - h * h))


@njit(cache=True, forceinline=True)
def cell_at(u: float, du: float, count: int) -> tuple[int, float, float]:
    """Index of the cell at u that a step of sign du enters, du as the field sees it (0 outside
    the grid, where the field is constant), and how far it is to the cell's edge."""
    edge = 1e-12 if du > 0.0 else -1e-12
    at = u + edge
    if at < 0.0:
        return 0, 0.0, (-u / du if du > 0.0 else FREE_M)
    if at >= count - 1.0:
        return max(count - 2, 0), 0.0, ((count - 1.0 - u) / du if du < 0.0 else FREE_M)
    i = int(at)
    if du > 0.0:
        return i, du, (i + 1.0 - u) / du
    if du < 0.0:
        return i, du, (i - u) / du
    return i, 0.0, FREE_M
