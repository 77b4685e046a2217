"""Flat form of a planning problem for compiled kernels, and the clearance of a point in it.

One `Problem` holds every kind of world. In a distance field the border is ``"edge"``: outside, the
value is that of the nearest point inside.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.distance_field import FREE_M, interpolate
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.polygons import flatten_polygons, polygon_clearance

TOLERANCE_M = 1e-6
"""Rounding error that a clearance may have and still count as safe, m."""
SAFE_WITHIN_M = 1e-3
"""A plan that is called safe falls short of the safe distance by no more than this, m."""
START_GROWTH = 0.5
"""Growth of the required clearance with the distance from a start that is too close, m/m."""
PIECE_M = 0.005
"""Length of the pieces in which a segment near such a start is checked among discs, m."""
NO_LENGTH_M = 1e-9
"""A segment shorter than this has no direction, m."""


class Problem(NamedTuple):
    """One planning problem in the flat form that the compiled kernels take.

    Attributes:
        discs: (3, K) rows x, y, radius in map, m; empty if there is a field.
        corners: (N, 3) of the convex polygons, see `flatten_polygons`; empty if there is a field.
        field: (rows, cols) float32 [iy, ix] distances at the cells' centres, m; empty if there is
            none.
        field_x: x of the centre of cell (0, 0), m.
        field_y: y of the centre of cell (0, 0), m.
        per_m: Cells per metre.
        low_x: Least x of a waypoint, m.
        low_y: Least y of a waypoint, m.
        high_x: Greatest x of a waypoint, m.
        high_y: Greatest y of a waypoint, m.
        start_x: x of the start, m.
        start_y: y of the start, m.
        start_yaw: The robot's heading at the start, rad.
        goal_x: x of the goal, m.
        goal_y: y of the goal, m.
        start_slack: Clearance that is missing to the safe distance at the start, m.
        safe_m: Required distance, m; in a field a little more, see ``overstated_m``.
        tolerance_m: Rounding error that a clearance may have and still count as safe, m.
        overstated_m: Largest overestimate of a distance by the interpolated field, m.
        overhang_m: Length that is added to a segment at both ends for the footprint, m.
        length_weight: w1 of the objective, 1/m.
        turning_weight: w2 of the objective, 1/rad.
        start_turn_weight: Weight of the turn from the robot's heading to the first segment, 1/rad.
        penalty: sigma of the objective, 1/m.
        trials: (1,) number of paths and single segments that have been tried so far.
    """

    discs: FloatArray
    corners: FloatArray
    field: NDArray[np.float32]
    field_x: float
    field_y: float
    per_m: float
    low_x: float
    low_y: float
    high_x: float
    high_y: float
    start_x: float
    start_y: float
    start_yaw: float
    goal_x: float
    goal_y: float
    start_slack: float
    safe_m: float
    tolerance_m: float
    overstated_m: float
    overhang_m: float
    length_weight: float
    turning_weight: float
    start_turn_weight: float
    penalty: float
    trials: NDArray[np.int64]


def make_problem(
    world: WorldView,
    start: FloatArray,
    goal: FloatArray,
    *,
    safe_m: float,
    overhang_m: float = 0.0,
    length_weight: float = 0.65,
    turning_weight: float = 0.35,
    start_turn_weight: float = 0.0,
    penalty: float = 60.0,
) -> Problem:
    """Flatten a view and a task.

    The field is used if the view has one, else the discs and polygons. The robot's middle or front
    may stand closer than ``safe_m`` to an obstacle. The required clearance then begins with the
    clearance at the start and grows by `START_GROWTH` per metre, so that the robot can leave.

    Args:
        world: What is known of the obstacles, in map.
        start: (3,) x, y, yaw in map, m, m, rad.
        goal: (2,) x, y in map, m.
        safe_m: Distance that a path must keep from obstacles, m.
        overhang_m: Length of the footprint beyond base_link, along a path, m.
        length_weight: w1 of the objective, 1/m.
        turning_weight: w2 of the objective, 1/rad.
        start_turn_weight: Weight of the turn at the start, 1/rad.
        penalty: sigma of the objective, 1/m.

    Returns:
        The problem, with no trials counted.
    """
    problem = _problem_in(world, safe_m)._replace(
        start_x=float(start[0]),
        start_y=float(start[1]),
        start_yaw=float(start[2]),
        goal_x=float(goal[0]),
        goal_y=float(goal[1]),
        overhang_m=float(overhang_m),
        length_weight=float(length_weight),
        turning_weight=float(turning_weight),
        start_turn_weight=float(start_turn_weight),
        penalty=float(penalty),
    )
    return problem._replace(start_slack=_lack_at_start(problem))


def _problem_in(world: WorldView, safe_m: float) -> Problem:
    """Make a problem with the obstacles and bounds of a view, without its ends and weights."""
    discs, corners, field = _obstacles(world)
    resolution = world.resolution_m if field.size else 1.0
    overstated = 0.0
    if field.size:
        # Bilinear interpolation overstates the distance to a corner by up to h^2 / (8 d).
        overstated = resolution**2 / (8.0 * safe_m)
        safe_m += max(0.0, overstated - 0.9 * SAFE_WITHIN_M)
    low_x, low_y, high_x, high_y = (float(bound) for bound in world.bounds_m)
    return Problem(
        discs=discs,
        corners=corners,
        field=field,
        field_x=float(world.origin_m[0]) + 0.5 * resolution,
        field_y=float(world.origin_m[1]) + 0.5 * resolution,
        per_m=1.0 / resolution,
        low_x=low_x,
        low_y=low_y,
        high_x=high_x,
        high_y=high_y,
        start_x=0.0,
        start_y=0.0,
        start_yaw=0.0,
        goal_x=0.0,
        goal_y=0.0,
        start_slack=0.0,
        safe_m=float(safe_m),
        tolerance_m=TOLERANCE_M,
        overstated_m=overstated,
        overhang_m=0.0,
        length_weight=0.0,
        turning_weight=0.0,
        start_turn_weight=0.0,
        penalty=0.0,
        trials=np.zeros(1, np.int64),
    )


def _obstacles(world: WorldView) -> tuple[FloatArray, FloatArray, NDArray[np.float32]]:
    """Return discs (3, K), polygons' corners (N, 3) and field; only the field if there is one."""
    field = np.ascontiguousarray(world.distance_m, dtype=np.float32)
    if field.size:
        return np.zeros((3, 0)), flatten_polygons(()), field
    discs = np.asarray(world.discs_xyr_m, dtype=np.float64).reshape(-1, 3)
    # The copy is always writable, because numba would compile again for read-only arrays.
    return discs.T.copy(order="C"), flatten_polygons(world.polygons_m), field


