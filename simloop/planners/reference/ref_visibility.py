"""Visibility graph among polygons and discs, each grown by the safe distance (Lozano-Perez 1979).

The round parts of a grown shape are replaced by circumscribed polygons, so that a path around their
corners keeps the safe distance. The best path from start to goal is a chain of edges between
corners that see each other. J contains turning, so Dijkstra's algorithm runs over directed edges
and not over corners. With more corners the path converges to the exact optimum.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.reference import Reference

CORNERS = 96
"""Number of corners that replace a whole circle."""
OUT = 1e-6
"""The corners lie outside the shape by this share of the radius. Without it, rounding hides the
edges along the side of a grown shape."""


class Corners(NamedTuple):
    """Nodes of the graph. Start and goal come first and are their own neighbours.

    Attributes:
        at: (N, 2) positions, m, map frame.
        before: (N, 2) position of the previous node of the same shape, m, map frame.
        after: (N, 2) position of the next node of the same shape, m, map frame.
    """

    at: FloatArray
    before: FloatArray
    after: FloatArray


def grown_corners(p: Problem) -> Corners:
    """Collect the start, the goal, and the corners of the grown shapes.

    Args:
        p: The planning problem.

    Returns:
        The nodes, without corners that another shape covers or that are out of bounds.
    """
    at, before, after = _corners(p, _arcs(p, CORNERS), make_stack())
    return Corners(at, before, after)


@njit(cache=True)
def _arcs(p: Problem, whole: int) -> FloatArray:
    """List the arcs of the grown shapes, one row each.

    Columns: x, y of the centre, radius, first and last angle, number of corners, number of corners
    from the first one to the end of the shape, 0 except for a shape's first arc. A whole circle
    gets ``whole`` corners.
    """
    turn = 2.0 * math.pi
    discs, count = p.discs.shape[1], len(p.corners)
    arcs = np.zeros((discs + count, 7))
    for k in range(discs):
        arcs[k, 0], arcs[k, 1], arcs[k, 2] = p.discs[0, k], p.discs[1, k], p.discs[2, k] + p.safe_m
        arcs[k, 4], arcs[k, 5], arcs[k, 6] = turn, whole, whole
    first = 0
    while first < count:
        last = int(p.corners[first, 2])
        for i in range(first, last):
            prior, onward = i - 1 if i > first else last - 1, i + 1 if i + 1 < last else first
            # A corner becomes an arc from the normal of the previous edge to that of the next edge.
            before = _normal(p.corners, prior, i)
            around = (_normal(p.corners, i, onward) - before) % turn
            n = max(1, math.ceil(around / turn * whole))
            arc = arcs[discs + i]
            arc[0], arc[1], arc[2] = p.corners[i, 0], p.corners[i, 1], p.safe_m
            arc[3], arc[4], arc[5] = before, before + around, n
            arcs[discs + first, 6] += n
        first = last
    return arcs


@njit(cache=True)
def _normal(corners: FloatArray, i: int, j: int) -> float:
    """Compute the direction of the outward normal of the edge from corner i to corner j, rad."""
    return math.atan2(corners[i, 0] - corners[j, 0], corners[j, 1] - corners[i, 1])


@njit(cache=True)
def _corners(
    p: Problem, arcs: FloatArray, stack: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place the nodes: positions, and positions of their neighbours, each (N, 2)."""
    total = 2 + int(arcs[:, 5].sum())
    at = np.empty((total, 2))
    at[0, 0], at[0, 1], at[1, 0], at[1, 1] = p.start_x, p.start_y, p.goal_x, p.goal_y
    # The polygon around an arc touches it at both ends.
    n = 2
    for k in range(len(arcs)):
        count = int(arcs[k, 5])
        half = 0.5 * (arcs[k, 4] - arcs[k, 3]) / count
        far = arcs[k, 2] / math.cos(half) * (1.0 + OUT)
        for i in range(count):
            angle = arcs[k, 3] + half * (2.0 * i + 1.0)
            at[n, 0] = arcs[k, 0] + far * math.cos(angle)
            at[n, 1] = arcs[k, 1] + far * math.sin(angle)
            n += 1
    keep = np.zeros(total, np.int64)
    prior, onward = np.arange(total) - 1, np.arange(total) + 1
    prior[0], onward[0], prior[1], onward[1] = 0, 0, 1, 1
    keep[1], kept, n = 1, 2, 2
    p.trials[0] += 2  # start and goal are kept in any case, and count as tried
    for k in range(len(arcs)):
        ring = int(arcs[k, 6])
        if ring > 0:
            prior[n], onward[n + ring - 1] = n + ring - 1, n
        for i in range(n, n + int(arcs[k, 5])):
            inside = p.low_x <= at[i, 0] <= p.high_x and p.low_y <= at[i, 1] <= p.high_y
            if is_clear(p, at[i], at[i], stack) and inside:
                keep[kept] = i
                kept += 1
        n += int(arcs[k, 5])
    chosen = keep[:kept]
    return at[chosen], at[prior[chosen]], at[onward[chosen]]


