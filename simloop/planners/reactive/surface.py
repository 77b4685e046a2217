"""Where a point that moves step by step stands: the nearest surface, and the bounds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.geometry.distance_field import FREE_M
from simloop.planners.problem.clearance import Problem, relaxed_clearance
from simloop.planners.problem.flat_problem import allowance, sample_field

# Half widths of the central differences: as a share of the safe distance, and of a field's cell.
_SLOPE_SAFE = 1e-3
_SLOPE_CELLS = 0.5


@njit(cache=True, forceinline=True)
def nearest_surface(p: Problem, x: float, y: float) -> tuple[float, float, float]:
    """Compute the distance from a point to the nearest grown obstacle, and its gradient.

    Obstacles are grown by the safe distance. Near a start that is too close to an obstacle the safe
    distance is relaxed. Among discs the gradient is exact, elsewhere it comes from central
    differences. The function is compiled into its callers, whose loops would otherwise spend most
    of their time on handing the problem over.

    Args:
        p: The planning problem.
        x: x of the point, m, map frame.
        y: y of the point, m, map frame.

    Returns:
        Distance, m, negative inside the grown obstacle; unit vector away from the obstacle, or
        (0, 0) where the distance has no slope.
    """
    ux, uy = 0.0, 0.0
    if p.field.size == 0 and p.corners.size == 0:
        gap, least = FREE_M, np.inf
        for k in range(p.discs.shape[1]):
            dx, dy = x - p.discs[0, k], y - p.discs[1, k]
            apart = math.hypot(dx, dy)
            gap = min(gap, apart - p.discs[2, k])
            if apart - p.discs[2, k] < least and apart > 0.0:
                least = apart - p.discs[2, k]
                ux, uy = dx / apart, dy / apart
        return gap + allowance(p, x, y) - p.safe_m, ux, uy
    if p.field.size > 0:
        h = _SLOPE_CELLS / p.per_m
        gap = sample_field(p, x, y) + allowance(p, x, y)
        gx = sample_field(p, x + h, y) + allowance(p, x + h, y)
        gx -= sample_field(p, x - h, y) + allowance(p, x - h, y)
        gy = sample_field(p, x, y + h) + allowance(p, x, y + h)
        gy -= sample_field(p, x, y - h) + allowance(p, x, y - h)
    else:
        h = _SLOPE_SAFE * p.safe_m
        gap = relaxed_clearance(p, x, y)
        gx = relaxed_clearance(p, x + h, y) - relaxed_clearance(p, x - h, y)
        gy = relaxed_clearance(p, x, y + h) - relaxed_clearance(p, x, y - h)
    size = math.hypot(gx, gy)
    if size >= 1e-12:
        ux, uy = gx / size, gy / size
    return gap - p.safe_m, ux, uy


@njit(cache=True, forceinline=True)
def inside_bounds(p: Problem, x: float, y: float) -> bool:
    """Tell whether a point lies in the waypoints' box, extended to start and goal.

    Args:
        p: The planning problem.
        x: x of the point, m, map frame.
        y: y of the point, m, map frame.

    Returns:
        Whether it lies inside.
    """
    low_x, high_x = min(p.low_x, p.start_x, p.goal_x), max(p.high_x, p.start_x, p.goal_x)
    low_y, high_y = min(p.low_y, p.start_y, p.goal_y), max(p.high_y, p.start_y, p.goal_y)
    return low_x <= x <= high_x and low_y <= y <= high_y
