"""Code a polyline as the lines of its segments; these lines are the subjects of the learners.

Waypoints are poor subjects once a path is taut. Every segment of a polygon about an obstacle
touches it. Almost no move of a single waypoint stays clear then, and almost no mixture of the
waypoints of two polygons. A line that rolls about the obstacle stays clear. A learner therefore
stores the differences in heading and offset between its lines and those of the coded path. A line
rolls on the circle that osculates the obstacle, and mixtures of rolled lines are clear again
(exactly so about a round obstacle).

Line i runs from waypoint i to i + 1. With heading t it passes through
centre - (radius + offset) n, where n = (-sin t, cos t) is its left normal. The radius is positive
where the obstacle is on the left. The first line turns about the start, the last one about the
goal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.problem.bends import MAX_POINTS, copy_path
from simloop.planners.problem.clearance import Problem, relaxed_clearance, segment_clearance
from simloop.planners.problem.objective import intrusion

_LARGEST_RADIUS_M = 3.0
_RADIUS_MARGIN = 1.05
_ROLL_SHARE = 0.25
_LEAST_CROSS = 1e-9
_LEAST_SLACK_M = 1e-4
_MOST_SWING_RAD = 0.1
_MOST_SHIFT_M = 0.1
_MOST_SWUNG_RAD = 0.6
_SAMPLES = 12
CORRIDOR_M = 1.0
"""Largest distance of a waypoint from the coded path's waypoint, m."""


class Lines(NamedTuple):
    """A coded path: arrays of `MAX_POINTS`, one entry per line.

    Attributes:
        point: (., 2) the coded waypoints, in map, m.
        centre: (., 2) the point that a line turns or rolls about, in map, m.
        radius: Signed radius of the circle that the line rolls on, m.
        cos: Cosine of the line's coded heading.
        sin: Sine of the line's coded heading.
        turn: Turn from the previous line, rad.
        free: Numbers of the lines that may move, in order.
        spread: (., 2) spread of the random heading and offset of each free line, rad and m.
    """

    point: FloatArray
    centre: FloatArray
    radius: FloatArray
    cos: FloatArray
    sin: FloatArray
    turn: FloatArray
    free: NDArray[np.int32]
    spread: FloatArray


def make_lines() -> Lines:
    """Allocate a coded path of `MAX_POINTS`.

    Returns:
        The arrays, all zero.
    """
    n = MAX_POINTS
    return Lines(
        point=np.zeros((n, 2)),
        centre=np.zeros((n, 2)),
        radius=np.zeros(n),
        cos=np.zeros(n),
        sin=np.zeros(n),
        turn=np.zeros(n),
        free=np.zeros(n, np.int32),
        spread=np.zeros((n, 2)),
    )


