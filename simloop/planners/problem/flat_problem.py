"""The flat form of a planning problem, and the clearance of a point in it.

Every kernel takes all kinds of world through one `Problem`. In a distance field the border is
``"edge"``: outside, the value is that of the nearest point inside.
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
"""What rounding may take from a clearance that counts as safe, m."""
SAFE_WITHIN_M = 1e-3
"""A plan called safe keeps the safe distance to this, m."""
START_GROWTH = 0.5
"""Growth of the clearance asked for with the distance from a start that is too close, m/m."""
PIECE_M = 0.005
"""Length of the pieces in which a segment near such a start is judged among discs, m."""
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
        per_m: Cells a metre.
        low_x: Least x of a waypoint, m.
        low_y: Least y of a waypoint, m.
        high_x: Greatest x of a waypoint, m.
        high_y: Greatest y of a waypoint, m.
        start_x: x of the start, m.
        start_y: y of the start, m.
        start_yaw: The robot's heading at the start, rad.
        goal_x: x of the goal, m.
        goal_y: y of the goal, m.
        start_slack: How much of the safe distance the start itself lacks, m.
        safe_m: Distance that is asked for, m; in a field a little more, see ``overstated_m``.
        tolerance_m: What rounding may take from a clearance that counts as safe, m.
        overstated_m: By how much the interpolated field may overstate a distance, m.
        overhang_m: By how much a segment is lengthened at both ends for the footprint, m.
        length_weight: w1 of the objective, 1/m.
        turning_weight: w2 of the objective, 1/rad.
        start_turn_weight: Weight of the turn from the robot's heading to the first segment, 1/rad.
        penalty: sigma of the objective, 1/m.
        trials: (1,) how many paths and single segments have been tried so far.
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

    The field is used if the view has one, else the discs and polygons. The robot may stand closer
    than ``safe_m`` to something, with its middle or its front. The clearance asked for then begins
    with what the start has and grows by `START_GROWTH` a metre, so that the robot can leave.

    Args:
        world: What is known of the obstacles, in map.
        start: (3,) x, y, yaw in map, m, m, rad.
        goal: (2,) x, y in map, m.
        safe_m: Distance that a path has to keep from obstacles, m.
        overhang_m: How far the footprint reaches beyond base_link, along a path, m.
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
    """A problem with the obstacles and bounds of a view; its ends and weights are yet to be set."""
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
    """Discs (3, K), polygons' corners (N, 3) and field; only the field if there is one."""
    field = np.ascontiguousarray(world.distance_m, dtype=np.float32)
    if field.size:
        return np.zeros((3, 0)), flatten_polygons(()), field
    discs = np.asarray(world.discs_xyr_m, dtype=np.float64).reshape(-1, 3)
    # A copy is always writable. Kernels would be compiled a second time for read-only arrays.
    return discs.T.copy(order="C"), flatten_polygons(world.polygons_m), field


def _lack_at_start(p: Problem) -> float:
    """How much of the safe distance the robot lacks where it stands, m; 0 if it lacks nothing."""
    here = min(
        point_clearance(p, p.start_x, p.start_y),
        point_clearance(
            p,
            p.start_x + p.overhang_m * math.cos(p.start_yaw),
            p.start_y + p.overhang_m * math.sin(p.start_yaw),
        ),
    )
    # A hair more than the start lacks, so that rounding, and the pieces in which segments among
    # discs are judged, do not make the start itself unsafe.
    return p.safe_m - here + 1e-6 + START_GROWTH * PIECE_M if here < p.safe_m else 0.0


@njit(cache=True, forceinline=True)
def sample_field(p: Problem, x: float, y: float) -> float:
    """Look the distance field up; outside, the value is that of the nearest point inside.

    Args:
        p: The problem, with a field.
        x: Of the point, in map, m.
        y: Of the point, in map, m.

    Returns:
        The distance, m.
    """
    u, v = (x - p.field_x) * p.per_m, (y - p.field_y) * p.per_m
    return interpolate(p.field, u, v, False)


@njit(cache=True)
def point_clearance(p: Problem, x: float, y: float) -> float:
    """Return the distance from a point to the nearest obstacle.

    Args:
        p: The problem.
        x: Of the point, in map, m.
        y: Of the point, in map, m.

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
    """Return by how much less is asked for at a point near a start that is too close.

    Args:
        p: The problem.
        x: Of the point, in map, m.
        y: Of the point, in map, m.

    Returns:
        The part of the safe distance that is not asked for, m.
    """
    if p.start_slack <= 0.0:
        return 0.0
    away = math.hypot(x - p.start_x, y - p.start_y) - p.overhang_m
    return max(0.0, p.start_slack - START_GROWTH * max(0.0, away))


@njit(cache=True)
def relaxed_clearance(p: Problem, x: float, y: float) -> float:
    """Return a point's clearance plus what is not asked for near a start that is too close.

    Args:
        p: The problem.
        x: Of the point, in map, m.
        y: Of the point, in map, m.

    Returns:
        The clearance that is to be compared with ``p.safe_m``, m.
    """
    return point_clearance(p, x, y) + allowance(p, x, y)