def _lack_at_start(p: Problem) -> float:
    """Compute the clearance that is missing at the robot's place, m; 0 if nothing is missing."""
    here = min(
        point_clearance(p, p.start_x, p.start_y),
        point_clearance(
            p,
            p.start_x + p.overhang_m * math.cos(p.start_yaw),
            p.start_y + p.overhang_m * math.sin(p.start_yaw),
        ),
    )
    # A little more than is missing: rounding, and the pieces in which segments among discs are
    # checked, must not make the start itself unsafe.
    return p.safe_m - here + 1e-6 + START_GROWTH * PIECE_M if here < p.safe_m else 0.0


@njit(cache=True, forceinline=True)
def sample_field(p: Problem, x: float, y: float) -> float:
    """Interpolate the distance field; outside, the value is that of the nearest point inside.

    Args:
        p: The problem, with a field.
        x: x of the point, in map, m.
        y: y of the point, in map, m.

    Returns:
        The distance, m.
    """
    u, v = (x - p.field_x) * p.per_m, (y - p.field_y) * p.per_m
    return interpolate(p.field, u, v, False)


@njit(cache=True)
def point_clearance(p: Problem, x: float, y: float) -> float:
    """Compute the distance from a point to the nearest obstacle.

    Args:
        p: The problem.
        x: x of the point, in map, m.
        y: y of the point, in map, m.

    Returns:
        The distance to the surface, m; negative inside a disc or a polygon.
    """
    if p.field.size > 0:
        return sample_field(p, x, y)
    clearance = FREE_M
    for k in range(p.discs.shape[1]):
        clearance = min(clearance, math.hypot(x - p.discs[0, k], y - p.discs[1, k]) - p.discs[2, k])
    if p.corners.size > 0:
        clearance = min(clearance, polygon_clearance(p.corners, x, y, x, y))
    return clearance


@njit(cache=True, forceinline=True)
def allowance(p: Problem, x: float, y: float) -> float:
    """Compute the reduction of the required clearance near a start that is too close.

    Args:
        p: The problem.
        x: x of the point, in map, m.
        y: y of the point, in map, m.

    Returns:
        The part of the safe distance that is not required, m.
    """
    if p.start_slack <= 0.0:
        return 0.0
    away = math.hypot(x - p.start_x, y - p.start_y) - p.overhang_m
    return max(0.0, p.start_slack - START_GROWTH * max(0.0, away))


@njit(cache=True)
def relaxed_clearance(p: Problem, x: float, y: float) -> float:
    """Compute a point's clearance plus the allowance near a start that is too close.

    Args:
        p: The problem.
        x: x of the point, in map, m.
        y: y of the point, in map, m.

    Returns:
        The clearance to compare with ``p.safe_m``, m.
    """
    return point_clearance(p, x, y) + allowance(p, x, y)
