"""The visibility graph without compiled code: the oracle of `reference.ref_visibility`."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.ref_visibility import CORNERS, OUT, Corners


def plain_grown_corners(p: Problem) -> Corners:
    """Collect the start, the goal, and the corners of the grown shapes.

    Args:
        p: The planning problem.

    Returns:
        The nodes, without corners that another shape covers or that are out of bounds.
    """
    rings = [np.array([[p.start_x, p.start_y]]), np.array([[p.goal_x, p.goal_y]])]
    for x, y, r in p.discs.T:
        rings.append(_arc(x, y, r + p.safe_m, 0.0, 2.0 * math.pi))
    first = 0
    while first < len(p.corners):
        last = int(p.corners[first, 2])
        corners = p.corners[first:last, :2]
        edges = np.roll(corners, -1, axis=0) - corners
        # A corner becomes an arc from the normal of the previous edge to that of the next edge.
        normal = np.arctan2(-edges[:, 0], edges[:, 1])
        arcs = [
            _arc(x, y, p.safe_m, before, before + (after - before) % (2.0 * math.pi))
            for (x, y), before, after in zip(corners, np.roll(normal, 1), normal, strict=True)
        ]
        rings.append(np.concatenate(arcs))
        first = int(last)
    points = np.concatenate(rings)
    before = np.concatenate([np.roll(ring, 1, axis=0) for ring in rings])
    after = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    inside = ((points >= (p.low_x, p.low_y)) & (points <= (p.high_x, p.high_y))).all(axis=1)
    stack = make_stack()
    keep = np.array([is_clear(p, point, point, stack) for point in points]) & inside
    keep[:2] = True
    return Corners(points[keep], before[keep], after[keep])


def _arc(x: float, y: float, radius: float, first: float, last: float) -> FloatArray:
    """Compute the corners (n, 2) of the polygon around an arc, which touches it at both ends."""
    count = max(1, math.ceil((last - first) / (2.0 * math.pi) * CORNERS))
    half = 0.5 * (last - first) / count
    angles = first + half * (2.0 * np.arange(count) + 1.0)
    far = radius / math.cos(half) * (1.0 + OUT)
    return np.array([x, y]) + far * np.column_stack([np.cos(angles), np.sin(angles)])


def _touches(corners: Corners, k: int, dx: float, dy: float) -> bool:
    """Whether a line along (dx, dy) through node k has its shape on one side only."""
    ax, ay = corners.before[k] - corners.at[k]
    bx, by = corners.after[k] - corners.at[k]
    slack = 1e-9 * (abs(dx) + abs(dy))
    a, b = dx * ay - dy * ax, dx * by - dy * bx
    return (a >= -slack and b >= -slack) or (a <= slack and b <= slack)


def plain_visible_edges(
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
    tail, head = [], []
    for i in range(len(corners.at)):
        for j in range(i + 1, len(corners.at)):
            dx, dy = corners.at[j] - corners.at[i]
            if not _touches(corners, i, dx, dy) or not _touches(corners, j, dx, dy):
                continue
            if is_clear(p, corners.at[i], corners.at[j], stack):
                tail.append(i)
                head.append(j)
                tail.append(j)
                head.append(i)
    return np.array(tail), np.array(head)


def plain_best_chain(
    nodes: FloatArray,
    tail: NDArray[np.int64],
    head: NDArray[np.int64],
    length_weight: float,
    turning_weight: float,
) -> list[int] | None:
    """Find the chain of nodes of least J = w1 S + w2 Theta from node 0 to node 1.

    Args:
        nodes: (N, 2) positions, m, map frame.
        tail: (E,) node that each edge leaves.
        head: (E,) node that it reaches.
        length_weight: w1, cost of a metre.
        turning_weight: w2, cost of a radian.

    Returns:
        Indices of the nodes, 0 first and 1 last; None if they are not connected.
    """
    step = nodes[head] - nodes[tail]
    length = np.hypot(step[:, 0], step[:, 1])
    heading = np.arctan2(step[:, 1], step[:, 0])
    leaving = [np.flatnonzero(tail == k) for k in range(len(nodes))]
    best, parent = np.full(len(tail), np.inf), np.full(len(tail), -1)
    queue: list[tuple[float, int]] = []
    for first in leaving[0]:
        best[first] = length_weight * length[first]
        queue.append((float(best[first]), int(first)))
    heapq.heapify(queue)
    while queue:
        cost, e = heapq.heappop(queue)
        if cost > best[e]:
            continue
        # The first settled edge that ends at the goal completes the cheapest chain.
        if head[e] == 1:
            chain = [1]
            edge = e
            while edge >= 0:
                chain.append(int(tail[edge]))
                edge = int(parent[edge])
            return chain[::-1]
        onward = leaving[head[e]]
        turn = np.abs((heading[onward] - heading[e] + math.pi) % (2.0 * math.pi) - math.pi)
        total = cost + turning_weight * turn + length_weight * length[onward]
        for f, price in zip(onward[total < best[onward]], total[total < best[onward]], strict=True):
            best[f], parent[f] = price, e
            heapq.heappush(queue, (float(price), int(f)))
    return None
