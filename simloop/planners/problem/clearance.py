"""How near a path comes to obstacles: among discs in closed form, in a distance field by cells.

Every kernel takes both worlds through one flat `Problem`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.distance_field import FREE_M, interpolate
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.cells import cell_at, lens_bound
from simloop.planners.problem.polygons import flatten_polygons, polygon_clearance

TOLERANCE_M = 1e-6
"""What rounding may take from a clearance that counts as safe, m."""
SAFE_WITHIN_M = 1e-3
"""A plan called safe keeps the safe distance to this, m."""
START_GROWTH = 0.5
"""By how much the clearance asked for grows for each metre away from a start too close, m/m."""
_WALK_CELLS = 3.0
_PIECE_M = 0.005
NO_LENGTH_M = 1e-9
STACK = 64


class Problem(NamedTuple):
    """One planning problem in the flat form that the compiled kernels take.

    discs: (3, K) rows x, y, radius, m, empty where field (rows, cols) float32 is not. corners:
    (N, 3) of convex polygons, see `flatten_polygons`. field_x, field_y: centre of cell (0, 0).
    low, high: box of the waypoints. start_slack: how much of
    the safe distance the start itself lacks, m. trials: (1,), how
    many paths and single segments have been tried so far.
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
    """Flatten a view and a task. start: (3,) x, y, yaw; goal: (2,); both in map.

    The field is used where the view has one, else the discs. Where the start (or the robot's
    front as it stands) is closer than ``safe_m`` to something, the clearance asked for begins
    at what the start has and grows by `START_GROWTH` a metre, so that the robot can leave.
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
    return p.safe_m - here + 1e-6 + START_GROWTH * _PIECE_M if here < p.safe_m else 0.0


@njit(cache=True, forceinline=True)
def _sample_field(p: Problem, x: float, y: float) -> float:
    """Bilinear distance at a point; outside the field that of the nearest point inside."""
    u, v = (x - p.field_x) * p.per_m, (y - p.field_y) * p.per_m
    return interpolate(p.field, u, v, False)


@njit(cache=True)
def point_clearance(p: Problem, x: float, y: float) -> float:
    """Distance from a point to the nearest obstacle's surface, m (negative inside a disc)."""
    if p.field.size > 0:
        return _sample_field(p, x, y)
    clearance = FREE_M
    for k in range(p.discs.shape[1]):
        clearance = min(clearance, math.hypot(x - p.discs[0, k], y - p.discs[1, k]) - p.discs[2, k])
    if p.corners.size > 0:
        clearance = min(clearance, polygon_clearance(p.corners, x, y, x, y))
    return clearance


@njit(cache=True, forceinline=True)
def _allowance(p: Problem, x: float, y: float) -> float:
    """How much less than the safe distance is asked for at a point near a start too close."""
    if p.start_slack <= 0.0:
        return 0.0
    away = math.hypot(x - p.start_x, y - p.start_y) - p.overhang_m
    return max(0.0, p.start_slack - START_GROWTH * max(0.0, away))


@njit(cache=True)
def relaxed_clearance(p: Problem, x: float, y: float) -> float:
    """`point_clearance` plus what is not asked for near a start too close, m."""
    return point_clearance(p, x, y) + _allowance(p, x, y)


@njit(cache=True)
def _walk_cells(
    p: Problem, ax: float, ay: float, ux: float, uy: float, first: float, last: float
) -> float:
    """Exact minimum of the interpolated field (plus allowance) on a + u t, t in [first, last].

    Within a cell the bilinear field is a parabola in t; the walk goes from cell to cell.
    """
    rows, cols = p.field.shape
    worst = FREE_M
    du = ux * p.per_m
    dv = uy * p.per_m
    t = first
    allowed = _allowance(p, ax + ux * t, ay + uy * t)
    while True:
        u = (ax + ux * t - p.field_x) * p.per_m
        v = (ay + uy * t - p.field_y) * p.per_m
        i, u_step, u_exit = cell_at(u, du, cols)
        j, v_step, v_exit = cell_at(v, dv, rows)
        step = min(last - t, u_exit, v_exit)
        i1 = min(i + 1, cols - 1)
        j1 = min(j + 1, rows - 1)
        a = min(max(u - i, 0.0), 1.0)
        b = min(max(v - j, 0.0), 1.0)
        corner = p.field[j, i]
        along_u = p.field[j, i1] - corner
        along_v = p.field[j1, i] - corner
        twist = p.field[j1, i1] - corner - along_u - along_v
        c0 = corner + along_u * a + along_v * b + twist * a * b
        c1 = along_u * u_step + along_v * v_step + twist * (a * v_step + b * u_step)
        c2 = twist * u_step * v_step
        t += step
        # The allowance is all but straight within a cell: it joins the parabola.
        allowed_next = _allowance(p, ax + ux * t, ay + uy * t)
        c0 += allowed
        c1 += (allowed_next - allowed) / step if step > 0.0 else 0.0
        low = min(c0, c0 + step * (c1 + step * c2))
        if c2 > 0.0 and 0.0 < -c1 < 2.0 * c2 * step:
            low = c0 - 0.25 * c1 * c1 / c2
        worst = min(worst, low)
        allowed = allowed_next
        if t >= last - NO_LENGTH_M:
            return worst


