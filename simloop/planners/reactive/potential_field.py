"""Plain artificial potential field, which stops where its forces cancel.

Source: Khatib 1986, as printed in Mohamed 2012, Eqs. 1-3. The negative gradients of the two
potentials are an attraction xi d(q, goal) and, from each obstacle nearer than rho, a repulsion
eta (1/d - 1/rho) / d^2. A point follows the direction of the summed force in equal steps. The steps
are shortened near obstacles so that none ends inside one. The genetically optimised field
(`ga_apf`) is compared with this planner, whose local minima are intended.

Chosen here: the gains and the step. d is measured to the obstacle grown by the safe distance.
In a distance field, which has no separate obstacles, only the nearest surface repels.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.rollout import RollOut, Rollout, RolloutPlanner
from simloop.planners.reactive.surface import inside_bounds, nearest_surface

ATTRACTION = 1.0
"""xi of Eq. 1."""
REPULSION = 4.0
"""eta of Eq. 2, in safe distances to the fourth power: a scaled world gives a scaled path."""
REACH_SAFE = 1.5
"""Distance up to which obstacles repel (rho of Eq. 2), in safe distances."""
_STEP_SAFE = 0.2
_LEAST_GAP = 1e-3
_STILL_STEPS = 60
_STILL_SHARE = 0.1
_MOST_STEPS = 20_000


@njit(cache=True)
def force(p: Problem, x: float, y: float, reach: float) -> tuple[float, float]:
    """Compute the force at a point (Mohamed 2012, Eq. 3).

    Args:
        p: The planning problem.
        x: x of the point, m, map frame.
        y: y of the point, m, map frame.
        reach: Distance up to which obstacles repel, m.

    Returns:
        Force along x and y, map frame; in m, because xi has no unit.
    """
    fx = ATTRACTION * (p.goal_x - x)
    fy = ATTRACTION * (p.goal_y - y)
    least = _LEAST_GAP * p.safe_m  # keeps the repulsion finite on a surface
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
    gap, ux, uy = nearest_surface(p, x, y)
    gap = max(gap, least)
    if gap < reach:
        push = eta * (1.0 / gap - 1.0 / reach) / (gap * gap)
        fx += push * ux
        fy += push * uy
    return fx, fy


@njit(cache=True)
def follow_force(p: Problem, path: FloatArray) -> tuple[int, bool]:
    """Follow the force from the start to the goal, to a local minimum, or until ``path`` is full.

    Args:
        p: The planning problem.
        path: (n >= 2, 2) receives the points, m, map frame.

    Returns:
        Number of points, and whether the last one is the goal.
    """
    step = _STEP_SAFE * p.safe_m
    x, y = p.start_x, p.start_y
    path[0, 0], path[0, 1] = x, y
    for n in range(1, path.shape[0]):
        left = math.hypot(p.goal_x - x, p.goal_y - y)
        gap, _, _ = nearest_surface(p, x, y)
        # The goal is within a step and no obstacle lies in between: the end.
        if left <= step and (left <= gap or left < 1e-9):
            path[n, 0], path[n, 1] = p.goal_x, p.goal_y
            return n + 1, True
        fx, fy = force(p, x, y, REACH_SAFE * p.safe_m)
        size = math.hypot(fx, fy)
        size = size if size > 1e-12 else 1.0
        # Half the gap cannot reach the obstacle; the minimum frees a point that starts inside.
        go = min(step, max(0.5 * gap, 0.05 * step))
        x, y = x + go * fx / size, y + go * fy / size
        if not inside_bounds(p, x, y):
            return n, False
        path[n, 0], path[n, 1] = x, y
        if n > _STILL_STEPS and n % _STILL_STEPS == 0:
            back = n - _STILL_STEPS
            # Where the forces cancel, the point oscillates about one place.
            moved = math.hypot(x - path[back, 0], y - path[back, 1])
            if moved < _STILL_SHARE * _STILL_STEPS * 0.05 * step:
                return n + 1, False
    return path.shape[0], False


class PotentialField(RolloutPlanner):
    """A deterministic planner; if the point gets stuck, its plan ends there and is not safe."""

    name = "potential_field"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._path = np.zeros((_MOST_STEPS, 2))

    def _make_rollout(self, world: WorldView, rng: np.random.Generator) -> RollOut:
        def roll_out(p: Problem, attempt: int, most_m: float) -> Rollout:
            count, reached = follow_force(p, self._path)
            return Rollout(self._path[:count].copy(), reached, count)

        return roll_out
