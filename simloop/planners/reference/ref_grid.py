"""Shortest paths on a lattice: A* (Hart, Nilsson, Raphael 1968) and Theta* (Nash et al. 2007).

The lattice is placed so that the start is one of its nodes. The goal is an extra node, connected
to the nodes around it. Edges lead to the eight neighbours and are checked along their whole
length. Theta* also tries to reach a node straight from its parent's parent, so its paths may
have any angle.
"""

from __future__ import annotations

import heapq
import math
from typing import ClassVar

import numpy as np
from numba import njit

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.reference import Reference

NODES = 40_000
"""Approximate number of nodes; the spacing follows from it and the area."""
_NEAR_GOAL = 1.5  # a node is connected to the goal within this many spacings
_DX = (1, 1, 0, -1, -1, -1, 0, 1)
_DY = (0, 1, 1, 1, 0, -1, -1, -1)


def spacing(p: Problem) -> float:
    """Compute the distance between neighbouring nodes.

    Args:
        p: The planning problem.

    Returns:
        Spacing along x and y, m; about `NODES` nodes then fill the box.
    """
    low_x, high_x = min(p.low_x, p.start_x, p.goal_x), max(p.high_x, p.start_x, p.goal_x)
    low_y, high_y = min(p.low_y, p.start_y, p.goal_y), max(p.high_y, p.start_y, p.goal_y)
    return math.sqrt(max((high_x - low_x) * (high_y - low_y), 1e-12) / NODES)


@njit(cache=True)
def _clear(
    p: Problem, ax: float, ay: float, bx: float, by: float, ends: FloatArray, stack: FloatArray
) -> bool:
    """Whether segment a-b keeps the safe distance; ends (2, 2) and stack are scratch."""
    ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = ax, ay, bx, by
    return is_clear(p, ends[0], ends[1], stack)


@njit(cache=True)
def _lattice(p: Problem, step: float) -> tuple[FloatArray, FloatArray, int, int]:
    """Place the lattice.

    Returns x and y of all nodes, row by row, with the goal last; the number of columns; the number
    of the start's node.
    """
    low_x, low_y = min(p.low_x, p.start_x, p.goal_x), min(p.low_y, p.start_y, p.goal_y)
    high_x, high_y = max(p.high_x, p.start_x, p.goal_x), max(p.high_y, p.start_y, p.goal_y)
    left, down = int((p.start_x - low_x) / step), int((p.start_y - low_y) / step)
    cols = left + int((high_x - p.start_x) / step) + 1
    rows = down + int((high_y - p.start_y) / step) + 1
    count = rows * cols
    x, y = np.empty(count + 1), np.empty(count + 1)
    for k in range(count):
        x[k] = p.start_x + (k % cols - left) * step
        y[k] = p.start_y + (k // cols - down) * step
    x[count], y[count] = p.goal_x, p.goal_y
    return x, y, cols, down * cols + left


@njit(cache=True)
def shortest_path(p: Problem, step: float, any_angle: bool, stack: FloatArray) -> FloatArray:
    """Search for the shortest path over the lattice (A*, or Theta* at any angle).

    Args:
        p: The planning problem.
        step: Distance between neighbouring nodes, m.
        any_angle: Whether a node may be reached directly from its parent's parent (Theta*).
        stack: Scratch for the clearance check, see `make_stack`.

    Returns:
        (n, 2) waypoints from start to goal, m, map frame; (0, 2) if there is no path.
    """
    x, y, cols, first = _lattice(p, step)
    count = x.size - 1  # also the number of the goal's node, which is the last one
    rows = count // cols
    far, parent = np.full(count + 1, np.inf), np.full(count + 1, -1, dtype=np.int64)
    closed, ends = np.zeros(count + 1, dtype=np.bool_), np.empty((2, 2))
    far[first], parent[first] = 0.0, first
    # The straight distance to the goal is never too long, so the first path found is the shortest.
    queue = [(math.hypot(p.goal_x - p.start_x, p.goal_y - p.start_y), first)]
    while len(queue) > 0:
        _, k = heapq.heappop(queue)
        # A node is pushed again when a shorter path to it is found; older entries are skipped.
        if closed[k]:
            continue
        closed[k] = True
        if k == count:
            return _unwind(x, y, parent, first, count)
        joins_goal = math.hypot(p.goal_x - x[k], p.goal_y - y[k]) <= _NEAR_GOAL * step
        for n in range(9):
            if n == 8:
                j = count
                if not joins_goal:
                    continue
            else:
                i, row = k % cols + _DX[n], k // cols + _DY[n]
                if i < 0 or i >= cols or row < 0 or row >= rows:
                    continue
                j = row * cols + i
            if closed[j]:
                continue
            from_k = far[k] + math.hypot(x[j] - x[k], y[j] - y[k])
            source = k
            # Theta*: skip the parent if its own parent sees the node; that is never longer.
            if any_angle:
                above = parent[k]
                from_above = far[above] + math.hypot(x[j] - x[above], y[j] - y[above])
                shorter = from_above < far[j] and above != k
                if shorter and _clear(p, x[above], y[above], x[j], y[j], ends, stack):
                    source, from_k = above, from_above
            if from_k >= far[j]:
                continue
            if source == k and not _clear(p, x[k], y[k], x[j], y[j], ends, stack):
                continue
            far[j], parent[j] = from_k, source
            ahead = math.hypot(p.goal_x - x[j], p.goal_y - y[j])
            heapq.heappush(queue, (from_k + ahead, j))
    return np.zeros((0, 2))


@njit(cache=True)
def _unwind(x: FloatArray, y: FloatArray, parent: FloatArray, first: int, last: int) -> FloatArray:
    """Return the positions (n, 2) from the first to the last node, along the parents."""
    count, k = 1, last
    while k != first:
        k = parent[k]
        count += 1
    path, k = np.empty((count, 2)), last
    for i in range(count - 1, -1, -1):
        path[i, 0], path[i, 1] = x[k], y[k]
        k = parent[k]
    return path


class GridAStar(Reference):
    """Finds the shortest path along the lattice's edges."""

    name = "astar"
    any_angle: ClassVar[bool] = False

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Search the lattice; a trial is one edge or one line of sight.

        Args:
            world: The world view.
            p: The planning problem in that view; trials are counted in ``p.trials``.
            rng: Not used.

        Returns:
            (n, 2) waypoints from start to goal, m, map frame; None if no path exists.
        """
        path = shortest_path(p, spacing(p), self.any_angle, make_stack())
        return path if len(path) else None


class ThetaStar(GridAStar):
    """Finds a short path at any angle; it is not always the shortest."""

    name = "theta_star"
    any_angle = True
