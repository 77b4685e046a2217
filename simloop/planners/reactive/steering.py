"""How the step-by-step planners choose a heading: by a metaheuristic over the cost of Abed 2022.

Eq. 5: cost = a1 dRG + a2 / dRO + a3 theta, one number being sought (Table 1: dimension 1, from -5
to 5, ten agents, ten iterations). Here the number is the turn off the target's bearing, rad, so
that a turned world gives a turned path. Filled in: the weights, with lengths in steps and
clearances in safe distances; theta is the turn off the bearing (as printed, Eq. 6 is the bearing
itself, which nothing can be done about); a step that would end too close, or meet what moves, costs
`BLOCKED` more."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule, minimise
from simloop.planners.reactive.sensing import Look, free_range, nearest_mover, nearest_point, threat
from simloop.planners.reactive.walker import BLOCKED
from simloop.planners.splitmix import State

NEAR_GOAL, CLEAR, STRAIGHT = 1.0, 0.3, 0.1
AGENTS, ITERATIONS = 10, 10
TURN_RAD = 5.0


@njit(cache=True)
def heading_cost(look: Look, angle: float, bearing: float) -> float:
    """Eq. 5 of a step in direction ``angle``, rad."""
    ux, uy = math.cos(angle), math.sin(angle)
    x, y = look.x + look.step * ux, look.y + look.step * uy
    to_target = math.hypot(look.target_x - x, look.target_y - y)
    to_obstacle = max(min(nearest_point(look, x, y), nearest_mover(look, x, y)), 1e-3 * look.safe)
    off = abs((angle - bearing + math.pi) % (2.0 * math.pi) - math.pi)
    cost = NEAR_GOAL * to_target / look.step + CLEAR * look.safe / to_obstacle + STRAIGHT * off
    free = free_range(look, look.x, look.y, ux, uy)
    if free < look.step:
        cost += BLOCKED * (2.0 - free / look.step)
    return cost + BLOCKED * threat(look, look.step * ux, look.step * uy)


@njit(cache=True)
def heading_costs(look: Look, turns: FloatArray, out: FloatArray) -> None:
    """Costs (n,) of turns (n, 1) off the target's bearing, rad."""
    bearing = math.atan2(look.target_y - look.y, look.target_x - look.x)
    for k in range(turns.shape[0]):
        out[k] = heading_cost(look, bearing + turns[k, 0], bearing)


class HeadingObjective:
    """An `Objective` of one dimension: the turn off the target's bearing, rad."""

    def __init__(self, look: Look) -> None:
        self._look = look
        self.low, self.high = np.array([-TURN_RAD]), np.array([TURN_RAD])

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """As `Objective.costs`."""
        heading_costs(self._look, x, out)


class RuleSteering:
    """Any update rule of the population engine, for one heading."""

    def __init__(self, rule: type[Rule]) -> None:
        self._rule, self.evaluations = rule, 0

    def heading(self, look: Look, heading: float, state: State) -> float:
        """As `Steering.heading`."""
        population = Population(HeadingObjective(look), AGENTS, AGENTS * (1 + ITERATIONS), state)
        minimise(self._rule(), population)
        self.evaluations += population.spent
        bearing = math.atan2(look.target_y - look.y, look.target_x - look.x)
        return bearing + float(population.best_x[0])
