"""Fuzzy heading controller whose parameters are tuned by wind driven optimisation.

Abed 2022 gives only the name of this rival ("Hybrid Fuzzy-WDO", Pandey & Parhi 2017): a controller
with singleton outputs from the distances of obstacles in front, on the left and on the right, tuned
by WDO (Bayraktar 2013). Everything else is chosen here:

- Inputs: the free range in three sectors (each near or far) and the target's bearing (left, ahead,
  right), which gives 24 rules. Output: a turn, one of five singletons. The rules' outputs are
  combined by their mean, weighted by how far each rule applies.
- Rules: with a far front, turn towards the target, but less towards a near side. With a near
  front, turn hard towards the far side; if both sides or neither are far, towards the target.
- Tuned parameters: the ranges where near ends and far begins (front, sides), the bearing that
  counts as a side, and the sizes of the small and the hard turn. Every few steps WDO tries
  controllers. Each is simulated some steps ahead in what is sensed now. Its cost is Eq. 5 of
  Abed 2022 at the end of the simulation, with the least clearance along it.
- The controller's heading is replaced by the nearest heading that keeps the safe distance for a
  step and avoids the predicted movers. If no heading avoids them, the least threatened is used.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, minimise
from simloop.planners.metaheuristics.rule_wdo import WindDriven
from simloop.planners.reactive.sensing import (
    BEAMS,
    LocalView,
    collision_threat,
    free_range,
    nearest_mover_distance,
    nearest_point_distance,
)
from simloop.planners.reactive.steering import (
    AGENTS,
    GOAL_WEIGHT,
    ITERATIONS,
    OBSTACLE_WEIGHT,
    TURN_WEIGHT,
)
from simloop.planners.reactive.stepper import BLOCKED_COST
from simloop.planners.splitmix import State

SIMULATED_STEPS = 6
RETUNE_STEPS = 2
SECTOR_RAYS = 5
HALF_SECTOR_RAD = 0.5
SECTORS_RAD = (1.1, 0.0, -1.1)  # middles of the left, front and right sector
# Parameters of a controller: front near, far (steps); sides near, far (steps); bearing that counts
# as a side (rad); small turn, hard turn (rad).
LOW = np.array([1.0, 3.0, 1.0, 2.0, 0.2, 0.1, 0.5])
HIGH = np.array([3.0, 12.0, 2.0, 6.0, 1.2, 1.5, 2.5])


@njit(cache=True)
def sector_range(view: LocalView, x: float, y: float, middle: float) -> float:
    """Compute the least free range among the rays of a sector.

    Args:
        view: What the robot knows.
        x: Position, m, map frame.
        y: Position, m, map frame.
        middle: Direction of the sector's middle, rad, map frame.

    Returns:
        Free range, in steps.
    """
    least = np.inf
    for k in range(SECTOR_RAYS):
        angle = middle + HALF_SECTOR_RAD * (2.0 * k / (SECTOR_RAYS - 1) - 1.0)
        least = min(least, free_range(view, x, y, math.cos(angle), math.sin(angle)))
    return least / view.step_m


@njit(cache=True)
def far_membership(value: float, low: float, high: float) -> float:
    """Compute the membership of a range in the fuzzy set "far"; that in "near" is 1 minus it.

    Args:
        value: Range, in steps.
        low: The membership is 0 up to this range, in steps.
        high: The membership is 1 from this range on, in steps; raised to a little over ``low``.

    Returns:
        Membership, 0 to 1.
    """
    high = max(high, low + 0.1)
    return min(max((value - low) / (high - low), 0.0), 1.0)


@njit(cache=True)
def rule_turn(left: int, front: int, right: int, side: int) -> int:
    """Return the turn that one rule prescribes.

    Args:
        left: Left sector: 1 far, 0 near.
        front: Front sector: 1 far, 0 near.
        right: Right sector: 1 far, 0 near.
        side: Direction of the target: 1 left, 0 ahead, -1 right.

    Returns:
        -2 hard right, -1 slightly right, 0 straight, 1 slightly left, 2 hard left.
    """
    if front:
        if side == 1:
            return 2 if left else 1
        if side == -1:
            return -2 if right else -1
        return 0
    if left and right:
        return -2 if side == -1 else 2
    if left:
        return 2
    if right:
        return -2
    return 2 if side >= 0 else -2


@njit(cache=True)
def fuzzy_turn(x: FloatArray, left: float, front: float, right: float, bearing: float) -> float:
    """Compute the turn that a controller requests.

    Args:
        x: (7,) parameters of the controller.
        left: Free range in the left sector, in steps.
        front: Free range in the front sector, in steps.
        right: Free range in the right sector, in steps.
        bearing: Bearing of the target relative to the present heading, rad.

    Returns:
        Turn, rad, positive to the left.
    """
    fars = (
        far_membership(left, x[2], x[3]),
        far_membership(front, x[0], x[1]),
        far_membership(right, x[2], x[3]),
    )
    ahead = max(0.0, 1.0 - abs(bearing) / x[4])
    total = 0.0
    # All 24 rules: each has the product of its four memberships as weight; the weights sum to 1.
    for a in range(2):
        for b in range(2):
            for c in range(2):
                applies = (fars[0] if a else 1.0 - fars[0]) * (fars[1] if b else 1.0 - fars[1])
                applies *= fars[2] if c else 1.0 - fars[2]
                for side in (-1, 0, 1):
                    weight = ahead if side == 0 else (1.0 - ahead if side * bearing > 0.0 else 0.0)
                    turn = rule_turn(a, b, c, side)
                    size = x[5] if abs(turn) == 1 else x[6]
                    total += applies * weight * size * np.sign(turn)
    return total


@njit(cache=True)
def controller_heading(
    view: LocalView, x: FloatArray, at_x: float, at_y: float, heading: float
) -> float:
    """Compute the controller's heading at a position, replaced by the nearest free heading.

    A heading is free if a step along it keeps the safe distance.

    Args:
        view: What the robot knows.
        x: (7,) parameters of the controller.
        at_x: Position, m, map frame.
        at_y: Position, m, map frame.
        heading: Present heading, rad, map frame.

    Returns:
        Heading, rad, map frame; NaN if no heading is free.
    """
    bearing = math.atan2(view.target_y - at_y, view.target_x - at_x) - heading
    bearing = (bearing + math.pi) % (2.0 * math.pi) - math.pi
    left = sector_range(view, at_x, at_y, heading + SECTORS_RAD[0])
    front = sector_range(view, at_x, at_y, heading + SECTORS_RAD[1])
    right = sector_range(view, at_x, at_y, heading + SECTORS_RAD[2])
    asked = heading + fuzzy_turn(x, left, front, right, bearing)
    for k in range(BEAMS // 2):
        for side in (1.0, -1.0):
            angle = asked + side * 2.0 * math.pi * k / BEAMS
            ux, uy = math.cos(angle), math.sin(angle)
            if free_range(view, at_x, at_y, ux, uy) >= view.step_m:
                return angle
    return np.nan


@njit(cache=True)
def evasive_heading(view: LocalView, asked: float) -> float:
    """Find the free heading nearest to the requested one that meets no mover.

    Args:
        view: What the robot knows.
        asked: Heading that the controller requests, rad, map frame.

    Returns:
        Heading, rad, map frame; if every free heading meets a mover, the least threatened one.
    """
    least, best = np.inf, asked
    for k in range(BEAMS // 2):
        for side in (1.0, -1.0):
            angle = asked + side * 2.0 * math.pi * k / BEAMS
            ux, uy = math.cos(angle), math.sin(angle)
            if free_range(view, view.x, view.y, ux, uy) >= view.step_m:
                danger = collision_threat(view, view.step_m * ux, view.step_m * uy)
                if danger < least:
                    least, best = danger, angle
                if danger == 0.0:
                    return angle
    return best


@njit(cache=True)
def walk_cost(
    view: LocalView, at_x: float, at_y: float, nearest: float, turned: float, danger: float
) -> float:
    """Compute the cost of a simulated walk from where it ends and what it met.

    Args:
        view: What the robot knows.
        at_x: x of its end, m, map frame.
        at_y: y of its end, m, map frame.
        nearest: Least distance to an obstacle or a mover on it, m.
        turned: Sum of its turns, rad.
        danger: Threat of the movers on its first step, see `collision_threat`.

    Returns:
        The cost.
    """
    left = math.hypot(view.target_x - at_x, view.target_y - at_y) / view.step_m
    cost = (
        GOAL_WEIGHT * left
        + OBSTACLE_WEIGHT * view.safe_m / max(nearest, 1e-3 * view.safe_m)
        + TURN_WEIGHT * turned
    )
    return cost + BLOCKED_COST * danger


@njit(cache=True)
def controller_cost(view: LocalView, x: FloatArray, heading: float) -> float:
    """Compute the cost of a controller after `SIMULATED_STEPS` steps in what is sensed now.

    The cost is Eq. 5 of Abed 2022: distance to the target at the end, least clearance and summed
    turning along the simulated path.

    Args:
        view: What the robot knows.
        x: (7,) parameters of the controller.
        heading: Present heading, rad, map frame.

    Returns:
        Cost, without unit.
    """
    at_x, at_y, turned, nearest = view.x, view.y, 0.0, view.reach_m
    danger = 0.0
    for n in range(SIMULATED_STEPS):
        angle = controller_heading(view, x, at_x, at_y, heading)
        if not math.isfinite(angle):
            return 2.0 * BLOCKED_COST
        # Predictions of movers start now, so only the first step can be checked against them.
        if n == 0:
            vx, vy = view.step_m * math.cos(angle), view.step_m * math.sin(angle)
            danger = collision_threat(view, vx, vy)
        turned += abs((angle - heading + math.pi) % (2.0 * math.pi) - math.pi)
        heading = angle
        at_x += view.step_m * math.cos(angle)
        at_y += view.step_m * math.sin(angle)
        nearest = min(
            nearest,
            nearest_point_distance(view, at_x, at_y),
            nearest_mover_distance(view, at_x, at_y),
        )
        if math.hypot(view.target_x - at_x, view.target_y - at_y) < view.step_m:
            break
    return walk_cost(view, at_x, at_y, nearest, turned, danger)


@njit(cache=True)
def controller_costs(view: LocalView, x: FloatArray, heading: float, out: FloatArray) -> None:
    """Compute the costs of several controllers.

    Args:
        view: What the robot knows.
        x: (n, 7) parameters of the controllers.
        heading: Present heading, rad, map frame.
        out: (n,) receives the costs.
    """
    for k in range(x.shape[0]):
        out[k] = controller_cost(view, x[k], heading)


class _ControllerObjective:
    """An `Objective` over a controller's seven parameters."""

    def __init__(self, view: LocalView, heading: float) -> None:
        self._view, self._heading = view, heading
        self.low, self.high = LOW, HIGH

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        controller_costs(self._view, x, self._heading, out)


