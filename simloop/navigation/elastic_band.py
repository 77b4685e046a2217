"""Elastic band: move a polyline away from obstacles where there is room.

The planner requires the safe distance and no more, so its plans pass obstacles at just that
distance. Here each waypoint tries places nearby and moves to where its two legs cost less: they are
a little longer, but more of their length is farther than ``preferred`` from all obstacles (after
Quinlan & Khatib 1993). In a gap that is too narrow for that, the band settles near the middle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.geometry.distance_field import Field, footprint_clearance
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

_STEP_M = 0.04  # distance between the samples of a leg
_LONG_LEG_M = 0.3  # a longer leg that passes an obstacle gets an extra waypoint there
_TURN_M = 0.54  # cost of a turn of 1 rad, m: w2 / w1 of the planner
_NEAR = 0.5  # price of a metre at the safe distance, relative to the preferred distance
_TOO_NEAR = 60.0  # extra price per metre by which the clearance is below the safe distance
_LEAST_ROOM_M = 1e-6  # the price rises over at least this much clearance
_STEPS_M = (0.03, 0.015, 0.0075)
_SWEEPS = 2


@njit(cache=True)
def leg_cost(
    a: FloatArray, b: FloatArray, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """Compute the cost of a leg of the band: its length, plus a price for being near obstacles.

    Args:
        a: (2,) start of the leg, in map, m.
        b: (2,) end of the leg, in map, m.
        field: The distance field.
        offsets: (n,) positions of the footprint's discs along the heading, m.
        safe: Clearance below which the price is very high, m.
        preferred: Clearance from which on the price is zero, m.

    Returns:
        The cost, m.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.hypot(dx, dy)
    if length < 1e-6:
        return 0.0
    yaw, count, near = math.atan2(dy, dx), math.ceil(length / _STEP_M), 0.0
    room = max(preferred - safe, _LEAST_ROOM_M)
    for k in range(count + 1):
        f = k / count
        clear = footprint_clearance(field, a[0] + f * dx, a[1] + f * dy, yaw, offsets)
        if clear < preferred:
            near += _NEAR * (preferred - clear) / room
            near += _TOO_NEAR * max(0.0, safe - clear)
    return length + near * length / (count + 1)


@njit(cache=True)
def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Compute the angle between the legs a-b and b-c, rad."""
    back = math.atan2(b[1] - a[1], b[0] - a[0])
    return abs(wrap_angle(math.atan2(c[1] - b[1], c[0] - b[0]) - back))


@njit(cache=True)
def _cost_about(
    band: FloatArray, i: int, field: Field, offsets: FloatArray, safe: float, preferred: float
) -> float:
    """Compute the cost that waypoint ``i`` affects, m: its two legs and the turns at their ends."""
    cost = leg_cost(band[i - 1], band[i], field, offsets, safe, preferred)
    cost += leg_cost(band[i], band[i + 1], field, offsets, safe, preferred)
    for k in range(max(1, i - 1), min(band.shape[0] - 2, i + 1) + 1):
        cost += _TURN_M * _turn(band[k - 1], band[k], band[k + 1])
    return cost


@njit(cache=True)
def _with_points_beside(
    points: FloatArray, field: Field, offsets: FloatArray, preferred: float
) -> FloatArray:
    """Add a point to each long leg of the polyline (n, 2), where it is nearest to an obstacle."""
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
    """Move the inner waypoints of a polyline to where they cost least; its ends stay in place.

    Args:
        points: (n, 2) the polyline, in map, m.
        field: The distance field.
        offsets: (k,) positions of the footprint's discs along the heading, m.
        safe: Required clearance, m.
        preferred: Clearance to reach where there is room, m; more than ``safe``.

    Returns:
        (m, 2) the band, in map, m. Every step lowers the cost.
    """
    band = _with_points_beside(points, field, offsets, preferred)
    for step in _STEPS_M:
        for _ in range(_SWEEPS):
            for i in range(1, band.shape[0] - 1):
                # Try eight places around the waypoint and keep the best.
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