@njit(cache=True)
def _field_clearance(
    p: Problem,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    need: float,
    floor: float,
    stack: FloatArray,
) -> float:
    """Clearance of a segment in the field where it falls below ``need``; else a value above.

    Bisects until `lens_bound` proves each piece clear or the piece is so short that `_walk_cells`
    settles it. Returns as soon as something below ``floor`` is found.
    """
    length = math.hypot(bx - ax, by - ay)
    fa = _sample_field(p, ax, ay)
    fb = _sample_field(p, bx, by)
    ga = _allowance(p, ax, ay)
    gb = _allowance(p, bx, by)
    worst = min(fa + ga, fb + gb)
    if length < NO_LENGTH_M or worst < floor:
        return worst
    ux = (bx - ax) / length
    uy = (by - ay) / length
    shortest = _WALK_CELLS / p.per_m
    t = 0.0
    top = 0
    end = length
    while True:
        bound = lens_bound(fa - p.overstated_m, fb - p.overstated_m, end - t) + min(ga, gb)
        if bound >= need or end - t <= shortest or top == STACK - 1:
            if bound < need:
                worst = min(worst, _walk_cells(p, ax, ay, ux, uy, t, end))
            if top == 0 or worst < floor:
                return worst
            top -= 1
            t, fa, ga = end, fb, gb
            end, fb, gb = stack[top, 0], stack[top, 1], stack[top, 2]
        else:
            stack[top, 0], stack[top, 1], stack[top, 2] = end, fb, gb
            top += 1
            end = 0.5 * (t + end)
            fb = _sample_field(p, ax + ux * end, ay + uy * end)
            gb = _allowance(p, ax + ux * end, ay + uy * end)
            worst = min(worst, fb + gb)
            if worst < floor:
                return worst


@njit(cache=True, forceinline=True)
def _disc_clearance(p: Problem, ax: float, ay: float, bx: float, by: float) -> float:
    """Exact clearance of a segment among discs, m (negative where it cuts one)."""
    discs = p.discs
    safe = p.safe_m
    dx = bx - ax
    dy = by - ay
    square = dx * dx + dy * dy
    scale = 1.0 / square if square > 0.0 else 0.0
    clearance = safe
    for k in range(discs.shape[1]):
        ox = discs[0, k] - ax
        oy = discs[1, k] - ay
        t = min(max((ox * dx + oy * dy) * scale, 0.0), 1.0)
        ex = ox - t * dx
        ey = oy - t * dy
        apart = ex * ex + ey * ey
        reach = discs[2, k] + safe
        if apart < reach * reach:  # rare, so that the root is, too
            clearance = min(clearance, math.sqrt(apart) - discs[2, k])
    if p.corners.size > 0:
        clearance = polygon_clearance(p.corners, ax, ay, bx, by, clearance)
    return clearance


@njit(cache=True)
def _disc_clearance_near_start(p: Problem, ax: float, ay: float, bx: float, by: float) -> float:
    """`_disc_clearance` with the allowance about a start too close: piece by piece, each
    piece's allowance that of its worse end (the allowance is concave where it is not zero)."""
    length = math.hypot(bx - ax, by - ay)
    radius = p.overhang_m + p.start_slack / START_GROWTH
    dx = p.start_x - ax
    dy = p.start_y - ay
    along = (dx * (bx - ax) + dy * (by - ay)) / length if length > NO_LENGTH_M else 0.0
    across = dx * dx + dy * dy - along * along
    half = math.sqrt(max(0.0, radius * radius - across))
    first = max(0.0, along - half)
    last = min(length, along + half)
    if length <= NO_LENGTH_M or across >= radius * radius or first >= last:
        return _disc_clearance(p, ax, ay, bx, by)
    ux = (bx - ax) / length
    uy = (by - ay) / length
    worst = p.safe_m
    if first > 0.0:
        worst = min(worst, _disc_clearance(p, ax, ay, ax + ux * first, ay + uy * first))
    if last < length:
        worst = min(worst, _disc_clearance(p, ax + ux * last, ay + uy * last, bx, by))
    pieces = 1 + int((last - first) / _PIECE_M)
    step = (last - first) / pieces
    for k in range(pieces):
        cx = ax + ux * (first + k * step)
        cy = ay + uy * (first + k * step)
        clear = _disc_clearance(p, cx, cy, cx + ux * step, cy + uy * step)
        spare = min(_allowance(p, cx, cy), _allowance(p, cx + ux * step, cy + uy * step))
        worst = min(worst, clear + spare)
    return worst


@njit(cache=True, forceinline=True)
def segment_clearance(
    p: Problem,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    need: float,
    floor: float,
    stack: FloatArray,
) -> float:
    """Clearance of a segment as the objective sees it: overhang and start allowance included.

    Any value >= ``need`` (about safe_m) means safe. ``floor``: see `_field_clearance`.
    """
    if p.overhang_m > 0.0:
        length = math.hypot(bx - ax, by - ay)
        if length > NO_LENGTH_M:
            ex = (bx - ax) / length * p.overhang_m
            ey = (by - ay) / length * p.overhang_m
            if ax != p.start_x or ay != p.start_y:  # the robot already stands at the start
                ax -= ex
                ay -= ey
            bx += ex
            by += ey
    if p.field.size > 0:
        return _field_clearance(p, ax, ay, bx, by, need, floor, stack)
    if p.start_slack > 0.0:
        return _disc_clearance_near_start(p, ax, ay, bx, by)
    return _disc_clearance(p, ax, ay, bx, by)