class FuzzySteering:
    """A `Steering` that uses a fuzzy controller and tunes it again every few steps."""

    def __init__(self) -> None:
        self.evaluations = 0
        self._tuned = 0.5 * (LOW + HIGH)
        self._age = 0

    def heading(self, view: LocalView, heading: float, state: State) -> float:
        """Tune the controller if it is due, then compute its heading.

        The present controller takes part in the tuning, so only a better one replaces it. Near
        movers it is tuned in every step.

        Args:
            view: What the robot knows.
            heading: The robot's present heading, rad, map frame.
            state: (1,) random state, advanced.

        Returns:
            Heading, rad, map frame.
        """
        if self._age % RETUNE_STEPS == 0 or len(view.movers):
            self.evaluations += self._tune(view, heading, state)
        self._age += 1
        angle = controller_heading(view, self._tuned, view.x, view.y, heading)
        angle = angle if math.isfinite(angle) else heading
        return evasive_heading(view, angle) if len(view.movers) else angle

    def _tune(self, view: LocalView, heading: float, state: State) -> int:
        """Tune the controller and return the number of controllers that were evaluated."""
        objective = _ControllerObjective(view, heading)
        population = Population(objective, AGENTS, AGENTS * (1 + ITERATIONS), state)
        minimise(WindDriven(), population, self._tuned[None])
        self._tuned = population.best_x.copy()
        return population.spent
