"""Find the path with the greatest J among many in a distance field, mostly without exact costs.

An upper bound of the cost of a path comes from the windows of the field (`windows`): R of a segment
is greatest if it leads through an obstacle, and a segment whose windows are free does not.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import NO_LENGTH_M, Problem, segment_clearance
from simloop.planners.problem.objective import (
    LEAST_INTRUSION_M,
    THROUGH_M,
    THROUGH_SHARE,
    plain_cost,
)
from simloop.planners.problem.windows import Windows, surely_keeps

_ROUNDING = 1e-6  # more than the rounding error of a sum of penalties


@njit(cache=True)
def _lack_bound(p: Problem, lows: Windows, path: FloatArray, i: int) -> float:
    """Return an upper bound of R of segment i of a path in a field."""
    ax, ay, bx, by = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
    length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    share = p.overhang_m / length if length > NO_LENGTH_M else 0.0
    ex, ey = share * (bx - ax), share * (by - ay)
    ax, ay, bx, by = ax - ex, ay - ey, bx + ex, by + ey  # at least as long as with the overhang
    least = THROUGH_SHARE * p.safe_m
    if not surely_keeps(p, lows, ax, ay, bx, by, least):
        return p.safe_m + LEAST_INTRUSION_M + THROUGH_M
    if surely_keeps(p, lows, ax, ay, bx, by, p.safe_m):
        return 0.0
    return p.safe_m - least + LEAST_INTRUSION_M


@njit(cache=True)
def cost_bound(p: Problem, lows: Windows, path: FloatArray, m: int, known: float) -> float:
    """Compute an upper bound of J of a path in a field; stop once it is below ``known``.

    The first bound assumes that every segment leads through an obstacle. Each segment for which the
    windows prove more lowers it.

    Args:
        p: The problem, with a field whose values are not negative.
        lows: The field's windows.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.
        known: What another path costs.

    Returns:
        The bound.
    """
    through = p.safe_m + LEAST_INTRUSION_M + THROUGH_M
    most = plain_cost(p, path, m) + p.penalty * (m - 1) * through + _ROUNDING
    for i in range(m - 1):
        if most < known:
            break
        most -= p.penalty * (through - _lack_bound(p, lows, path, i))
    return most


@njit(cache=True)
def cost_if_worse(
    p: Problem,
    lows: Windows,
    path: FloatArray,
    m: int,
    most: float,
    known: float,
    stack: FloatArray,
) -> float:
    """Compute J of a path; stop with -inf once it is certain to be below ``known``.

    The sum is that of `objective.evaluate` with an infinite bound.

    Args:
        p: The problem, with a field whose values are not negative.
        lows: The field's windows.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.
        most: Upper bound of J, from `cost_bound`.
        known: What another path costs.
        stack: Scratch.

    Returns:
        J, or -inf if it is less than ``known``.
    """
    total, need = 0.0, p.safe_m - p.tolerance_m
    for i in range(m - 1):
        ax, ay, bx, by = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
        clear, lack = segment_clearance(p, ax, ay, bx, by, need, -np.inf, stack), 0.0
        if clear < need:
            lack = p.safe_m - clear + LEAST_INTRUSION_M
            total += lack
            if clear < THROUGH_SHARE * p.safe_m:
                lack += THROUGH_M
                total += THROUGH_M
        most -= p.penalty * (_lack_bound(p, lows, path, i) - lack)
        if most < known:
            return -np.inf
    return plain_cost(p, path, m) + p.penalty * total
