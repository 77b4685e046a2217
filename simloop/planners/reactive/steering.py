"""Heading choice by a metaheuristic that minimises the cost function of Abed 2022.

Eq. 5: cost = alpha1 dRG + alpha2 / dRO + alpha3 theta, with the distances to the goal (dRG, Eq. 3)
and to the obstacle (dRO, Eq. 4). Table 1: one variable between -5 and 5, ten agents, ten
iterations. The variable here is the turn relative to the target's bearing, rad, so that a rotated
world gives a rotated path.

Chosen here, because the paper leaves it open:
- the three weights; lengths count in steps, clearances in safe distances;
- theta is the turn relative to the bearing. Eq. 6 prints the bearing itself, which is no choice;
- a step that ends too close to an obstacle, or that meets a mover, costs up to twice
  `BLOCKED_COST` more.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule, minimise
from simloop.planners.reactive.sensing import (
    LocalView,
    collision_threat,
    free_range,
    nearest_mover_distance,
    nearest_point_distance,
)
from simloop.planners.reactive.stepper import BLOCKED_COST
from simloop.planners.splitmix import State

GOAL_WEIGHT, OBSTACLE_WEIGHT, TURN_WEIGHT = 1.0, 0.3, 0.1
"""alpha1, alpha2 and alpha3 of Eq. 5."""
AGENTS, ITERATIONS = 10, 10
TURN_LIMIT_RAD = 5.0


@njit(cache=True, forceinline=True)
def heading_cost(view: LocalView, angle: float, bearing: float) -> float:
    """Compute the cost of one step in a direction (Abed 2022, Eq. 5, with penalties).

    Args:
        view: What the robot knows.
        angle: Direction of the step, rad, map frame.
        bearing: Bearing of the target, rad, map frame.

    Returns:
        Cost, without unit.
    """
    ux, uy = math.cos(angle), math.sin(angle)
    x, y = view.x + view.step_m * ux, view.y + view.step_m * uy
    to_target = math.hypot(view.target_x - x, view.target_y - y)
    nearest = min(nearest_point_distance(view, x, y), nearest_mover_distance(view, x, y))
    # The minimum keeps the quotient finite if the step ends inside a mover.
    to_obstacle = max(nearest, 1e-3 * view.safe_m)
    off = abs((angle - bearing + math.pi) % (2.0 * math.pi) - math.pi)
    cost = (
        GOAL_WEIGHT * to_target / view.step_m
        + OBSTACLE_WEIGHT * view.safe_m / to_obstacle
        + TURN_WEIGHT * off
    )
    free = free_range(view, view.x, view.y, ux, uy)
    # A heading costs more the sooner it is blocked, which leads the search out.
    if free < view.step_m:
        cost += BLOCKED_COST * (2.0 - free / view.step_m)
    return cost + BLOCKED_COST * collision_threat(view, view.step_m * ux, view.step_m * uy)


@njit(cache=True)
def heading_costs(view: LocalView, turns: FloatArray, out: FloatArray) -> None:
    """Compute the costs of several turns relative to the target's bearing.

    Args:
        view: What the robot knows.
        turns: (n, 1) turns relative to the target's bearing, rad.
        out: (n,) receives the costs.
    """
    bearing = math.atan2(view.target_y - view.y, view.target_x - view.x)
    for k in range(turns.shape[0]):
        out[k] = heading_cost(view, bearing + turns[k, 0], bearing)


class HeadingObjective:
    """An `Objective` of one variable: the turn relative to the target's bearing, rad."""

    def __init__(self, view: LocalView) -> None:
        self._view = view
        self.low, self.high = np.array([-TURN_LIMIT_RAD]), np.array([TURN_LIMIT_RAD])

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """Evaluate a population of turns; see `Objective.costs`.

        Args:
            x: (n, 1) turns relative to the target's bearing, rad.
            out: (n,) receives the costs.
            bounds: (n,) not used: every cost is computed in full.
        """
        heading_costs(self._view, x, out)


class RuleSteering:
    """A `Steering` that finds each heading with an update rule of the population engine."""

    def __init__(self, rule: type[Rule]) -> None:
        self._rule, self.evaluations = rule, 0

    def heading(self, view: LocalView, heading: float, state: State) -> float:
        """Search for the heading of least cost (Abed 2022, Eq. 5).

        Args:
            view: What the robot knows.
            heading: The robot's present heading, rad; not used.
            state: (1,) random state, advanced.

        Returns:
            Heading, rad, map frame.
        """
        population = Population(HeadingObjective(view), AGENTS, AGENTS * (1 + ITERATIONS), state)
        minimise(self._rule(), population)
        self.evaluations += population.spent
        bearing = math.atan2(view.target_y - view.y, view.target_x - view.x)
        return bearing + float(population.best_x[0])
