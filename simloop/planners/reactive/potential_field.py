"""The plain artificial potential field, which stops where its forces cancel.

Source: Khatib 1986, as Mohamed 2012 gives it in Eqs. 1-3: attraction xi d(q, goal), and from each
obstacle nearer than rho the repulsion eta (1/d - 1/rho) / d^2. A point follows the force's
direction in equal steps, shortened near obstacles so that none can be stepped into. It is what
the genetically optimised field is measured against, and it is meant to show its local minimum.

Filled in: the gains; the step; d is measured to the obstacle grown by the safe distance; in a
distance field, which knows no single obstacles, the nearest surface alone repels.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.rollout import Walk, WalkingPlanner, inside_bounds, surface

ATTRACTION = 1.0
REPULSION = 4.0
"""eta, in safe distances to the fourth: so that a world drawn larger gives a larger path."""
REACH_SAFE = 1.5
"""How far obstacles repel (rho), in safe distances."""
_STEP_SAFE = 0.2
_LEAST_GAP = 1e-3
_STILL_STEPS = 60
_STILL_SHARE = 0.1
_MOST_STEPS = 20_000


@njit(cache=True)
def force(p: Problem, x: float, y: float, reach: float) -> tuple[float, float]:
    """Force at a point, Eq. 3, m."""
    fx = ATTRACTION * (p.goal_x - x)
    fy = ATTRACTION * (p.goal_y - y)
    least = _LEAST_GAP * p.safe_m
    eta = REPULSION * p.safe_m**4
    if p.field.size == 0 and p.corners.size == 0:
        for k in range(p.discs.shape[1]):
            dx, dy = x - p.discs[0, k], y - p.discs[1, k]
            apart = math.hypot(dx, dy)
            gap = max(apart - p.discs[2, k] - p.safe_m, least)
            if gap < reach and apart > 0.0:
                push = eta * (1.0 / gap - 1.0 / reach) / (gap * gap)
                fx += push * dx / apart
                fy += push * dy / apart
        return fx, fy
    gap, ux, uy = surface(p, x, y)
    gap = max(gap, least)
    if gap < reach:
        push = eta * (1.0 / gap - 1.0 / reach) / (gap * gap)
        fx += push * ux
        fy += push * uy
    return fx, fy


@njit(cache=True)
def follow_force(p: Problem, path: FloatArray) -> tuple[int, bool]:
    """Follow the force from the start; path: (>= 2, 2) takes the points. Their count, and whether
    the last is the goal; if not, the forces cancel there."""
    step = _STEP_SAFE * p.safe_m
    x, y = p.start_x, p.start_y
    path[0, 0], path[0, 1] = x, y
    for n in range(1, path.shape[0]):
        left = math.hypot(p.goal_x - x, p.goal_y - y)
        gap, _, _ = surface(p, x, y)
        if left <= step and (left <= gap or left < 1e-9):
            path[n, 0], path[n, 1] = p.goal_x, p.goal_y
            return n + 1, True
        fx, fy = force(p, x, y, REACH_SAFE * p.safe_m)
        size = math.hypot(fx, fy)
        size = size if size > 1e-12 else 1.0
        go = min(step, max(0.5 * gap, 0.05 * step))
        x, y = x + go * fx / size, y + go * fy / size
        if not inside_bounds(p, x, y):
            return n, False
        path[n, 0], path[n, 1] = x, y
        if n > _STILL_STEPS and n % _STILL_STEPS == 0:
            back = n - _STILL_STEPS
            came = math.hypot(x - path[back, 0], y - path[back, 1])
            if came < _STILL_SHARE * _STILL_STEPS * 0.05 * step:
                return n + 1, False
    return path.shape[0], False


class PotentialField(WalkingPlanner):
    """Draws nothing from the generator; where it gets stuck, the plan ends there."""

    name = "potential_field"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._path = np.zeros((_MOST_STEPS, 2))

    def _walker(self, world: WorldView, rng: np.random.Generator) -> Callable[[Problem, int], Walk]:
        def walk(p: Problem, attempt: int) -> Walk:
            count, reached = follow_force(p, self._path)
            return Walk(self._path[:count].copy(), reached, count)

        return walk
