"""An elastic band: a polyline is moved away from what it passes, where there is room for it.

The planner asks for the safe distance and no more, so its plans pass everything at just that
distance. Here each waypoint tries places nearby where its two legs cost less: a little longer,
but with more of their length farther than ``preferred`` from all obstacles (after Quinlan & Khatib
1993). In a gap that is too narrow for that, the band settles near the middle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.geometry.distance_field import Field, footprint_clearance
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

_STEP_M = 0.04  # between the places where a leg is sampled
_LONG_LEG_M = 0.3  # a leg longer than this that passes something gets a waypoint there
_TURN_M = 0.54  # what a radian of turning costs, m: w2 / w1 of the planner
_NEAR = 0.5  # price of a metre at the safe distance, over one at the preferred distance
_TOO_NEAR = 60.0  # price of each metre of clearance below the safe distance
_STEPS_M = (0.03, 0.015, 0.0075)
_SWEEPS = 2


@njit(cache=True)
def leg_cost(
    a: FloatArray, b: FloatArray, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """Return what a leg of the band costs: its length, and a price for being near obstacles.

    Args:
        a: (2,) where it begins, in map, m.
        b: (2,) where it ends, m.
        field: The distance field.
        offsets: (n,) where the footprint's discs lie along the heading, m.
        safe: Clearance below which a place is very costly, m.
        preferred: Clearance from which on a place costs nothing, m.

    Returns:
        The cost, m.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.hypot(dx, dy)
    if length < 1e-6:
        return 0.0
    yaw, count, near = math.atan2(dy, dx), math.ceil(length / _STEP_M), 0.0
    for k in range(count + 1):
        f = k / count
        clear = footprint_clearance(field, a[0] + f * dx, a[1] + f * dy, yaw, offsets)
        if clear < preferred:
            near += _NEAR * (preferred - clear) / (preferred - safe)
            near += _TOO_NEAR * max(0.0, safe - clear)
    return length + near * length / (count + 1)


@njit(cache=True)
def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Angle between the legs a-b and b-c, rad."""
    back = math.atan2(b[1] - a[1], b[0] - a[0])
    return abs(wrap_angle(math.atan2(c[1] - b[1], c[0] - b[0]) - back))


@njit(cache=True)
def _cost_about(
    band: FloatArray, i: int, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """Cost, m, of what waypoint ``i`` decides: its two legs and the turns at their ends."""
    cost = leg_cost(band[i - 1], band[i], field, offsets, safe, preferred)
    cost += leg_cost(band[i], band[i + 1], field, offsets, safe, preferred)
    for k in range(max(1, i - 1), min(band.shape[0] - 2, i + 1) + 1):
        cost += _TURN_M * _turn(band[k - 1], band[k], band[k + 1])
    return cost


@njit(cache=True)
def _with_points_beside(
    points: FloatArray, field: Field, offsets: FloatArray, preferred: float
) -> FloatArray:
    """The polyline (n, 2) with a point more on each long leg, where an obstacle is nearest."""
    n = points.shape[0]
    out, m = np.empty((2 * n, 2)), 1
    out[0] = points[0]
    for i in range(1, n):
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        length, yaw, least, where = math.hypot(dx, dy), math.atan2(dy, dx), preferred, 0.0
        count = math.ceil(length / _STEP_M)
        for k in range(1, count):
            f = k / count
            if min(f, 1.0 - f) * length < 0.5 * _LONG_LEG_M:
                continue
            clear = footprint_clearance(
                field, points[i - 1, 0] + f * dx, points[i - 1, 1] + f * dy, yaw, offsets
            )
            if clear < least:
                least, where = clear, f
        if where > 0.0:
            out[m, 0] = points[i - 1, 0] + where * dx
            out[m, 1] = points[i - 1, 1] + where * dy
            m += 1
        out[m] = points[i]
        m += 1
    return out[:m].copy()


@njit(cache=True)
def make_room(
    points: FloatArray, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> FloatArray:
    """Move the inner waypoints of a polyline to where they cost least; its ends stay.

    Args:
        points: (n, 2) the polyline, in map, m.
        field: The distance field.
        offsets: (k,) where the footprint's discs lie along the heading, m.
        safe: Clearance that is asked for, m.
        preferred: Clearance that is sought where there is room, m; more than ``safe``.

    Returns:
        (m, 2) the band, m. No step was taken that costs more than it gains.
    """
    band = _with_points_beside(points, field, offsets, preferred)
    for step in _STEPS_M:
        for _ in range(_SWEEPS):
            for i in range(1, band.shape[0] - 1):
                # Try eight places about the waypoint and take the best.
                x, y = band[i, 0], band[i, 1]
                best_x, best_y = x, y
                best = _cost_about(band, i, field, offsets, safe, preferred)
                for k in range(8):
                    angle = 0.25 * math.pi * k
                    band[i, 0] = x + step * math.cos(angle)
                    band[i, 1] = y + step * math.sin(angle)
                    cost = _cost_about(band, i, field, offsets, safe, preferred)
                    if cost < best - 1e-9:
                        best, best_x, best_y = cost, band[i, 0], band[i, 1]
                band[i, 0], band[i, 1] = best_x, best_y
    return band