@njit(cache=True)
def _touches(
    ax: float, ay: float, bx: float, by: float, dx: float, dy: float, slack: float
) -> bool:
    """Whether a line along d has the neighbours of its node, at a and b from it, on one side."""
    a, b = dx * ay - dy * ax, dx * by - dy * bx
    return (a >= -slack and b >= -slack) or (a <= slack and b <= slack)


@njit(cache=True)
def visible_edges(
    p: Problem, corners: Corners, stack: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the directed edges between nodes that see each other.

    Only lines that touch both shapes are kept, because no other edge can be part of a best path.

    Args:
        p: The planning problem.
        corners: The nodes.
        stack: Scratch for the clearance check, see `make_stack`.

    Returns:
        (E,) node that each edge leaves, (E,) node that it reaches.
    """
    tail, head = [0], [0]  # a dummy entry, dropped below, tells numba the type
    at, n = corners.at, len(corners.at)
    to_before, to_after = corners.before - at, corners.after - at
    for i in range(n):
        ax, ay, bx, by = to_before[i, 0], to_before[i, 1], to_after[i, 0], to_after[i, 1]
        for j in range(i + 1, n):
            dx, dy = at[j, 0] - at[i, 0], at[j, 1] - at[i, 1]
            slack = 1e-9 * (abs(dx) + abs(dy))
            if not _touches(ax, ay, bx, by, dx, dy, slack):
                continue
            cx, cy, ex, ey = to_before[j, 0], to_before[j, 1], to_after[j, 0], to_after[j, 1]
            if _touches(cx, cy, ex, ey, dx, dy, slack) and is_clear(p, at[i], at[j], stack):
                tail.append(i)
                head.append(j)
                tail.append(j)
                head.append(i)
    return np.array(tail[1:]), np.array(head[1:])


@njit(cache=True)
def _by_tail(tail: NDArray[np.int64], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sort edges by the node that they leave: first index of each node (n + 1,), edges (E,)."""
    first = np.zeros(n + 1, np.int64)
    for k in tail:
        first[k + 1] += 1
    first = np.cumsum(first)
    edges, free = np.empty(len(tail), np.int64), first.copy()
    for e in range(len(tail)):
        edges[free[tail[e]]] = e
        free[tail[e]] += 1
    return first, edges


@njit(cache=True)
def best_chain(
    nodes: FloatArray,
    tail: NDArray[np.int64],
    head: NDArray[np.int64],
    length_weight: float,
    turning_weight: float,
) -> NDArray[np.int64]:
    """Find the chain of nodes of least J = w1 S + w2 Theta from node 0 to node 1.

    Args:
        nodes: (N, 2) positions, m, map frame.
        tail: (E,) node that each edge leaves.
        head: (E,) node that it reaches.
        length_weight: w1, cost of a metre.
        turning_weight: w2, cost of a radian.

    Returns:
        (m,) indices of the nodes, 0 first and 1 last; empty if they are not connected.
    """
    step = nodes[head] - nodes[tail]
    length, heading = np.hypot(step[:, 0], step[:, 1]), np.arctan2(step[:, 1], step[:, 0])
    first, edges = _by_tail(tail, len(nodes))
    best, parent = np.full(len(tail), np.inf), np.full(len(tail), -1)
    queue = [(0.0, 0)]
    queue.pop()  # the entry has told numba the type
    for e in edges[first[0] : first[1]]:
        best[e] = length_weight * length[e]
        heapq.heappush(queue, (best[e], e))
    while len(queue) > 0:
        cost, e = heapq.heappop(queue)
        if cost > best[e]:
            continue
        # The first settled edge that ends at the goal completes the cheapest chain.
        if head[e] == 1:
            chain = [1]
            while e >= 0:
                chain.append(tail[e])
                e = parent[e]
            return np.array(chain[::-1])
        for f in edges[first[head[e]] : first[head[e] + 1]]:
            turn = abs((heading[f] - heading[e] + math.pi) % (2.0 * math.pi) - math.pi)
            total = cost + turning_weight * turn + length_weight * length[f]
            if total < best[f]:
                best[f], parent[f] = total, e
                heapq.heappush(queue, (total, f))
    return np.empty(0, np.int64)


class VisibilityGraph(Reference):
    """Builds the whole graph, then runs Dijkstra's algorithm on it."""

    name = "visibility"

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Find the path of least J; a trial is one line of sight.

        Args:
            world: The world view.
            p: The planning problem in that view; trials are counted in ``p.trials``.
            rng: Not used.

        Returns:
            (n, 2) waypoints from start to goal, m, map frame; None if no path exists.
        """
        corners = grown_corners(p)
        tail, head = visible_edges(p, corners, make_stack())
        chain = best_chain(corners.at, tail, head, p.length_weight, p.turning_weight)
        return corners.at[chain] if len(chain) else None
