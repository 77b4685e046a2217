"""Compiled kernels of the tangent graph; see `simloop.planners.reference.exact`.

Circle 0 is the start and circle 1 the goal, both of radius 0. A directed tangent leaves one circle
and reaches another; its sense about a circle is 1 counter-clockwise and -1 clockwise.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

TOUCH_M = 1e-9
"""A tangent may come this much nearer to a circle than its radius, m."""
TURN = 2.0 * math.pi
"""A full turn, rad."""
TAIL, TAIL_SENSE, HEAD, HEAD_SENSE = range(4)
"""Columns of a tangent's ends."""
HEADING, AX, AY, BX, BY = range(5)
"""Columns of a tangent's line: direction, rad, and its first and last point, m."""
_SAME_RAD = 1e-9


@njit(cache=True)
def _meets(
    ax: float, ay: float, bx: float, by: float, square: float, x: float, y: float, r: float
) -> bool:
    """Whether segment a-b, of squared length ``square``, comes into a circle."""
    t = min(max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / square, 0.0), 1.0)
    gap = math.hypot(ax + t * (bx - ax) - x, ay + t * (by - ay) - y) - r
    return gap <= -TOUCH_M


@njit(cache=True)
def _is_free(
    a: FloatArray, centre: FloatArray, radius: FloatArray, bounds: FloatArray, last: int
) -> tuple[bool, int]:
    """Whether a line (5,) crosses no circle and stays within the bounds, and what it crosses.

    Circle ``last`` is tried first: what one line crosses is often crossed by the next as well.
    """
    ax, ay, bx, by = a[AX], a[AY], a[BX], a[BY]
    low_x, low_y = bounds[0] - TOUCH_M, bounds[1] - TOUCH_M
    high_x, high_y = bounds[2] + TOUCH_M, bounds[3] + TOUCH_M
    if min(ax, bx) < low_x or max(ax, bx) > high_x or min(ay, by) < low_y or max(ay, by) > high_y:
        return False, last
    square = max((bx - ax) ** 2 + (by - ay) ** 2, 1e-300)
    if last > 1 and _meets(ax, ay, bx, by, square, centre[last, 0], centre[last, 1], radius[last]):
        return False, last
    for k in range(2, len(radius)):
        if _meets(ax, ay, bx, by, square, centre[k, 0], centre[k, 1], radius[k]):
            return False, k
    return True, last


