"""The step-by-step planners as planners of the closed loop.

Source: Abed, Lutfy & Al-Doori 2022 (AVOA with a sensing phase), with its rivals APSO and
fuzzy-WDO. The robot's map replaces the unknown world: a point moves through it from the robot to
the goal and senses it only within its range. The trace of the point is the plan. The map contains
no movers; `simloop.planners.reactive.online` simulates worlds with movers.

Chosen here: a step is 0.4 safe distances (0.1 m at the robot's size), the sensor's range is twelve
safe distances (3.1 m), and a path may be ten times as long as the straight line. A walk also ends
when it has circled an obstacle both ways round without finding a place to leave it. Where the last
plan turns out to be blocked, a second walk goes on from there along the surface that the point
followed, because a robot that decided step by step would do so. The cheaper walk is used.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.controller_search import CompiledFuzzySteering
from simloop.planners.reactive.heading_search import swarm_steering, vulture_steering
from simloop.planners.reactive.online import RangeSensor, motion_box, padded_safe_distance
from simloop.planners.reactive.rollout import RollOut, Rollout, RolloutPlanner, clear_part
from simloop.planners.reactive.sensing import LocalView
from simloop.planners.reactive.stepper import Steering, Stepper
from simloop.planners.splitmix import State, make_state

STEP_SAFE, REACH_SAFE = 0.4, 12.0
_ALLOWED_DETOUR = 10.0
_LEAST_STEPS = 50
_MOST_WAITS = 3
_BOTH_WAYS = 2
_NO_MOVERS = np.zeros((0, 5))


class OnlinePlanner(RolloutPlanner):
    """Plans with a new steering each time; a failed plan ends where the point was nearest."""

    keeps_way = True

    def steering(self) -> Steering:
        """Make the object that chooses the headings.

        Returns:
            A new steering without memory of earlier steps.
        """
        raise NotImplementedError

    def _make_rollout(self, world: WorldView, rng: np.random.Generator) -> RollOut:
        state = make_state(rng)
        return lambda p, attempt, most_m: self._roll_out(p, state, most_m)

    def _make_continuation(
        self, problem: Problem, way: FloatArray, rng: np.random.Generator
    ) -> RollOut | None:
        begun, state = clear_part(problem, way), make_state(rng)
        if len(begun) < 2:
            return None
        return lambda p, attempt, most_m: self._roll_out(p, state, most_m, begun)

    def _roll_out(
        self, p: Problem, state: State, most_m: float, begun: FloatArray | None = None
    ) -> Rollout:
        """Step to the goal, until the steps are used up, or the point is stuck.

        Steps are also used up after ``most_m`` m. ``begun`` (n >= 2, 2) is a way that the point has
        already gone along a surface.
        """
        safe_m, box = padded_safe_distance(p), motion_box(p)
        step_m, reach_m = STEP_SAFE * p.safe_m, REACH_SAFE * p.safe_m
        sensor = RangeSensor(p, reach_m, box, safe_m)
        path = [np.array([p.start_x, p.start_y])] if begun is None else list(begun)
        here, goal = path[-1], np.array([p.goal_x, p.goal_y])
        left = math.dist(here, goal)
        ahead = goal - here if begun is None else here - path[-2]
        stepper = Stepper(self.steering(), state, math.atan2(ahead[1], ahead[0]))
        waits, goes_on = 0, begun is not None
        longest_m = min(_ALLOWED_DETOUR * left, max(most_m, left))
        allowed = len(path) + _LEAST_STEPS + int(longest_m / step_m)
        while left > 0.0 and len(path) <= allowed and waits < _MOST_WAITS:
            if stepper.circled >= _BOTH_WAYS:
                break
            points = sensor.points(*here)
            (x, y), (goal_x, goal_y) = here, goal
            view = LocalView(points, _NO_MOVERS, x, y, goal_x, goal_y, safe_m, step_m, reach_m, box)
            if goes_on:
                stepper.go_on_along_surface(view)
                goes_on = False
            there = stepper.step(view, goal)
            waits = waits + 1 if np.array_equal(there, here) else 0
            here, left = there, math.dist(there, goal)
            if not waits:
                path.append(here)
        trace = np.array(path)
        if left > 0.0:
            nearest = int(np.argmin(np.hypot(*(trace - goal).T)))
            trace = trace[: nearest + 1]
        return Rollout(trace, left == 0.0, stepper.evaluations)


class AvoaOnline(OnlinePlanner):
    """African vultures optimisation chooses each heading."""

    name = "avoa_online"

    def steering(self) -> Steering:
        """Make a steering that searches by AVOA.

        Returns:
            The steering; see `OnlinePlanner.steering`.
        """
        return vulture_steering()


class ApsoOnline(OnlinePlanner):
    """The adaptive particle swarm chooses each heading: the rival in maps 2 to 5 of the paper."""

    name = "apso_online"

    def steering(self) -> Steering:
        """Make a steering that searches by APSO.

        Returns:
            The steering; see `OnlinePlanner.steering`.
        """
        return swarm_steering()


class FuzzyWdo(OnlinePlanner):
    """A fuzzy controller, tuned by WDO, chooses each heading: the rival in map 1 of the paper."""

    name = "fuzzy_wdo"

    def steering(self) -> Steering:
        """Make a fuzzy steering.

        Returns:
            The steering with untuned parameters; see `OnlinePlanner.steering`.
        """
        return CompiledFuzzySteering()
