"""A plan's account is the common objective's, whichever planner made it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simloop.benchmarks.planners.scenes import box_world, disc_world
from simloop.common.errors import InputError
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners import registry
from simloop.planners.problem.account import problem_of
from simloop.planners.problem.objective import evaluate, make_stack
from simloop.planners.protocol import PlanningTask

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
BOX = (0.0, 0.0, 5.0, 5.0)
WEIGHT = 0.2
START, GOAL = np.array([0.5, 0.5, -2.0]), np.array([4.5, 4.5])
DISCS = disc_world([[2.5, 2.4, 0.4]], BOX)
FIELD = box_world(np.array([[2.2, 2.1, 2.8, 2.7]]), 5.0, 0.05)


def planned(name, world, **settings):
    """A plan by the planner of that name, and its task's problem."""
    settings = {"max_evaluations": 1500, "learners": 20, "start_turn_weight": WEIGHT} | settings
    config = PlannerConfig(name=name, **settings)
    try:
        planner = registry.make_planner(config, POINT)
    except InputError as error:
        pytest.skip(str(error))
    task = PlanningTask(world, START, GOAL, 0.3)
    plan = planner.plan(task, np.random.default_rng(5))
    return plan, problem_of(config, 0.0, task)


@pytest.mark.parametrize("name", registry.available())
@pytest.mark.parametrize("world", [DISCS, FIELD], ids=["discs", "field"])
def test_the_cost_of_a_plan_is_j_with_the_turn_at_the_start(name, world):
    plan, problem = planned(name, world)
    path = np.array(plan.waypoints_m)
    first = path[1] - path[0]
    turn = abs(math.remainder(math.atan2(first[1], first[0]) - START[2], 2.0 * math.pi))
    assert plan.start_turn_cost == pytest.approx(WEIGHT * turn, abs=1e-9) and turn > 1.0
    assert plan.path_cost == pytest.approx(plan.cost - plan.start_turn_cost, abs=1e-12)
    if np.array_equal(path[-1], GOAL):  # else what is left of the way is priced, too
        j = evaluate(problem, path, len(path), np.inf, make_stack())
        assert plan.cost == pytest.approx(j, abs=1e-9)


@pytest.mark.parametrize("name", ["de", "ga", "niwtlbo"])
def test_a_history_ends_with_the_cost_of_the_plan(name):
    plan, _ = planned(name, DISCS)
    assert plan.history[-1, 1] == pytest.approx(plan.cost, abs=1e-9)


def test_what_is_lacking_is_in_the_cost_at_the_price_of_the_penalty():
    wall = box_world(np.array([[2.4, -1.0, 2.6, 6.0]]), 5.0, 0.05)
    dear, _ = planned("tlbo", wall, penalty=60.0)
    assert not dear.safe
    plain = 0.65 * dear.length_m + 0.35 * dear.turning_rad + dear.start_turn_cost
    assert dear.cost > plain + 60.0 * 0.01
