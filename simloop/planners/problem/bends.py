"""Change the number of waypoints of a polyline: drop useless ones, merge bends, split bends.

In this module ``path`` is an array (>= m, 2). Its first m rows are the polyline, in map, m. A
function that changes the polyline writes into ``path`` and returns the new m. ``stack`` is
scratch from `objective.make_stack`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import Problem, segment_clearance
from simloop.planners.problem.objective import evaluate

MAX_POINTS = 40
"""Largest number of points of a polyline here, both ends included."""
_MOST_MERGED_RAD = 1.2
_MOST_LONGER_M = 0.1
_APART_M = 1e-6


@njit(cache=True)
def is_clear(p: Problem, a: FloatArray, b: FloatArray, stack: FloatArray) -> bool:
    """Tell whether a straight segment keeps the required clearance.

    The test is half a tolerance stricter than the objective, so every part of a clear segment is
    safe as well. It counts as a trial.

    Args:
        p: The problem.
        a: (2,) start of the segment, m.
        b: (2,) end of the segment, m.
        stack: Scratch.

    Returns:
        Whether the segment is clear.
    """
    p.trials[0] += 1
    need = p.safe_m - 0.5 * p.tolerance_m
    return segment_clearance(p, a[0], a[1], b[0], b[1], need, need, stack) >= need


@njit(cache=True)
def copy_path(source: FloatArray, m: int, target: FloatArray) -> None:
    """Copy the first m points of a path without a temporary array.

    Args:
        source: (>= m, 2) the path to copy, m.
        m: Number of points to copy.
        target: (>= m, 2) receives the copy, m.
    """
    for i in range(m):
        target[i, 0] = source[i, 0]
        target[i, 1] = source[i, 1]


@njit(cache=True)
def insert_point(path: FloatArray, m: int, at: int, x: float, y: float) -> int:
    """Insert a point into a path.

    Args:
        path: (> m, 2) the path, m; changed.
        m: Number of points of the path.
        at: Index of the new point.
        x: x of the new point, m.
        y: y of the new point, m.

    Returns:
        The new number of points.
    """
    for k in range(m, at, -1):
        path[k, 0] = path[k - 1, 0]
        path[k, 1] = path[k - 1, 1]
    path[at, 0] = x
    path[at, 1] = y
    return m + 1


@njit(cache=True)
def pull_taut(p: Problem, chain: FloatArray, n: int, route: FloatArray, stack: FloatArray) -> int:
    """Keep the points of a chain that a taut string would touch: each one sees the next.

    The farthest visible point is found by doubling the step, then by bisection.

    Args:
        p: The problem.
        chain: (>= n, 2) the chain, m.
        n: Number of points of the chain.
        route: (MAX_POINTS, 2) receives the points that are kept, m.
        stack: Scratch.

    Returns:
        Number of points that are kept.
    """
    route[0] = chain[0]
    m, here = 1, 0
    while here < n - 1:
        step, seen, blocked = 1, here + 1, n
        while here + step < n:
            step *= 2
            j = min(here + step, n - 1)
            if not is_clear(p, chain[here], chain[j], stack):
                blocked = j
                break
            seen = j
            if j == n - 1:
                break
        while blocked - seen > 1 and seen < n - 1:
            j = (seen + blocked) // 2
            if is_clear(p, chain[here], chain[j], stack):
                seen = j
            else:
                blocked = j
        here = n - 1 if m == MAX_POINTS - 1 else seen
        route[m] = chain[here]
        m += 1
    return m


@njit(cache=True)
def drop_point(path: FloatArray, m: int, at: int) -> int:
    """Remove a point from a path.

    Args:
        path: (>= m, 2) the path, m; changed.
        m: Number of points of the path.
        at: Index of the point.

    Returns:
        The new number of points.
    """
    for k in range(at, m - 1):
        path[k, 0] = path[k + 1, 0]
        path[k, 1] = path[k + 1, 1]
    return m - 1


@njit(cache=True)
def without_twins(path: FloatArray, m: int) -> int:
    """Drop every inner point that coincides with its neighbour.

    Args:
        path: (>= m, 2) the path, m; changed.
        m: Number of points of the path.

    Returns:
        The new number of points.
    """
    i = 1
    while i < m - 1:
        before = math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        after = math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        if before < _APART_M or (i == m - 2 and after < _APART_M):
            m = drop_point(path, m, i)
        else:
            i += 1
    return m


@njit(cache=True)
def _slide(
    p: Problem, here: FloatArray, to: FloatArray, other: FloatArray, stack: FloatArray
) -> None:
    """Move ``here`` towards ``to`` as far as its segment to ``other`` stays clear."""
    x, y = here[0], here[1]
    low, high = 0.0, 1.0
    for _ in range(9):
        t = 0.5 * (low + high)
        here[0] = x + t * (to[0] - x)
        here[1] = y + t * (to[1] - y)
        if is_clear(p, here, other, stack):
            low = t
        else:
            high = t
    here[0] = x + low * (to[0] - x)
    here[1] = y + low * (to[1] - y)


@njit(cache=True)
def merge_bends(p: Problem, path: FloatArray, m: int, stack: FloatArray) -> int:
    """Merge two consecutive bends to the same side: extend their outer lines until they meet.

    This is the inverse of `split_bends`: fewer points with the same tangents.

    Args:
        p: The problem.
        path: (>= m, 2) the path, m; changed.
        m: Number of points of the path.
        stack: Scratch.

    Returns:
        The new number of points.
    """
    meet = np.empty(2)
    i = 1
    while i < m - 2:
        a, b, c, d = path[i - 1], path[i], path[i + 1], path[i + 2]
        ux, uy = b[0] - a[0], b[1] - a[1]
        vx, vy = c[0] - b[0], c[1] - b[1]
        wx, wy = d[0] - c[0], d[1] - c[1]
        first = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
        second = math.atan2(vx * wy - vy * wx, vx * wx + vy * wy)
        cross = ux * wy - uy * wx
        if first * second > 0.0 and abs(first + second) < _MOST_MERGED_RAD and cross != 0.0:
            t = (vx * wy - vy * wx) / cross
            meet[0] = b[0] + t * ux
            meet[1] = b[1] + t * uy
            longer = math.hypot(meet[0] - b[0], meet[1] - b[1])
            longer += math.hypot(meet[0] - c[0], meet[1] - c[1]) - math.hypot(vx, vy)
            inside = p.low_x <= meet[0] <= p.high_x and p.low_y <= meet[1] <= p.high_y
            inside = inside and longer < _MOST_LONGER_M
            if inside and is_clear(p, a, meet, stack) and is_clear(p, meet, d, stack):
                path[i, 0], path[i, 1] = meet[0], meet[1]
                m = drop_point(path, m, i + 1)
                continue
        i += 1
    return m


@njit(cache=True)
def tighten(p: Problem, path: FloatArray, m: int, stack: FloatArray) -> int:
    """Pull a polyline taut in one sweep, with as few points as it needs.

    A point that its neighbours do not need is dropped. Every other point slides along its two
    segments until both touch an obstacle. Only clear moves are made, and each one shortens the
    path.

    Args:
        p: The problem.
        path: (>= m, 2) the path, m; changed.
        m: Number of points of the path.
        stack: Scratch.

    Returns:
        The new number of points.
    """
    m = merge_bends(p, path, m, stack)
    i = 1
    while i < m - 1:
        if is_clear(p, path[i - 1], path[i + 1], stack):
            m = drop_point(path, m, i)
            continue
        _slide(p, path[i], path[i - 1], path[i + 1], stack)
        _slide(p, path[i], path[i + 1], path[i - 1], stack)
        i += 1
    return m


@njit(cache=True)
def refine(
    p: Problem, path: FloatArray, m: int, splits: int, least_turn: float, stack: FloatArray
) -> int:
    """Apply `split_bends` several times.

    Args:
        p: The problem.
        path: (MAX_POINTS, 2) the path, m; changed.
        m: Number of points of the path.
        splits: Number of repetitions.
        least_turn: Turn below which a corner is left alone, rad.
        stack: Scratch.

    Returns:
        The new number of points.
    """
    for _ in range(splits):
        m = split_bends(p, path, m, least_turn, stack)
    return m


@njit(cache=True)
def settle(
    p: Problem, path: FloatArray, m: int, sweeps: int, scratch: FloatArray, stack: FloatArray
) -> tuple[int, float]:
    """Tighten a path up to ``sweeps`` times and keep the version that costs least with split bends.

    The last version need not be the best: a shorter path may turn more, or pass an obstacle on the
    more expensive side.

    Args:
        p: The problem.
        path: (MAX_POINTS, 2) the path, m; receives the best version, its bends not split.
        m: Number of points of the path.
        sweeps: Largest number of sweeps.
        scratch: (2, MAX_POINTS, 2) scratch.
        stack: Scratch.

    Returns:
        The new number of points, and J of the best version with its bends split.
    """
    best, best_m, last = np.inf, m, np.inf
    copy_path(path, m, scratch[0])
    for sweep in range(sweeps + 1):
        if sweep > 0:
            m = tighten(p, scratch[0], m, stack)
        copy_path(scratch[0], m, scratch[1])
        split = refine(p, scratch[1], m, 2, 0.1, stack)
        cost = evaluate(p, scratch[1], split, np.inf, stack)
        if cost < best:
            best, best_m = cost, m
            copy_path(scratch[0], m, path)
        if sweep > 0 and abs(last - cost) < 1e-3 * cost:
            break
        last = cost
    return best_m, best


@njit(cache=True)
def _turn_at(path: FloatArray, i: int) -> float:
    """Compute the unsigned turn of a path at waypoint i, rad."""
    ux = path[i, 0] - path[i - 1, 0]
    uy = path[i, 1] - path[i - 1, 1]
    vx = path[i + 1, 0] - path[i, 0]
    vy = path[i + 1, 1] - path[i, 1]
    return abs(math.atan2(ux * vy - uy * vx, ux * vx + uy * vy))


@njit(cache=True)
def split_bends(p: Problem, path: FloatArray, m: int, least_turn: float, stack: FloatArray) -> int:
    """Cut each corner that turns sharply as deep as the clearance allows.

    The cut is isosceles. About a round obstacle it halves the turn evenly. The shortest polygon
    about a circle has equal turns.

    Args:
        p: The problem.
        path: (MAX_POINTS, 2) the path, m; changed.
        m: Number of points of the path.
        least_turn: Turn below which a corner is left alone, rad.
        stack: Scratch.

    Returns:
        The new number of points.
    """
    a = np.empty(2)
    b = np.empty(2)
    i = 1
    while i < m - 1 and m < MAX_POINTS:
        before = math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        after = math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        if _turn_at(path, i) < least_turn or min(before, after) == 0.0:
            i += 1
            continue
        low, high = 0.0, 0.45 * min(before, after)
        ux = (path[i - 1, 0] - path[i, 0]) / before
        uy = (path[i - 1, 1] - path[i, 1]) / before
        vx = (path[i + 1, 0] - path[i, 0]) / after
        vy = (path[i + 1, 1] - path[i, 1]) / after
        for _ in range(10):
            cut = 0.5 * (low + high)
            a[0], a[1] = path[i, 0] + cut * ux, path[i, 1] + cut * uy
            b[0], b[1] = path[i, 0] + cut * vx, path[i, 1] + cut * vy
            if is_clear(p, a, b, stack):
                low = cut
            else:
                high = cut
        if low > 1e-3:
            x, y = path[i, 0], path[i, 1]
            path[i, 0], path[i, 1] = x + low * ux, y + low * uy
            m = insert_point(path, m, i + 1, x + low * vx, y + low * vy)
            i += 1
        i += 1
    return m
