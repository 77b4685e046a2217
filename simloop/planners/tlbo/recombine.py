"""Best mixture of several routes: a search over the waypoints of all of them.

Two routes that differ in two places leave two more combinations to try. The waypoints of all routes
and the clear segments between any two of them make a small graph. The state of the search is a
directed segment, so that turning counts as in the objective. The search is A* with the straight
distance to the goal as its heuristic.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.bends import MAX_POINTS, is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.tlbo.routes import IntArray

_MOST_NODES = 120
_ALIKE_M = 0.04
_UNKNOWN, _CLEAR, _BLOCKED = 0, 1, 2


@njit(cache=True)
def _gather(p: Problem, routes: FloatArray, counts: IntArray, found: int, nodes: FloatArray) -> int:
    """Collect the start, the goal, then the inner waypoints of all routes; return their number.

    A waypoint that nearly coincides with an earlier one is left out.
    """
    nodes[0, 0], nodes[0, 1] = p.start_x, p.start_y
    nodes[1, 0], nodes[1, 1] = p.goal_x, p.goal_y
    n = 2
    for r in range(found):
        for i in range(1, counts[r] - 1):
            x, y = routes[r, i, 0], routes[r, i, 1]
            twin = n >= _MOST_NODES
            k = 0
            while not twin and k < n:
                twin = abs(nodes[k, 0] - x) + abs(nodes[k, 1] - y) < _ALIKE_M
                k += 1
            if not twin:
                nodes[n, 0], nodes[n, 1] = x, y
                n += 1
    return n


@njit(cache=True)
def _distances(nodes: FloatArray, n: int) -> FloatArray:
    """Compute the (n, n) distances between any two of the first n nodes, m."""
    apart = np.empty((n, n))
    for u in range(n):
        for v in range(n):
            apart[u, v] = math.hypot(nodes[u, 0] - nodes[v, 0], nodes[u, 1] - nodes[v, 1])
    return apart


@njit(cache=True, forceinline=True)
def _turn(nodes: FloatArray, u: int, v: int, w: int) -> float:
    """Compute the unsigned turn at node v on the way u -> v -> w, rad."""
    ux, uy = nodes[v, 0] - nodes[u, 0], nodes[v, 1] - nodes[u, 1]
    wx, wy = nodes[w, 0] - nodes[v, 0], nodes[w, 1] - nodes[v, 1]
    return abs(math.atan2(ux * wy - uy * wx, ux * wx + uy * wy))


@njit(cache=True)
def recombine(
    p: Problem,
    routes: FloatArray,
    counts: IntArray,
    found: int,
    bound: float,
    out: FloatArray,
    stack: FloatArray,
) -> int:
    """Find the best mixture of routes that costs less than a bound.

    Args:
        p: The problem.
        routes: (>= found, MAX_POINTS, 2) waypoints, m.
        counts: (>= found,) number of waypoints of each route.
        found: Number of routes.
        bound: The mixture must cost less than this.
        out: (MAX_POINTS, 2) receives the mixture, m.
        stack: Scratch.

    Returns:
        Number of points of the mixture; 0 if there is none.
    """
    nodes = np.empty((_MOST_NODES, 2))
    n = _gather(p, routes, counts, found, nodes)
    apart = _distances(nodes, n)
    sight = np.zeros((n, n), np.uint8)
    best = np.full(n * n, np.inf)
    parent = np.full(n * n, -1, np.int32)
    done = np.zeros(n * n, np.bool_)
    # State u * n + v is the segment u -> v; the search begins at 0 (start -> start).
    best[0] = 0.0
    queue = [(p.length_weight * apart[0, 1], 0)]
    while len(queue) > 0:
        _, state = heapq.heappop(queue)
        if done[state]:
            continue
        done[state] = True
        u, v = state // n, state % n
        if v == 1:
            return _unwind(nodes, parent, state, n, out)
        for w in range(1, n):
            if w == v or sight[v, w] == _BLOCKED:
                continue
            cost = best[state] + p.length_weight * apart[v, w]
            onward = p.length_weight * apart[w, 1]
            if cost + onward >= bound or cost >= best[v * n + w]:
                continue
            if state > 0:
                cost += p.turning_weight * _turn(nodes, u, v, w)
            if cost + onward >= bound or cost >= best[v * n + w]:
                continue
            if sight[v, w] == _UNKNOWN:  # the expensive test: made last, and only once
                sight[v, w] = _CLEAR if is_clear(p, nodes[v], nodes[w], stack) else _BLOCKED
                if sight[v, w] == _BLOCKED:
                    continue
            best[v * n + w] = cost
            parent[v * n + w] = state
            heapq.heappush(queue, (cost + onward, v * n + w))
    return 0


@njit(cache=True)
def _unwind(nodes: FloatArray, parent: IntArray, state: int, n: int, out: FloatArray) -> int:
    """Write the nodes that lead to ``state``, start first; return 0 if there are too many."""
    m = 1
    k = state
    while k > 0:
        m += 1
        k = parent[k]
    if m > MAX_POINTS:
        return 0
    at = m - 1
    k = state
    while k > 0:
        out[at, 0], out[at, 1] = nodes[k % n, 0], nodes[k % n, 1]
        at -= 1
        k = parent[k]
    out[0, 0], out[0, 1] = nodes[0, 0], nodes[0, 1]
    return m
