"""A point's trace is bent where the vehicle's ends would come too near to an obstacle."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.paths import plan_of

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import WorldView
from simloop.planners.problem.account import lack_of
from simloop.planners.problem.clearance import make_problem
from simloop.planners.protocol import PlanningTask
from simloop.planners.reactive.overhang_room import with_room
from simloop.planners.reactive.rollout import Rollout, RolloutPlanner
from simloop.planners.registry import make_planner

SAFE_M, OVERHANG_M, CELL_M = 0.26, 0.16, 0.05
WALLS = ((1.5, 2.1, -4.0, 0.4), (1.5, 2.1, 1.15, 4.0))
"""x and y from, to, m. The gap of 0.75 m is too narrow for the overhang on both sides."""
START, GOAL = np.array([-2.0, -2.0, 0.0]), np.array([3.5, 2.0])


def room(walls=WALLS):
    """A view of a room of 8 m with walls, as an exact distance field."""
    centres = -4.0 + CELL_M * (np.arange(160) + 0.5)
    x, y = np.meshgrid(centres, centres)
    distance = np.minimum(4.0 - np.abs(x), 4.0 - np.abs(y))
    for left, right, low, high in walls:
        aside = np.maximum(np.maximum(left - x, x - right), 0.0)
        above = np.maximum(np.maximum(low - y, y - high), 0.0)
        distance = np.minimum(distance, np.hypot(aside, above))
    field = np.maximum(distance, 0.0).astype(np.float32)
    bounds = np.array([-4.0, -4.0, 4.0, 4.0])
    return WorldView(0, bounds[:2], CELL_M, field, np.zeros((0, 3)), bounds)


def problem(overhang_m=OVERHANG_M):
    return make_problem(room(), START, GOAL, safe_m=SAFE_M, overhang_m=overhang_m)


def walk_to_the_wall_and_through_the_gap():
    """A trace that turns at 0.3 m from the wall, as a point may."""
    corners = np.array([START[:2], (1.2, -2.0), (1.2, 0.775), (2.4, 0.775), GOAL])
    legs = [np.linspace(a, b, 40)[:-1] for a, b in pairwise(corners)]
    return np.concatenate([*legs, [GOAL]])


def test_a_trace_is_bent_until_the_ends_of_the_vehicle_have_room():
    trace = walk_to_the_wall_and_through_the_gap()
    assert lack_of(problem(0.0), trace) == 0.0  # safe for a point
    assert lack_of(problem(), trace) > 0.05
    bent = with_room(problem(), trace)
    assert lack_of(problem(), bent) == 0.0
    np.testing.assert_allclose(bent[[0, -1]], trace[[0, -1]])


def test_it_stays_where_nothing_is_missing_and_on_its_side():
    trace = walk_to_the_wall_and_through_the_gap()
    bent = with_room(problem(), trace)
    inside = bent[(bent[:, 0] > 1.5) & (bent[:, 0] < 2.1)]
    assert len(inside) and (inside[:, 1] > 0.4).all() and (inside[:, 1] < 1.15).all()
    far = bent[bent[:, 0] < 0.0]
    np.testing.assert_allclose(far[:, 1], -2.0, atol=1e-9)
    straight = np.linspace(START[:2], (-2.0, 3.0), 30)
    assert np.abs(with_room(problem(), straight)[:, 0] + 2.0).max() < 1e-12


@pytest.mark.parametrize("name", ["avoa_online", "ga_apf"])
def test_a_walker_leads_the_vehicle_through_a_gap_that_grown_obstacles_would_close(name):
    assert 2.0 * (SAFE_M + OVERHANG_M) > 0.75 > 2.0 * (SAFE_M + 0.04)
    planner = make_planner(PlannerConfig(name=name), VehicleConfig())
    task = PlanningTask(room(), START, GOAL, SAFE_M)
    for seed in range(3):
        plan = planner.plan(task, np.random.default_rng(seed))
        assert plan.safe and plan.length_m < 12.0


class Stands(RolloutPlanner):
    """A walker that never finds a way, so that only the last one is left."""

    name, keeps_way = "stands", True

    def _make_rollout(self, world, rng):
        return lambda p, attempt, most_m: Rollout(np.array([[p.start_x, p.start_y]]), False, 1)


def test_a_kept_way_bends_where_the_wall_turns_out_to_be_nearer():
    config, vehicle, rng = PlannerConfig(), VehicleConfig(), np.random.default_rng(0)
    trace = walk_to_the_wall_and_through_the_gap()
    task = PlanningTask(room(), np.array([-1.0, -2.0, 0.0]), GOAL, SAFE_M, plan_of(trace))
    kept = Stands(config, vehicle).plan(task, rng)
    assert kept.safe and kept.length_m < 8.0
    assert not Stands(config, vehicle).plan(replace(task, previous=None), rng).safe


def test_a_walk_goes_on_along_its_surface_where_the_last_way_is_blocked():
    """The wall is longer than the last view showed; a new walk would turn back along it."""
    goal, wall = np.array([3.5, -1.0]), (1.5, 2.1, -3.0, 1.6)
    last = plan_of([(1.1, 0.0), (1.1, 1.2), (2.4, 1.3), goal])
    task = PlanningTask(room([wall]), np.array([1.1, 0.6, 1.5]), goal, SAFE_M)
    planner = make_planner(PlannerConfig(name="avoa_online"), VehicleConfig())
    for seed in range(3):
        anew = planner.plan(task, np.random.default_rng(seed))
        on = planner.plan(replace(task, previous=last), np.random.default_rng(seed))
        assert anew.safe and anew.waypoints_m[:, 1].min() < -3.0 and anew.length_m > 7.0
        assert on.safe and on.waypoints_m[:, 1].max() > 1.6 and on.length_m < 6.5


def test_obstacles_do_not_grow_over_the_goal():
    planner = make_planner(PlannerConfig(name="avoa_online"), VehicleConfig())
    goal = np.array([1.2, -2.0])  # 0.3 m from the wall: within the safe distance and the overhang
    plan = planner.plan(PlanningTask(room(), START, goal, SAFE_M), np.random.default_rng(0))
    straight = goal[0] - START[0]
    steps = straight / (0.4 * SAFE_M)
    assert plan.length_m < 1.1 * straight
    assert plan.evaluations < 110 * 2 * 1.2 * steps  # at most two walks, and none of them circles


def test_the_deformed_field_leads_a_vehicle_backwards_out_of_a_pocket():
    """By construction it cannot do so itself: genes turn the attraction by 90 degrees at most."""
    pocket = ((1.0, 1.3, -1.2, 1.2), (-0.6, 1.3, 1.2, 1.5), (-0.6, 1.3, -1.5, -1.2))
    task = PlanningTask(room(pocket), np.array([0.5, 0.0, 0.0]), np.array([3.0, 0.0]), SAFE_M)
    config, rng = PlannerConfig(name="ga_apf"), np.random.default_rng(0)
    point = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
    assert not make_planner(config, point).plan(task, rng).safe
    plan = make_planner(config, VehicleConfig()).plan(task, rng)
    assert plan.safe and plan.waypoints_m[:, 0].min() < -0.5
