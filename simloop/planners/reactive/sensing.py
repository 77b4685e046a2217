"""Range sensing of a simulated point robot: where its beams hit, and how far it can move.

The step-by-step planners know only one scan of the world: points on the surfaces within range, and
moving discs. Beams are exact among discs and polygons; in a distance field they use sphere tracing.
All positions are in the map frame, angles in rad counter-clockwise from +x.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.flat_problem import Problem, sample_field
from simloop.planners.reactive.surface import nearest_surface

BEAMS = 360
"""Number of beams in a scan, and of headings in a sweep, per full turn."""
# A field interpolates between cell centres: values below this distance are not reliable.
_TOUCH_CELLS = 0.6
_LEAST_STEP_CELLS = 0.25
_PREDICTED_STEPS = 8
# Range of angles, relative to the present heading and positive to the followed side, in which the
# surface to follow is searched: from a little to the other side to a little past straight behind.
_SIDE_FROM_RAD, _SIDE_TO_RAD = -0.35, 3.3
_FREE_STEPS = 1.5


class LocalView(NamedTuple):
    """The knowledge of a point robot when it chooses one step.

    Attributes:
        points: (n, 2) sensed points on fixed surfaces, m, map frame.
        movers: (k, 5) sensed moving discs: x, y, radius, m, and estimated vx, vy, m per step.
        x: x of the robot, m, map frame.
        y: y of the robot, m, map frame.
        target_x: x of the position that it heads for, m, map frame.
        target_y: y of the position that it heads for, m, map frame.
        safe_m: Distance of its centre from every surface, m.
        step_m: Length of one step, m.
        reach_m: Range of the sensor, m.
        box: (4,) x_min, y_min, x_max, y_max that its centre stays in, m, map frame.
    """

    points: FloatArray
    movers: FloatArray
    x: float
    y: float
    target_x: float
    target_y: float
    safe_m: float
    step_m: float
    reach_m: float
    box: FloatArray


@njit(cache=True, forceinline=True)
def _trace_field(p: Problem, x: float, y: float, ux: float, uy: float, reach: float) -> float:
    """Trace a beam through a distance field by spheres; return its range, ``reach`` for no hit."""
    cell = 1.0 / p.per_m
    t = 0.0
    while t < reach:
        d = sample_field(p, x + t * ux, y + t * uy)
        if d < _TOUCH_CELLS * cell:
            return t
        # No obstacle lies within d, so the beam may jump by d; a minimum keeps it moving at a wall.
        t += max(d, _LEAST_STEP_CELLS * cell)
    return reach


@njit(cache=True, forceinline=True)
def cast_ray(p: Problem, x: float, y: float, ux: float, uy: float, reach: float) -> float:
    """Compute the range from a point along a unit vector to the first obstacle.

    Args:
        p: The planning problem that holds the obstacles.
        x: x of the beam's origin, m, map frame.
        y: y of the beam's origin, m, map frame.
        ux: x of the unit direction.
        uy: y of the unit direction.
        reach: Largest range, m.

    Returns:
        Range, m; ``reach`` if nothing is nearer.
    """
    if p.field.size > 0:
        return _trace_field(p, x, y, ux, uy, reach)
    least = reach
    for k in range(p.discs.shape[1]):
        dx, dy = p.discs[0, k] - x, p.discs[1, k] - y
        along = dx * ux + dy * uy
        # Pythagoras: square of the half chord of the beam's line in the disc.
        room = p.discs[2, k] ** 2 - (dx * dx + dy * dy - along * along)
        if room >= 0.0 and along > 0.0:
            least = min(least, max(along - math.sqrt(room), 0.0))
    first = 0
    while first < p.corners.shape[0]:
        # Corners are stored polygon after polygon; column 2 holds the index after the last one.
        last = int(p.corners[first, 2])
        for i in range(first, last):
            k = i + 1 if i + 1 < last else first
            ex, ey = p.corners[k, 0] - p.corners[i, 0], p.corners[k, 1] - p.corners[i, 1]
            wx, wy = p.corners[i, 0] - x, p.corners[i, 1] - y
            cross = ux * ey - uy * ex
            # A beam parallel to an edge meets the polygon at one of the edge's neighbours.
            if abs(cross) > 1e-12:
                t = (wx * ey - wy * ex) / cross
                s = (wx * uy - wy * ux) / cross
                if t >= 0.0 and 0.0 <= s <= 1.0:
                    least = min(least, t)
        first = last
    return least


@njit(cache=True, forceinline=True)
def _nearest_field_point(p: Problem, x: float, y: float) -> tuple[float, float]:
    """Find the nearest surface point of a distance field, from a point close to it."""
    gap, ux, uy = nearest_surface(p, x, y)
    gap += p.safe_m
    return x - gap * ux, y - gap * uy


@njit(cache=True, forceinline=True)
def distance_to_edge(box: FloatArray, x: float, y: float, ux: float, uy: float) -> float:
    """Compute the distance from a point along a unit vector to the edge of a box.

    Args:
        box: (4,) x_min, y_min, x_max, y_max, m, map frame.
        x: x of the start, m, map frame.
        y: y of the start, m, map frame.
        ux: x of the unit direction.
        uy: y of the unit direction.

    Returns:
        Distance, m; 0 if the point is outside the box and the direction leads away from it.
    """
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
    """Cast a full turn of beams, the first along +x, and collect the points that they hit.

    The bounds are a surface too: a wall lies ``safe`` outside the box of the robot's centre.

    Args:
        p: The planning problem that holds the obstacles.
        x: x of the sensor, m, map frame.
        y: y of the sensor, m, map frame.
        reach: Range of the sensor, m.
        box: (4,) x_min, y_min, x_max, y_max that the robot's centre stays in, m, map frame.
        safe: Distance of the walls from the box, m.
        out: (BEAMS, 2) receives the hit points, m, map frame.

    Returns:
        Number of rows of ``out`` that are filled.
    """
    walls = np.array([box[0] - safe, box[1] - safe, box[2] + safe, box[3] + safe])
    count = 0
    for k in range(BEAMS):
        angle = 2.0 * math.pi * k / BEAMS
        ux, uy = math.cos(angle), math.sin(angle)
        t, edge = cast_ray(p, x, y, ux, uy, reach), distance_to_edge(walls, x, y, ux, uy)
        hit_x, hit_y = x + min(t, edge) * ux, y + min(t, edge) * uy
        # Sphere tracing stops before the surface: project the hit onto it along the gradient.
        if p.field.size > 0 and t < min(edge, reach):
            hit_x, hit_y = _nearest_field_point(p, hit_x, hit_y)
        if min(t, edge) < reach:
            out[count, 0], out[count, 1] = hit_x, hit_y
            count += 1
    return count


@njit(cache=True)
def within(view: LocalView, radius: float) -> LocalView:
    """Return a view with only the points that are not farther from the robot than a radius.

    Args:
        view: What the robot knows.
        radius: The radius, m; a little more is kept, for rounding errors.

    Returns:
        The view with fewer points.
    """
    square = radius * radius * (1.0 + 1e-9)
    near, count = np.empty_like(view.points), 0
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - view.x, view.points[k, 1] - view.y
        if dx * dx + dy * dy <= square:
            near[count, 0], near[count, 1] = view.points[k, 0], view.points[k, 1]
            count += 1
    return LocalView(
        near[:count], view.movers, view.x, view.y, view.target_x, view.target_y,
        view.safe_m, view.step_m, view.reach_m, view.box,
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def free_range(view: LocalView, x: float, y: float, ux: float, uy: float) -> float:
    """Compute how far a disc of radius ``view.safe_m`` can move before it touches a sensed point.

    A point that is already inside the disc blocks only directions that lead nearer to it.

    Args:
        view: What the robot knows.
        x: x of the disc's centre, m, map frame.
        y: y of the disc's centre, m, map frame.
        ux: x of the unit direction.
        uy: y of the unit direction.

    Returns:
        Free distance, m, at most ``view.reach_m``.
    """
    least = view.reach_m
    square = view.safe_m * view.safe_m
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - x, view.points[k, 1] - y
        along = dx * ux + dy * uy
        if along > 0.0:
            room = square - (dx * dx + dy * dy - along * along)
            if room > 0.0:
                least = min(least, max(along - math.sqrt(room), 0.0))
    return min(least, distance_to_edge(view.box, x, y, ux, uy))


@njit(cache=True, forceinline=True)
def nearest_point_distance(view: LocalView, x: float, y: float) -> float:
    """Compute the distance from a point to the nearest sensed fixed surface.

    Args:
        view: What the robot knows.
        x: x of the point, m, map frame.
        y: y of the point, m, map frame.

    Returns:
        Distance, m; ``view.reach_m`` if nothing is nearer.
    """
    least = view.reach_m
    for k in range(view.points.shape[0]):
        least = min(least, math.hypot(view.points[k, 0] - x, view.points[k, 1] - y))
    return least


@njit(cache=True, forceinline=True)
def collision_threat(view: LocalView, vx: float, vy: float) -> float:
    """Compute how strongly a velocity leads into the predicted movers: 0 for no encounter.

    Robot and movers are predicted at constant velocity over `_PREDICTED_STEPS` steps. An encounter
    has more weight if it is sooner or deeper.

    Args:
        view: What the robot knows.
        vx: Robot's velocity, m per step, map frame.
        vy: Robot's velocity, m per step, map frame.

    Returns:
        Threat, from 0 to 2.
    """
    worst = 0.0
    for k in range(view.movers.shape[0]):
        for n in range(1, _PREDICTED_STEPS + 1):
            dx = view.x + n * vx - view.movers[k, 0] - n * view.movers[k, 3]
            dy = view.y + n * vy - view.movers[k, 1] - n * view.movers[k, 4]
            keep = view.movers[k, 2] + view.safe_m
            lack = 1.0 - math.hypot(dx, dy) / keep
            if lack > 0.0:
                worst = max(worst, (1.0 + lack) * (1.0 - (n - 1.0) / _PREDICTED_STEPS))
    return worst


@njit(cache=True, forceinline=True)
def nearest_mover_distance(view: LocalView, x: float, y: float) -> float:
    """Compute the distance from a point to the nearest mover's surface, one step ahead.

    Args:
        view: What the robot knows.
        x: x of the point, m, map frame.
        y: y of the point, m, map frame.

    Returns:
        Distance, m, negative inside a mover; ``view.reach_m`` if nothing is nearer.
    """
    least = view.reach_m
    for k in range(view.movers.shape[0]):
        dx = x - view.movers[k, 0] - view.movers[k, 3]
        dy = y - view.movers[k, 1] - view.movers[k, 4]
        least = min(least, math.hypot(dx, dy) - view.movers[k, 2])
    return least


@njit(cache=True)
def surface_heading(view: LocalView, heading: float, side: int) -> float:
    """Compute the heading that keeps the nearest surface on one side of the robot.

    Args:
        view: What the robot knows.
        heading: The robot's present heading, rad.
        side: Side of the surface: 1 left, -1 right.

    Returns:
        Heading, rad; NaN if no heading is free.
    """
    # Follow the nearest surface on that side of the present heading.
    least, towards = np.inf, heading + side * 0.5 * math.pi
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - view.x, view.points[k, 1] - view.y
        apart = math.hypot(dx, dy)
        if apart < least:
            angle = side * (math.atan2(dy, dx) - heading)
            angle = (angle + 0.5 * math.pi) % (2.0 * math.pi) - 0.5 * math.pi
            if _SIDE_FROM_RAD <= angle <= _SIDE_TO_RAD:
                least, towards = apart, math.atan2(dy, dx)
    # Sweep headings away from the surface: the first free one runs closest along it. A point
    # farther away than the free range plus the disc's radius cannot block one.
    enough = _FREE_STEPS * view.step_m
    near = within(view, enough + view.safe_m)
    for k in range(BEAMS):
        angle = towards - side * 2.0 * math.pi * k / BEAMS
        if free_range(near, view.x, view.y, math.cos(angle), math.sin(angle)) >= enough:
            return angle
    return np.nan


@njit(cache=True)
def easier_side(view: LocalView, bearing: float, enough: float) -> int:
    """Choose the side for an obstacle ahead, so that the robot turns as little as possible.

    Args:
        view: What the robot knows.
        bearing: The blocked bearing, rad.
        enough: Required free range of a heading, m.

    Returns:
        1 to keep the obstacle on the left, -1 to keep it on the right.
    """
    near = within(view, enough + view.safe_m)
    for k in range(BEAMS // 2):
        for side in (1, -1):
            angle = bearing - side * 2.0 * math.pi * k / BEAMS
            if free_range(near, view.x, view.y, math.cos(angle), math.sin(angle)) >= enough:
                return side
    return 1
