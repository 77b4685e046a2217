"""What a point robot senses around it: where rays meet something, and how far it may go.

A scan is all that the step-by-step planners know of the world: points on surfaces within reach, and
discs that move. Casting is exact among discs and polygons and by sphere tracing in a distance
field.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import Problem, point_clearance
from simloop.planners.reactive.rollout import surface

BEAMS = 360
_TOUCH_CELLS = 0.6  # nearer than this a field is not what its obstacles' surfaces are
_LEAST_STEP_CELLS = 0.25
_AHEAD_STEPS = 8


class Look(NamedTuple):
    """What one step is chosen from; lengths in m, velocities in m a step.

    points: (n, 2) sensed surfaces, fixed; movers: (k, 5) x, y, radius, vx, vy as estimated. x, y:
    the robot; target: where it heads for. safe: what it keeps from everything, step: how far it
    goes, reach: how far it sees. box: (4,) x_min, y_min, x_max, y_max.
    """

    points: FloatArray
    movers: FloatArray
    x: float
    y: float
    target_x: float
    target_y: float
    safe: float
    step: float
    reach: float
    box: FloatArray


@njit(cache=True)
def _march(p: Problem, x: float, y: float, ux: float, uy: float, reach: float) -> float:
    """Range in a distance field; ``reach`` where nothing is met."""
    cell = 1.0 / p.per_m
    t = 0.0
    while t < reach:
        d = point_clearance(p, x + t * ux, y + t * uy)
        if d < _TOUCH_CELLS * cell:
            return t
        t += max(d, _LEAST_STEP_CELLS * cell)
    return reach


@njit(cache=True)
def cast(p: Problem, x: float, y: float, ux: float, uy: float, reach: float) -> float:
    """Range from a point along a unit vector to the first surface, m; ``reach`` for none."""
    if p.field.size > 0:
        return _march(p, x, y, ux, uy, reach)
    least = reach
    for k in range(p.discs.shape[1]):
        dx, dy = p.discs[0, k] - x, p.discs[1, k] - y
        along = dx * ux + dy * uy
        room = p.discs[2, k] ** 2 - (dx * dx + dy * dy - along * along)
        if room >= 0.0 and along > 0.0:
            least = min(least, max(along - math.sqrt(room), 0.0))
    first = 0
    while first < p.corners.shape[0]:
        last = int(p.corners[first, 2])
        for i in range(first, last):
            k = i + 1 if i + 1 < last else first
            ex, ey = p.corners[k, 0] - p.corners[i, 0], p.corners[k, 1] - p.corners[i, 1]
            wx, wy = p.corners[i, 0] - x, p.corners[i, 1] - y
            cross = ux * ey - uy * ex
            if abs(cross) > 1e-12:
                t = (wx * ey - wy * ex) / cross
                s = (wx * uy - wy * ux) / cross
                if t >= 0.0 and 0.0 <= s <= 1.0:
                    least = min(least, t)
        first = last
    return least


@njit(cache=True)
def _foot(p: Problem, x: float, y: float) -> tuple[float, float]:
    """The point of a field's nearest surface, seen from close by."""
    gap, ux, uy = surface(p, x, y)
    gap += p.safe_m
    return x - gap * ux, y - gap * uy


@njit(cache=True)
def to_edge(box: FloatArray, x: float, y: float, ux: float, uy: float) -> float:
    """How far it is from a point along a unit vector to the edge of a box, m; 0 outside."""
    least = np.inf
    for at, u, low, high in ((x, ux, box[0], box[2]), (y, uy, box[1], box[3])):
        if u > 1e-12:
            least = min(least, max((high - at) / u, 0.0))
        elif u < -1e-12:
            least = min(least, max((low - at) / u, 0.0))
    return least


@njit(cache=True)
def scan(
    p: Problem, x: float, y: float, reach: float, box: FloatArray, safe: float, out: FloatArray
) -> int:
    """Cast a full turn of beams, the first along +x; out: (BEAMS, 2) takes the points met. How
    many. The bounds are a surface too, ``safe`` outside the box that the robot's centre keeps to.
    """
    walls = np.array([box[0] - safe, box[1] - safe, box[2] + safe, box[3] + safe])
    count = 0
    for k in range(BEAMS):
        angle = 2.0 * math.pi * k / BEAMS
        ux, uy = math.cos(angle), math.sin(angle)
        t, edge = cast(p, x, y, ux, uy, reach), to_edge(walls, x, y, ux, uy)
        met_x, met_y = x + min(t, edge) * ux, y + min(t, edge) * uy
        if p.field.size > 0 and t < min(edge, reach):
            met_x, met_y = _foot(p, met_x, met_y)
        if min(t, edge) < reach:
            out[count, 0], out[count, 1] = met_x, met_y
            count += 1
    return count