@njit(cache=True)
def free_tangents(
    centre: FloatArray, radius: FloatArray, bounds: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Compute all directed tangents that cross no circle and stay within the bounds.

    Args:
        centre: (n, 2) centres, m, map frame.
        radius: (n,) radii, m; those of the first two are 0.
        bounds: (4,) x_min, y_min, x_max, y_max, m, map frame.

    Returns:
        (E, 4) circle and sense at the tail and at the head, ascending in circle and sense at the
        tail; (E, 5) direction, rad, first and last point, m, map frame.
    """
    n = len(radius)
    ends, lines = np.empty((4 * n * n, 4), np.int64), np.empty((4 * n * n, 5))
    count, last = 0, -1
    for number in range(4 * n * n):
        i, si = number // (4 * n), 1 if number // (2 * n) % 2 else -1
        j, sj = number // 2 % n, 1 if number % 2 else -1
        # Start and goal are circles of radius 0, so one sense is enough for them. No tangent leads
        # into the start or out of the goal.
        if i == j or i == 1 or j == 0 or (i == 0 and si != 1) or (j == 1 and sj != 1):
            continue
        dx, dy = centre[j, 0] - centre[i, 0], centre[j, 1] - centre[i, 1]
        apart = math.hypot(dx, dy)
        offset = sj * radius[j] - si * radius[i]
        # Nested circles have no tangents, and overlapping circles have no inner tangents.
        if apart <= abs(offset):
            continue
        heading = math.atan2(dy, dx) - math.atan2(offset, math.sqrt(apart**2 - offset**2))
        # A counter-clockwise circle lies to the left of its tangent, so the point is on its right.
        left_x, left_y = -math.sin(heading), math.cos(heading)
        line = lines[count]
        line[HEADING] = heading
        line[AX] = centre[i, 0] - si * radius[i] * left_x
        line[AY] = centre[i, 1] - si * radius[i] * left_y
        line[BX] = centre[j, 0] - sj * radius[j] * left_x
        line[BY] = centre[j, 1] - sj * radius[j] * left_y
        free, last = _is_free(line, centre, radius, bounds, last)
        if free:
            ends[count, TAIL], ends[count, TAIL_SENSE] = i, si
            ends[count, HEAD], ends[count, HEAD_SENSE] = j, sj
            count += 1
    return ends[:count].copy(), lines[:count].copy()


@njit(cache=True)
def _forbidden(
    k: int, centre: FloatArray, radius: FloatArray, bounds: FloatArray, spans: FloatArray
) -> int:
    """Find the spans of circle k in another circle or out of bounds.

    They are written to ``spans`` as middle and half width, rad. Returns their number.
    """
    count = 0
    for j in range(2, len(radius)):
        dx, dy = centre[j, 0] - centre[k, 0], centre[j, 1] - centre[k, 1]
        d = math.hypot(dx, dy)
        if j == k or d >= radius[k] + radius[j]:
            continue
        if d <= radius[j] - radius[k]:
            spans[0, 0], spans[0, 1] = 0.0, math.pi
            return 1
        if d <= radius[k] - radius[j]:
            continue
        # Law of cosines: half the angle between the two intersections.
        cosine = (d * d + radius[k] ** 2 - radius[j] ** 2) / (2.0 * d * radius[k])
        spans[count, 0] = math.atan2(dy, dx)
        spans[count, 1] = math.acos(min(1.0, max(-1.0, cosine)))
        count += 1
    for wall in range(4):
        axis, far = wall % 2, wall < 2
        room = bounds[wall + 2] - centre[k, axis] if far else centre[k, axis] - bounds[axis]
        if room < radius[k]:
            spans[count, 0] = 0.5 * math.pi * axis + (0.0 if far else math.pi)
            spans[count, 1] = math.acos(max(-1.0, room / radius[k]))
            count += 1
    return count


@njit(cache=True)
def _arc_free(spans: FloatArray, count: int, first: float, sense: int, sweep: float) -> bool:
    """Whether an arc from angle ``first`` over ``sweep`` >= 0 in a given sense meets no span."""
    middle = first + 0.5 * sense * sweep
    for s in range(count):
        off = abs((spans[s, 0] - middle + math.pi) % TURN - math.pi)
        if off < spans[s, 1] + 0.5 * sweep - 1e-9:
            return False
    return True


@njit(cache=True)
def sweep_between(before: float, after: float, sense: int) -> float:
    """Compute the angle of the arc between two tangents of a circle.

    Args:
        before: Direction of the tangent that reaches the circle, rad.
        after: Direction of the tangent that leaves it, rad.
        sense: Sense about the circle.

    Returns:
        The angle, rad, from 0 up to a full turn.
    """
    sweep = (sense * (after - before)) % TURN
    # Rounding can turn an arc of no length into a full turn.
    return 0.0 if sweep > TURN - _SAME_RAD else sweep


@njit(cache=True)
def _first_leaving(ends: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Find the ranges of the tangents that leave circle k in sense s, from 2 k + (s > 0) on."""
    first = np.zeros(2 * n + 1, np.int64)
    for e in range(len(ends)):
        first[2 * ends[e, TAIL] + (1 if ends[e, TAIL_SENSE] > 0 else 0) + 1] += 1
    return np.cumsum(first)


@njit(cache=True)
def best_chain(
    ends: NDArray[np.int64],
    lines: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
    bounds: FloatArray,
    length_weight: float,
    turning_weight: float,
) -> tuple[NDArray[np.int64], float]:
    """Find the chain of tangents of least J by Dijkstra's algorithm.

    Args:
        ends: (E, 4) from `free_tangents`.
        lines: (E, 5) from `free_tangents`.
        centre: (n, 2) centres, m, map frame.
        radius: (n,) radii, m.
        bounds: (4,) x_min, y_min, x_max, y_max, m, map frame.
        length_weight: w1, cost of a metre.
        turning_weight: w2, cost of a radian.

    Returns:
        (m,) rows of the tangents from start to goal, and their J; empty and infinite if start and
        goal are not connected.
    """
    count, n = len(ends), len(radius)
    first = _first_leaving(ends, n)
    length = np.hypot(lines[:, BX] - lines[:, AX], lines[:, BY] - lines[:, AY])
    best, parent = np.full(count, np.inf), np.full(count, -1, np.int64)
    spans, known = np.empty((n, n + 4, 2)), np.full(n, -1, np.int64)
    queue = [(0.0, 0)]
    queue.pop()  # the entry has told numba the type
    for e in range(first[1], first[2]):
        best[e] = length_weight * length[e]
        heapq.heappush(queue, (best[e], e))
    while len(queue) > 0:
        cost, e = heapq.heappop(queue)
        if cost > best[e]:
            continue
        k, sense = ends[e, HEAD], ends[e, HEAD_SENSE]
        if k == 1:
            return _chain_to(parent, e), cost
        if known[k] < 0:
            known[k] = _forbidden(k, centre, radius, bounds, spans[k])
        begin = lines[e, HEADING] - 0.5 * sense * math.pi
        leaving = 2 * k + (1 if sense > 0 else 0)
        for f in range(first[leaving], first[leaving + 1]):
            sweep = sweep_between(lines[e, HEADING], lines[f, HEADING], sense)
            total = cost + (length_weight * radius[k] + turning_weight) * sweep
            total += length_weight * length[f]
            if total < best[f] and _arc_free(spans[k], known[k], begin, sense, sweep):
                best[f], parent[f] = total, e
                heapq.heappush(queue, (total, f))
    return np.empty(0, np.int64), np.inf


@njit(cache=True)
def _chain_to(parent: NDArray[np.int64], last: int) -> NDArray[np.int64]:
    """Follow the parents back from the last tangent."""
    count, e = 1, last
    while parent[e] >= 0:
        e = parent[e]
        count += 1
    chain, e = np.empty(count, np.int64), last
    for at in range(count - 1, -1, -1):
        chain[at] = e
        e = parent[e]
    return chain
