"""An elastic band: a polyline moved away from what it passes, where there is room for it.

The planner asks for the safety distance and no more, so its plans pass everything at just that.
Here each waypoint looks about for a place where its two legs are cheaper: longer by little, and
further than ``preferred`` from all obstacles for more of their length (after Quinlan & Khatib
1993). In a gap too narrow for that the band settles near the middle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.geometry.distance_field import Field, footprint_clearance
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

_STEP_M = 0.04  # between the places where a leg is looked at
_LONG_LEG_M = 0.3  # a leg longer than this that passes something gets a waypoint there
_TURN_M = 0.54  # m that a radian of turning is worth: the planner's w2 / w1
_NEAR = 0.5  # what a metre at the safety distance costs over one at the preferred distance
_TOO_NEAR = 60.0  # and for each metre of clearance that lacks to the safety distance
_STEPS_M = (0.03, 0.015, 0.0075)
_SWEEPS = 2


@njit(cache=True)
def leg_cost(
    a: FloatArray, b: FloatArray, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """m: length of the leg from a to b, both (2,), and what its nearness to obstacles costs."""
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
    back = math.atan2(b[1] - a[1], b[0] - a[0])
    return abs(wrap_angle(math.atan2(c[1] - b[1], c[0] - b[0]) - back))


@njit(cache=True)
def _cost_about(
    band: FloatArray, i: int, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """m: what waypoint ``i`` has a say in: its two legs and the turns at their ends."""
    cost = leg_cost(band[i - 1], band[i], field, offsets, safe, preferred)
    cost += leg_cost(band[i], band[i + 1], field, offsets, safe, preferred)
    for k in range(max(1, i - 1), min(band.shape[0] - 2, i + 1) + 1):
        cost += _TURN_M * _turn(band[k - 1], band[k], band[k + 1])
    return cost


@njit(cache=True)
def _with_points_beside(
    points: FloatArray, field: Field, offsets: FloatArray, preferred: float
) -> FloatArray:
    """The polyline (n, 2), and on each long leg the place where it is nearest to something."""
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
    """(m, 2) the polyline (n, 2) with its inner waypoints where they cost least; its ends stay.

    offsets: (3,) m along the heading, the footprint's discs; safe < preferred: distances of
    their centres from obstacles, m. No step is taken that costs more than it gains.
    """
    band = _with_points_beside(points, field, offsets, preferred)
    for step in _STEPS_M:
        for _ in range(_SWEEPS):
            for i in range(1, band.shape[0] - 1):
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
