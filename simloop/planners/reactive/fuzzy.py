"""A fuzzy heading controller whose membership functions wind driven optimisation tunes.

Abed 2022 only names this rival, "Hybrid Fuzzy-WDO" (Pandey & Parhi 2017): a controller with
singleton outputs from the distances of obstacles in front, at the left and at the right, tuned by
WDO (Bayraktar 2013). All else is filled in, and is ours:

- Inputs: the free range in three sectors (each near or far) and the target's bearing (left, ahead,
  right): 24 rules. Output: a turn, one of five singletons, by the weighted mean of the rules'
  outputs.
- Rules: where the front is far, turn to the target, less so to a near side; where it is near, turn
  hard to the side that is far, and to the target's if both or neither are.
- Tuned: where near ends and far begins (front, sides), the bearing that counts as a side, the two
  sizes of turn. WDO tries controllers by rolling each some steps ahead over what is sensed now,
  every few steps; the cost is Eq. 5 at the end of the roll and the least clearance on it.
- The controller's heading is turned to the nearest one that keeps the safe distance for a step, and
  from what moves for some; where none does, to the one that does so best.
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
    Look,
    free_range,
    nearest_mover,
    nearest_point,
    threat,
)
from simloop.planners.reactive.steering import AGENTS, CLEAR, ITERATIONS, NEAR_GOAL, STRAIGHT
from simloop.planners.reactive.walker import BLOCKED
from simloop.planners.splitmix import State

ROLL_STEPS = 6
RETUNE_STEPS = 2
_SECTOR_RAYS = 5
_HALF_SECTOR_RAD = 0.5
_SECTORS_RAD = (1.1, 0.0, -1.1)
# front near, far (in steps); sides near, far; bearing of a side, rad; small and hard turn, rad
_LOW = np.array([1.0, 3.0, 1.0, 2.0, 0.2, 0.1, 0.5])
_HIGH = np.array([3.0, 12.0, 2.0, 6.0, 1.2, 1.5, 2.5])


@njit(cache=True)
def sector_range(look: Look, x: float, y: float, middle: float) -> float:
    """The least free range among the rays of a sector about the direction ``middle``, in steps."""
    least = np.inf
    for k in range(_SECTOR_RAYS):
        angle = middle + _HALF_SECTOR_RAD * (2.0 * k / (_SECTOR_RAYS - 1) - 1.0)
        least = min(least, free_range(look, x, y, math.cos(angle), math.sin(angle)))
    return least / look.step


@njit(cache=True)
def far(value: float, low: float, high: float) -> float:
    """Membership in "far": 0 up to low, 1 from high on; that in "near" is what is left."""
    high = max(high, low + 0.1)
    return min(max((value - low) / (high - low), 0.0), 1.0)


@njit(cache=True)
def rule_turn(left: int, front: int, right: int, side: int) -> int:
    """Turn of one rule, -2 (hard right) to 2 (hard left). left, front, right: 1 far, 0 near; side:
    where the target is, 1 left, 0 ahead, -1 right."""
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
    """Turn, rad, of a controller with parameters x (7,). left, front, right: free ranges in steps;
    bearing: the target's, off the present heading, rad."""
    fars = (far(left, x[2], x[3]), far(front, x[0], x[1]), far(right, x[2], x[3]))
    ahead = max(0.0, 1.0 - abs(bearing) / x[4])
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                near = (fars[0] if a else 1.0 - fars[0]) * (fars[1] if b else 1.0 - fars[1])
                near *= fars[2] if c else 1.0 - fars[2]
                for side in (-1, 0, 1):
                    weight = ahead if side == 0 else (1.0 - ahead if side * bearing > 0.0 else 0.0)
                    turn = rule_turn(a, b, c, side)
                    size = x[5] if abs(turn) == 1 else x[6]
                    total += near * weight * size * np.sign(turn)
    return total