@njit(cache=True)
def free_range(look: Look, x: float, y: float, ux: float, uy: float) -> float:
    """How far a disc of radius ``look.safe`` can go from (x, y) along (ux, uy), at most ``reach``.

    What it is too close to already stops it only where it would come nearer.
    """
    least = look.reach
    square = look.safe * look.safe
    for k in range(look.points.shape[0]):
        dx, dy = look.points[k, 0] - x, look.points[k, 1] - y
        along = dx * ux + dy * uy
        if along > 0.0:
            room = square - (dx * dx + dy * dy - along * along)
            if room > 0.0:
                least = min(least, max(along - math.sqrt(room), 0.0))
    return min(least, to_edge(look.box, x, y, ux, uy))


@njit(cache=True)
def nearest_point(look: Look, x: float, y: float) -> float:
    """Distance from (x, y) to the nearest sensed surface, m; ``reach`` where there is none."""
    least = look.reach
    for k in range(look.points.shape[0]):
        least = min(least, math.hypot(look.points[k, 0] - x, look.points[k, 1] - y))
    return least


@njit(cache=True)
def threat(look: Look, vx: float, vy: float) -> float:
    """How badly a velocity, m a step, runs into what moves: 0 where it does not within the steps
    looked ahead; the sooner and the deeper, the more."""
    worst = 0.0
    for k in range(look.movers.shape[0]):
        for n in range(1, _AHEAD_STEPS + 1):
            dx = look.x + n * vx - look.movers[k, 0] - n * look.movers[k, 3]
            dy = look.y + n * vy - look.movers[k, 1] - n * look.movers[k, 4]
            keep = look.movers[k, 2] + look.safe
            lack = 1.0 - math.hypot(dx, dy) / keep
            if lack > 0.0:
                worst = max(worst, (1.0 + lack) * (1.0 - (n - 1.0) / _AHEAD_STEPS))
    return worst


@njit(cache=True)
def nearest_mover(look: Look, x: float, y: float) -> float:
    """Distance from (x, y) to the nearest mover's surface where it will be in a step, m."""
    least = look.reach
    for k in range(look.movers.shape[0]):
        dx = x - look.movers[k, 0] - look.movers[k, 3]
        dy = y - look.movers[k, 1] - look.movers[k, 4]
        least = min(least, math.hypot(dx, dy) - look.movers[k, 2])
    return least


@njit(cache=True)
def wall_heading(look: Look, heading: float, side: int) -> float:
    """Where to go to keep the surface on one's left (side 1) or right (-1), rad; NaN: nowhere.

    From the nearest surface on that side of ``heading`` the headings are swept away from it; the
    first that is free for a step and a half is the one.
    """
    least, towards = np.inf, heading + side * 0.5 * math.pi
    for k in range(look.points.shape[0]):
        dx, dy = look.points[k, 0] - look.x, look.points[k, 1] - look.y
        apart = math.hypot(dx, dy)
        if apart < least:
            angle = side * (math.atan2(dy, dx) - heading)
            angle = (angle + 0.5 * math.pi) % (2.0 * math.pi) - 0.5 * math.pi
            if -0.35 <= angle <= 3.3:
                least, towards = apart, math.atan2(dy, dx)
    for k in range(BEAMS):
        angle = towards - side * 2.0 * math.pi * k / BEAMS
        if free_range(look, look.x, look.y, math.cos(angle), math.sin(angle)) >= 1.5 * look.step:
            return angle
    return np.nan


@njit(cache=True)
def easier_side(look: Look, bearing: float, enough: float) -> int:
    """On which side to keep what blocks ``bearing``: 1 left, -1 right, so as to turn least."""
    for k in range(BEAMS // 2):
        for side in (1, -1):
            angle = bearing - side * 2.0 * math.pi * k / BEAMS
            if free_range(look, look.x, look.y, math.cos(angle), math.sin(angle)) >= enough:
                return side
    return 1
