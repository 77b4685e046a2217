"""The step-by-step planners as planners of the closed loop: they walk the view that the robot has.

Source: Abed, Lutfy & Al-Doori 2022 (AVOA, with the sensing phase), whose rivals are APSO and
fuzzy-WDO. The robot's map takes the place of the unknown world: a point walks through it from the
robot to the goal, senses it within reach only, and its trace is the plan. Movers are not
in the map; see `simloop.planners.reactive.online` for those.

Filled in: a step is a tenth of a metre at the robot's size (.4 safe distances) and it senses
over twelve safe distances (3.1 m); ten times the straight way is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from simloop.messages import WorldView
from simloop.planners.metaheuristics.rule_avoa import AfricanVultures
from simloop.planners.metaheuristics.rule_swarm import AdaptiveSwarm
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.fuzzy import FuzzySteering
from simloop.planners.reactive.online import Senses, box_of, kept
from simloop.planners.reactive.rollout import Walk, WalkingPlanner
from simloop.planners.reactive.sensing import Look
from simloop.planners.reactive.steering import RuleSteering
from simloop.planners.reactive.walker import Steering, Walker
from simloop.planners.splitmix import State, make_state

STEP_SAFE, REACH_SAFE = 0.4, 12.0
_ALLOWED = 10.0
_LEAST_STEPS = 50
_WAITS = 3
_NO_MOVERS = np.zeros((0, 5))


class OnlinePlanner(WalkingPlanner):
    """A steering of its own for each walk; what does not arrive ends where it came nearest."""

    def steering(self) -> Steering:
        """What chooses the headings."""
        raise NotImplementedError

    def _walker(self, world: WorldView, rng: np.random.Generator) -> Callable[[Problem, int], Walk]:
        state = make_state(rng)
        return lambda p, attempt: self._walk(p, state)

    def _walk(self, p: Problem, state: State) -> Walk:
        safe_m, box = kept(p), box_of(p)
        step_m, reach_m = STEP_SAFE * p.safe_m, REACH_SAFE * p.safe_m
        senses = Senses(p, reach_m, box, safe_m)
        here, goal = np.array([p.start_x, p.start_y]), np.array([p.goal_x, p.goal_y])
        left = math.dist(here, goal)
        walker = Walker(self.steering(), state, math.atan2(*(goal - here)[::-1]))
        path, waits = [here], 0
        allowed = _LEAST_STEPS + int(_ALLOWED * left / step_m)
        while left > 0.0 and len(path) <= allowed and waits < _WAITS:
            points = senses.points(*here)
            (x, y), (goal_x, goal_y) = here, goal
            look = Look(points, _NO_MOVERS, x, y, goal_x, goal_y, safe_m, step_m, reach_m, box)
            there = walker.step(look, goal)
            waits = waits + 1 if np.array_equal(there, here) else 0
            here, left = there, math.dist(there, goal)
            if not waits:
                path.append(here)
        trace = np.array(path)
        if left > 0.0:
            nearest = int(np.argmin(np.hypot(*(trace - goal).T)))
            trace = trace[: nearest + 1]
        return Walk(trace, left == 0.0, walker.evaluations)


class AvoaOnline(OnlinePlanner):
    """African vultures choose each heading."""

    name = "avoa_online"

    def steering(self) -> Steering:
        return RuleSteering(AfricanVultures)


class ApsoOnline(OnlinePlanner):
    """The adaptive swarm does: the rival in four of the paper's five maps."""

    name = "apso_online"

    def steering(self) -> Steering:
        return RuleSteering(AdaptiveSwarm)


class FuzzyWdo(OnlinePlanner):
    """A fuzzy controller does, tuned by wind driven optimisation: the rival in the first map."""

    name = "fuzzy_wdo"

    def steering(self) -> Steering:
        return FuzzySteering()