@njit(cache=True)
def steer(look: Look, x: FloatArray, at_x: float, at_y: float, heading: float) -> float:
    """The controller's heading at a place, rad; turned to the nearest one that is free for a step,
    NaN where none is."""
    bearing = math.atan2(look.target_y - at_y, look.target_x - at_x) - heading
    bearing = (bearing + math.pi) % (2.0 * math.pi) - math.pi
    left = sector_range(look, at_x, at_y, heading + _SECTORS_RAD[0])
    front = sector_range(look, at_x, at_y, heading + _SECTORS_RAD[1])
    right = sector_range(look, at_x, at_y, heading + _SECTORS_RAD[2])
    asked = heading + fuzzy_turn(x, left, front, right, bearing)
    for k in range(BEAMS // 2):
        for side in (1.0, -1.0):
            angle = asked + side * 2.0 * math.pi * k / BEAMS
            ux, uy = math.cos(angle), math.sin(angle)
            if free_range(look, at_x, at_y, ux, uy) >= look.step:
                return angle
    return np.nan


@njit(cache=True)
def evade(look: Look, asked: float) -> float:
    """The heading nearest to ``asked``, rad, that is free for a step and meets nothing that moves;
    where all would, the one that is least threatened."""
    least, best = np.inf, asked
    for k in range(BEAMS // 2):
        for side in (1.0, -1.0):
            angle = asked + side * 2.0 * math.pi * k / BEAMS
            ux, uy = math.cos(angle), math.sin(angle)
            if free_range(look, look.x, look.y, ux, uy) >= look.step:
                danger = threat(look, look.step * ux, look.step * uy)
                if danger < least:
                    least, best = danger, angle
                if danger == 0.0:
                    return angle
    return best


@njit(cache=True)
def roll_cost(look: Look, x: FloatArray, heading: float) -> float:
    """Eq. 5 of a controller (7,) after `ROLL_STEPS` steps over what is sensed now."""
    at_x, at_y, turned, near = look.x, look.y, 0.0, look.reach
    danger = 0.0
    for n in range(ROLL_STEPS):
        angle = steer(look, x, at_x, at_y, heading)
        if not math.isfinite(angle):
            return 2.0 * BLOCKED
        if n == 0:
            danger = threat(look, look.step * math.cos(angle), look.step * math.sin(angle))
        turned += abs((angle - heading + math.pi) % (2.0 * math.pi) - math.pi)
        heading = angle
        at_x += look.step * math.cos(angle)
        at_y += look.step * math.sin(angle)
        near = min(near, nearest_point(look, at_x, at_y), nearest_mover(look, at_x, at_y))
        if math.hypot(look.target_x - at_x, look.target_y - at_y) < look.step:
            break
    left = math.hypot(look.target_x - at_x, look.target_y - at_y) / look.step
    cost = NEAR_GOAL * left + CLEAR * look.safe / max(near, 1e-3 * look.safe) + STRAIGHT * turned
    return cost + BLOCKED * danger


@njit(cache=True)
def roll_costs(look: Look, x: FloatArray, heading: float, out: FloatArray) -> None:
    """Costs (n,) of controllers (n, 7)."""
    for k in range(x.shape[0]):
        out[k] = roll_cost(look, x[k], heading)


class _Controllers:
    """An `Objective`: the controllers' parameters, (7,)."""

    def __init__(self, look: Look, heading: float) -> None:
        self._look, self._heading = look, heading
        self.low, self.high = _LOW, _HIGH

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        roll_costs(self._look, x, self._heading, out)


class FuzzySteering:
    """Keeps `simloop.planners.reactive.walker.Steering`."""

    def __init__(self) -> None:
        self.evaluations = 0
        self._tuned = 0.5 * (_LOW + _HIGH)
        self._age = 0

    def heading(self, look: Look, heading: float, state: State) -> float:
        """Tune, now and then (the controller in use competes), and ask the controller."""
        if self._age % RETUNE_STEPS == 0 or len(look.movers):
            objective = _Controllers(look, heading)
            population = Population(objective, AGENTS, AGENTS * (1 + ITERATIONS), state)
            minimise(WindDriven(), population, self._tuned[None])
            self._tuned = population.best_x.copy()
            self.evaluations += population.spent
        self._age += 1
        angle = steer(look, self._tuned, look.x, look.y, heading)
        angle = angle if math.isfinite(angle) else heading
        return evade(look, angle) if len(look.movers) else angle