@njit(cache=True, forceinline=True)
def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Turn a vector by a small angle, with a fast cosine and sine of accuracy 1e-8."""
    a = angle * angle
    c = 1.0 - 0.5 * a * (1.0 - a / 12.0 * (1.0 - a / 30.0))
    s = angle * (1.0 - a / 6.0 * (1.0 - a / 20.0 * (1.0 - a / 42.0)))
    return c * x - s * y, s * x + c * y


@njit(cache=True)
def decode(
    p: Problem, lines: Lines, subject: FloatArray, free: int, m: int, path: FloatArray
) -> float:
    """Compute the waypoints of a learner.

    Args:
        p: The problem.
        lines: The coded path.
        subject: (>= free, 2) change of each free line's heading and offset, rad and m.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        path: (>= m, 2) receives the waypoints, m.

    Returns:
        The path's turning, rad; negative if the lines do not meet in their order, or meet outside
        the waypoints' box or the corridor.
    """
    path[0, 0], path[0, 1] = p.start_x, p.start_y
    path[m - 1, 0], path[m - 1, 1] = p.goal_x, p.goal_y
    qx, qy, ux, uy = 0.0, 0.0, 0.0, 0.0
    swung_before, turning = 0.0, 0.0
    at = 0
    for i in range(m - 1):
        vx, vy = lines.cos[i], lines.sin[i]
        shift, swung = lines.radius[i], 0.0
        if at < free and lines.free[at] == i:
            swung = subject[at, 0]
            shift += subject[at, 1]
            if abs(swung) > _MOST_SWUNG_RAD:
                return -1.0
            vx, vy = _turned(vx, vy, swung)
            at += 1
        wx = lines.centre[i, 0] + shift * vy
        wy = lines.centre[i, 1] - shift * vx
        if i > 0:  # this line meets the previous one at the waypoint
            turning += abs(lines.turn[i] + swung - swung_before)
            cross = ux * vy - uy * vx
            if abs(cross) < _LEAST_CROSS:
                return -1.0
            t = ((wx - qx) * vy - (wy - qy) * vx) / cross
            x, y = qx + t * ux, qy + t * uy
            # The comparison also refuses a NaN.
            if not (p.low_x <= x <= p.high_x and p.low_y <= y <= p.high_y):
                return -1.0
            if (
                p.discs.shape[1] > 0
                and abs(x - lines.point[i, 0]) + abs(y - lines.point[i, 1]) > CORRIDOR_M
            ):
                return -1.0
            # The lines must meet in their order.
            if (x - path[i - 1, 0]) * ux + (y - path[i - 1, 1]) * uy < 0.0:
                return -1.0
            path[i, 0], path[i, 1] = x, y
        qx, qy, ux, uy, swung_before = wx, wy, vx, vy, swung
    if (p.goal_x - path[m - 2, 0]) * ux + (p.goal_y - path[m - 2, 1]) * uy < 0.0:
        return -1.0
    return turning


@njit(cache=True)
def _contact(p: Problem, a: FloatArray, b: FloatArray) -> float:
    """Find the share (0 to 1) of the way from a to b with the least clearance.

    The search uses samples first, then trisection.
    """
    best, at = np.inf, 0.5
    for k in range(_SAMPLES + 1):
        t = k / _SAMPLES
        clear = relaxed_clearance(p, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))
        if clear < best:
            best, at = clear, t
    low, high = max(0.0, at - 1.0 / _SAMPLES), min(1.0, at + 1.0 / _SAMPLES)
    for _ in range(8):
        third = (high - low) / 3.0
        s, t = low + third, high - third
        near = relaxed_clearance(p, a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]))
        far = relaxed_clearance(p, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))
        if near < far:
            high = t
        else:
            low = s
    return 0.5 * (low + high)


@njit(cache=True)
def _rolled_lack(
    p: Problem, a: FloatArray, b: FloatArray, t: float, angle: float, stack: FloatArray
) -> float:
    """Compute the missing clearance of segment a-b, m, turned by ``angle`` about its share t."""
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = b[0] - a[0], b[1] - a[1]
    ex, ey = c * dx - s * dy, s * dx + c * dy
    x, y = a[0] + t * dx, a[1] + t * dy
    clear = segment_clearance(
        p, x - t * ex, y - t * ey, x + (1.0 - t) * ex, y + (1.0 - t) * ey,
        p.safe_m, -np.inf, stack,
    )  # fmt: skip
    return p.safe_m - clear


@njit(cache=True)
def _lay(p: Problem, path: FloatArray, m: int, lines: Lines) -> None:
    """Write the lines of the path; none of them rolls yet."""
    copy_path(path, m, lines.point)
    for i in range(m - 1):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        length = math.hypot(dx, dy)
        lines.cos[i], lines.sin[i] = dx / length, dy / length
        lines.radius[i] = 0.0
        lines.centre[i, 0], lines.centre[i, 1] = path[i, 0], path[i, 1]
        lines.turn[i] = 0.0
        if i > 0:
            sine = lines.cos[i - 1] * lines.sin[i] - lines.sin[i - 1] * lines.cos[i]
            cosine = lines.cos[i - 1] * lines.cos[i] + lines.sin[i - 1] * lines.sin[i]
            lines.turn[i] = math.atan2(sine, cosine)
    lines.centre[m - 2, 0], lines.centre[m - 2, 1] = p.goal_x, p.goal_y
    lines.turn[m - 1] = 0.0


@njit(cache=True)
def encode(p: Problem, path: FloatArray, m: int, lines: Lines, stack: FloatArray) -> int:
    """Code a path as lines, and decide which lines may move.

    A line without contact may move inwards. A line with a single contact, between two turns to the
    same side, may roll. The condition is that a small turn about the contact costs no more
    clearance than about a circle of modest radius. If the path is not safe, every line may move.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, no two neighbours at the same place, m.
        m: Number of waypoints.
        lines: Receives the coded path.
        stack: Scratch.

    Returns:
        Number of lines that may move.
    """
    _lay(p, path, m, lines)
    free = 0
    lack = intrusion(p, path, m, np.inf, stack)
    for i in range(m - 1):
        a, b = path[i], path[i + 1]
        length = math.hypot(b[0] - a[0], b[1] - a[1])
        t = _contact(p, a, b)
        x, y = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])
        slack = relaxed_clearance(p, x, y) - p.safe_m
        before, after = lines.turn[i], lines.turn[i + 1]
        # Range of swing and shift, from the slack at the line's contact.
        swing, offset = 0.0, 0.0
        if lack > 0.0:
            swing, offset = _MOST_SWING_RAD, min(lack, _MOST_SHIFT_M)
        elif slack > _LEAST_SLACK_M:
            swing, offset = min(0.5 * slack / length, _MOST_SWING_RAD), 0.5 * slack
        if i == 0 or i == m - 2:
            offset = 0.0
        # Between two turns to the same side it may roll on the circle that osculates the obstacle.
        if lack == 0.0 and before * after > 0.0:
            size = _ROLL_SHARE * min(abs(before), abs(after))
            sink = _rolled_lack(p, a, b, t, size, stack)
            sink = max(sink, _rolled_lack(p, a, b, t, -size, stack))
            radius = max(p.safe_m, 2.0 * _RADIUS_MARGIN * sink / size**2)
            if radius < _LARGEST_RADIUS_M:
                swing = size
                lines.radius[i] = radius if before > 0.0 else -radius
                lines.centre[i, 0] = x - lines.radius[i] * lines.sin[i]
                lines.centre[i, 1] = y + lines.radius[i] * lines.cos[i]
        if swing > 0.0:
            lines.free[free] = i
            lines.spread[free, 0], lines.spread[free, 1] = swing, offset
            free += 1
    return free


@njit(cache=True)
def nearby(p: Problem, path: FloatArray, m: int) -> Problem:
    """Drop the discs that no path within `CORRIDOR_M` can come near.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.

    Returns:
        The same problem with fewer discs; it shares the counter of trials.
    """
    keep = np.empty(p.discs.shape[1], np.int64)
    n = 0
    for k in range(p.discs.shape[1]):
        reach = p.discs[2, k] + p.safe_m + p.overhang_m + CORRIDOR_M
        for i in range(m - 1):
            dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
            ox, oy = p.discs[0, k] - path[i, 0], p.discs[1, k] - path[i, 1]
            square = dx * dx + dy * dy
            t = min(max((ox * dx + oy * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            if (ox - t * dx) ** 2 + (oy - t * dy) ** 2 < reach * reach:
                keep[n] = k
                n += 1
                break
    discs = np.empty((3, n))
    for i in range(n):
        discs[:, i] = p.discs[:, keep[i]]
    return Problem(
        discs, p.corners, p.field, p.field_x, p.field_y, p.per_m,
        p.low_x, p.low_y, p.high_x, p.high_y,
        p.start_x, p.start_y, p.start_yaw, p.goal_x, p.goal_y, p.start_slack, p.safe_m,
        p.tolerance_m, p.overstated_m, p.overhang_m, p.length_weight, p.turning_weight,
        p.start_turn_weight, p.penalty, p.trials,
    )  # fmt: skip
