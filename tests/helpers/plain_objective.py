"""The objectives of populations in full: every cost of every vector, as a yardstick."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.codings import Coding, decode
from simloop.planners.problem.clearance import Problem, point_clearance
from simloop.planners.problem.objective import (
    intrusion,
    length_and_turning,
    make_stack,
    start_turn,
)


@njit(cache=True)
def _examined_penalty(p: Problem, path: FloatArray, m: int, examined: int) -> float:
    """Sum R with every examined point computed for every obstacle."""
    in_field = p.field.size > 0
    total = 0.0
    for k in range(1 if in_field else p.discs.shape[1]):
        delta = p.safe_m if in_field else p.discs[2, k] + p.safe_m
        d = np.inf
        for i in range(m - 1):
            for n in range(examined + 1):
                if i == 0 and n == 0:
                    continue
                t = n / (examined + 1)
                x = path[i, 0] + t * (path[i + 1, 0] - path[i, 0])
                y = path[i, 1] + t * (path[i + 1, 1] - path[i, 1])
                if in_field:
                    d = min(d, point_clearance(p, x, y))
                else:
                    d = min(d, math.hypot(x - p.discs[0, k], y - p.discs[1, k]))
        if d < delta:
            total += 1.0 / max(d, 1e-3) - 1.0 / delta
    return total


@njit(cache=True)
def _plain_cost(
    p: Problem, coding: Coding, x: FloatArray, examined: int, path: FloatArray, stack: FloatArray
) -> float:
    """J of one vector; ``examined`` is -1 for the clearance of the whole path."""
    m = decode(p, coding, x, path)
    length, turning = length_and_turning(path, m)
    cost = p.length_weight * length + p.turning_weight * turning
    if examined >= 0:
        return cost + p.penalty * _examined_penalty(p, path, m, examined)
    if p.start_turn_weight > 0.0:
        cost += p.start_turn_weight * start_turn(p, path, m)
    return cost + p.penalty * intrusion(p, path, m, np.inf, stack)


class PlainObjective:
    """An `Objective` over coded paths that ignores all bounds; arguments as `PathObjective`."""

    def __init__(self, problem: Problem, coding: Coding, examined: int | None = None) -> None:
        self.problem, self.coding = problem, coding
        self.low, self.high = coding.low, coding.high
        self._examined = -1 if examined is None else examined

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """Compute J of each vector in full.

        Args:
            x: (n, d) vectors.
            out: (n,) receives J.
            bounds: Not used.
        """
        path, stack = np.zeros((self.coding.points + 2, 2)), make_stack()
        for k in range(len(x)):
            out[k] = _plain_cost(self.problem, self.coding, x[k], self._examined, path, stack)

    def path(self, x: FloatArray) -> FloatArray:
        """Decode a vector into waypoints.

        Args:
            x: (d,) the vector.

        Returns:
            (points + 2, 2) waypoints, m.
        """
        out = np.zeros((self.coding.points + 2, 2))
        decode(self.problem, self.coding, x, out)
        return out
