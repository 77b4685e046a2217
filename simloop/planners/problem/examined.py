"""The papers' objective: clearance at some points of the path only, one term per obstacle.

Source: Sabiha 2022, Eqs. 8, 16 and 17. Only the points that can change a result are computed; the
result is that of computing all of them, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.flat_problem import Problem, sample_field
from simloop.planners.problem.objective import length_and_turning, length_of, surely_above

_NEAREST_M = 1e-3
_MARGIN_M = 1e-9  # more than the rounding error of a distance
_SHORT_M = 1e-6  # points nearer to each other than this are all computed


@njit(cache=True)
def steepest(p: Problem) -> tuple[float, float]:
    """Compute the greatest slope of the interpolated field along x and along y.

    Between four cells the slope along x is a mean of the differences of two pairs of neighbours,
    so it is nowhere greater than the greatest difference.

    Args:
        p: The problem.

    Returns:
        Both slopes, m/m; zeros without a field.
    """
    rows, cols = p.field.shape
    along_x, along_y = 0.0, 0.0
    for j in range(rows):
        for i in range(cols - 1):
            along_x = max(along_x, abs(float(p.field[j, i + 1]) - float(p.field[j, i])))
    for j in range(rows - 1):
        for i in range(cols):
            along_y = max(along_y, abs(float(p.field[j + 1, i]) - float(p.field[j, i])))
    return along_x * p.per_m, along_y * p.per_m


@njit(cache=True, forceinline=True)
def _term(d: float, delta: float) -> float:
    """Compute R = 1/d - 1/delta of an obstacle at distance d < delta, 1/m."""
    return 1.0 / max(d, _NEAREST_M) - 1.0 / delta


@njit(cache=True)
def _field_penalty(
    p: Problem, path: FloatArray, m: int, examined: int, slope: tuple[float, float], enough: float
) -> float:
    """Compute R in a field, where d is the least clearance and delta the safe distance.

    A point cannot lower d if a neighbour has more clearance than the field can lose on the way.
    """
    d, delta = np.inf, p.safe_m
    least = delta  # what a point must fall below to count
    for i in range(m - 1):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        fall = (abs(dx) * slope[0] + abs(dy) * slope[1]) / (examined + 1)  # from point to point
        n = 1 if i == 0 else 0
        while n <= examined:
            t = n / (examined + 1)
            value = sample_field(p, path[i, 0] + t * dx, path[i, 1] + t * dy)
            if value < least:
                d = least = value
                if _term(d, delta) > enough:
                    return np.inf
            spare = value - least - _MARGIN_M
            n += 1
            if spare >= fall * (examined + 1 - n):
                break
            if spare > fall:
                n += int(spare / fall)
    return _term(d, delta) if d < delta else 0.0


@njit(cache=True, forceinline=True)
def _disc_distance(
    path: FloatArray, m: int, examined: int, x: float, y: float, delta: float
) -> float:
    """Compute the distance from a disc's centre to the nearest examined point, if below ``delta``.

    On each segment these are the points next to the foot of the perpendicular.
    """
    d = np.inf
    for i in range(m - 1):
        ax, ay = path[i, 0], path[i, 1]
        dx, dy = path[i + 1, 0] - ax, path[i + 1, 1] - ay
        square = dx * dx + dy * dy
        foot = ((x - ax) * dx + (y - ay) * dy) / square if square > 0.0 else 0.0
        foot = min(max(foot, 0.0), 1.0)
        ex, ey = x - ax - foot * dx, y - ay - foot * dy
        reach = min(d, delta) + _MARGIN_M
        if ex * ex + ey * ey >= reach * reach:
            continue
        first, last = 0, examined
        if square > (_SHORT_M * (examined + 1)) ** 2:
            near = int(foot * (examined + 1))
            first, last = max(0, near - 1), min(examined, near + 2)
        for n in range(max(first, 1) if i == 0 else first, last + 1):
            t = n / (examined + 1)
            d = min(d, math.hypot(ax + t * dx - x, ay + t * dy - y))
    return d


@njit(cache=True)
def examined_cost(
    p: Problem,
    path: FloatArray,
    m: int,
    bound: float,
    examined: int,
    slope: tuple[float, float],
) -> float:
    """Compute J as in the papers, Eqs. 12, 16, 17; this counts as a trial.

    R = 1/d - 1/delta if d < delta. d is the distance from an obstacle's centre to the nearest
    examined point: the inner waypoints and some points within each segment. A distance field has no
    centres: there d is the least clearance and delta the safe distance.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.
        bound: Value of J above which the exact value does not matter.
        examined: Number of examined points within each segment.
        slope: From `steepest`.

    Returns:
        J, or any value above ``bound`` if J exceeds it.
    """
    p.trials[0] += 1
    if bound < np.inf and p.length_weight * length_of(path, m) > bound:
        return np.inf
    length, turning = length_and_turning(path, m)
    cost = p.length_weight * length + p.turning_weight * turning
    if cost > bound:
        return cost
    enough = surely_above(bound - cost, p.penalty)
    if p.field.size > 0:
        return cost + p.penalty * _field_penalty(p, path, m, examined, slope, enough)
    total = 0.0
    for k in range(p.discs.shape[1]):
        delta = p.discs[2, k] + p.safe_m
        d = _disc_distance(path, m, examined, p.discs[0, k], p.discs[1, k], delta)
        if d < delta:
            total += _term(d, delta)
            if total > enough:
                return np.inf
    return cost + p.penalty * total
