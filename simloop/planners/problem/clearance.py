"""Clearance of a segment: in closed form among discs, cell by cell in a distance field.

`simloop.planners.problem.flat_problem` defines the problem and the clearance of a point.
"""

from __future__ import annotations

import math

from numba import njit

from simloop.geometry.distance_field import FREE_M
from simloop.messages import FloatArray
from simloop.planners.problem.cells import cell_at, lens_bound
from simloop.planners.problem.flat_problem import (
    NO_LENGTH_M,
    PIECE_M,
    SAFE_WITHIN_M,
    START_GROWTH,
    Problem,
    allowance,
    make_problem,
    point_clearance,
    relaxed_clearance,
    sample_field,
)
from simloop.planners.problem.polygons import polygon_clearance

__all__ = [
    "NO_LENGTH_M",
    "SAFE_WITHIN_M",
    "STACK",
    "START_GROWTH",
    "Problem",
    "make_problem",
    "point_clearance",
    "relaxed_clearance",
    "segment_clearance",
]

_WALK_CELLS = 3.0  # a piece of a segment up to this length is walked cell by cell
STACK = 64
"""Largest number of pieces of a segment that wait for their check."""


@njit(cache=True)
def _walk_cells(
    p: Problem, ax: float, ay: float, ux: float, uy: float, first: float, last: float
) -> float:
    """Compute the exact minimum of the field plus allowance on a + u t, t in [first, last].

    Within a cell the bilinear field is a parabola in t; the walk goes from cell to cell.
    """
    rows, cols = p.field.shape
    worst = FREE_M
    du = ux * p.per_m
    dv = uy * p.per_m
    t = first
    allowed = allowance(p, ax + ux * t, ay + uy * t)
    while True:
        # The cell that the walk enters at t, and the distance to the cell's edge.
        u = (ax + ux * t - p.field_x) * p.per_m
        v = (ay + uy * t - p.field_y) * p.per_m
        i, u_step, u_exit = cell_at(u, du, cols)
        j, v_step, v_exit = cell_at(v, dv, rows)
        step = min(last - t, u_exit, v_exit)
        # The bilinear field along the walk: c0 + c1 s + c2 s^2 from here on.
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
        # The allowance is almost linear within a cell, so it is added to the parabola.
        allowed_next = allowance(p, ax + ux * t, ay + uy * t)
        c0 += allowed
        c1 += (allowed_next - allowed) / step if step > 0.0 else 0.0
        # The minimum lies at an end, or at the vertex if that is inside.
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
    """Compute the clearance of a segment in the field if it is below ``need``; else return more.

    The segment is bisected until `lens_bound` proves each piece clear or the piece is short enough
    for `_walk_cells`. The search ends as soon as a value below ``floor`` is found.
    """
    length = math.hypot(bx - ax, by - ay)
    fa = sample_field(p, ax, ay)
    fb = sample_field(p, bx, by)
    ga = allowance(p, ax, ay)
    gb = allowance(p, bx, by)
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
            # This piece is done: continue with the next waiting one.
            top -= 1
            t, fa, ga = end, fb, gb
            end, fb, gb = stack[top, 0], stack[top, 1], stack[top, 2]
        else:
            # This piece is not decided: halve it and let the farther half wait.
            stack[top, 0], stack[top, 1], stack[top, 2] = end, fb, gb
            top += 1
            end = 0.5 * (t + end)
            fb = sample_field(p, ax + ux * end, ay + uy * end)
            gb = allowance(p, ax + ux * end, ay + uy * end)
            worst = min(worst, fb + gb)
            if worst < floor:
                return worst


@njit(cache=True, forceinline=True)
def _disc_clearance(p: Problem, ax: float, ay: float, bx: float, by: float) -> float:
    """Compute the exact clearance of a segment among discs, m (negative where it cuts one)."""
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
        if apart < reach * reach:  # rarely true, so the root is rarely computed
            clearance = min(clearance, math.sqrt(apart) - discs[2, k])
    if p.corners.size > 0:
        clearance = polygon_clearance(p.corners, ax, ay, bx, by, clearance)
    return clearance


@njit(cache=True)
def _disc_clearance_near_start(p: Problem, ax: float, ay: float, bx: float, by: float) -> float:
    """Compute `_disc_clearance` plus the allowance about a start that is too close, piecewise.

    The allowance is concave where it is not zero. Each piece therefore gets the allowance of its
    worse end.
    """
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
    # The parts of the segment outside the circle with an allowance are judged in one piece each.
    ux = (bx - ax) / length
    uy = (by - ay) / length
    worst = p.safe_m
    if first > 0.0:
        worst = min(worst, _disc_clearance(p, ax, ay, ax + ux * first, ay + uy * first))
    if last < length:
        worst = min(worst, _disc_clearance(p, ax + ux * last, ay + uy * last, bx, by))
    pieces = 1 + int((last - first) / PIECE_M)
    step = (last - first) / pieces
    for k in range(pieces):
        cx = ax + ux * (first + k * step)
        cy = ay + uy * (first + k * step)
        clear = _disc_clearance(p, cx, cy, cx + ux * step, cy + uy * step)
        spare = min(allowance(p, cx, cy), allowance(p, cx + ux * step, cy + uy * step))
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
    """Compute a segment's clearance for the objective, overhang and start allowance included.

    Args:
        p: The problem.
        ax: x of the segment's start, m.
        ay: y of the segment's start, m.
        bx: x of its end, m.
        by: y of its end, m.
        need: Clearance from which on the exact value does not matter (about ``safe_m``), m.
        floor: The search may stop at the first place with less clearance than this, m.
        stack: Scratch from `objective.make_stack`.

    Returns:
        The clearance, m, exact between ``floor`` and ``need``; any value of ``need`` or more means
        safe.
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
