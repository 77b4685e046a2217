"""The reference planners, each against an independently known optimum."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from simloop.benchmarks.planners.judge import path_cost
from simloop.benchmarks.planners.scenes import box_world, disc_world, scene, true_clearance
from simloop.common.errors import InputError
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.problem.account import problem_of
from simloop.planners.protocol import PlanningTask
from simloop.planners.reference.exact import exact_path
from simloop.planners.reference.ref_grid import spacing
from simloop.planners.reference.reference import DEAR_TRIALS, dear_budget
from simloop.planners.registry import make_planner

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
SAFE_M = 0.26
ROOM = scene("S2")[:4]


def plan(name, world, start, goal, seed=0, evaluations=4000, safe_m=SAFE_M):
    config = PlannerConfig(
        name=name, start_turn_weight=0.0, safe_distance_m=safe_m, max_evaluations=evaluations
    )
    rng = np.random.default_rng(seed)
    task = PlanningTask(world, np.array([*start, 0.0]), np.array(goal), safe_m)
    return make_planner(config, POINT).plan(task, rng)


def solve(name, one, **more):
    return plan(name, one.world, one.start[:2], one.goal, safe_m=one.safe_m, **more)


def optimum(one, turning_weight):
    found = exact_path(
        one.world.discs_xyr_m, one.world.bounds_m, one.start[:2], one.goal,
        safe_m=one.safe_m, turning_weight=turning_weight,
    )  # fmt: skip
    return found.cost if turning_weight else found.length_m


@pytest.mark.parametrize(("name", "within"), [("exact", 1e-4), ("visibility", 1e-3)])
def test_a_planner_finds_the_optimum_of_j_among_discs(name, within):
    for one in ROOM:
        found = solve(name, one)
        assert found.safe
        assert true_clearance(one, found.waypoints_m) >= one.safe_m - 1e-6
        gap = path_cost(found.waypoints_m) / optimum(one, 0.35) - 1.0
        assert -1e-6 < gap < within


def test_the_visibility_graph_around_a_square():
    corners = np.array([[3.0, -1.0], [5.0, -1.0], [5.0, 1.0], [3.0, 1.0]])
    world = replace(disc_world(np.zeros((0, 3)), (-1.0, -4.0, 9.0, 4.0)), polygons_m=(corners,))
    found = plan("visibility", world, (0.0, 0.0), (8.0, 0.0), safe_m=0.5)
    # Straight to the rounded corner, around it, along the side, and the same in reverse.
    angle = math.atan2(1.0, 3.0) + math.asin(0.5 / math.sqrt(10.0))
    length = 2.0 * math.sqrt(10.0 - 0.25) + 2.0 * 0.5 * angle + 2.0
    assert found.safe
    assert found.turning_rad == pytest.approx(2.0 * angle, rel=1e-3)
    assert found.length_m == pytest.approx(length, rel=1e-3)


def test_a_star_without_obstacles_takes_the_octile_distance():
    world = disc_world(np.zeros((0, 3)), (0.0, 0.0, 4.0, 4.0))
    config = PlannerConfig(name="astar")
    start, goal = np.array([0.5, 0.5, 0.0]), np.array([3.5, 1.5])
    task = PlanningTask(world, start, goal, config.safe_distance_m)
    step = spacing(problem_of(config, 0.0, task))
    assert step == pytest.approx(0.02)
    found = plan("astar", world, start[:2], goal)
    assert found.length_m == pytest.approx(0.02 * (50 * math.sqrt(2.0) + 100), rel=1e-9)
    straight = plan("theta_star", world, start[:2], goal)
    assert straight.length_m == pytest.approx(math.hypot(3.0, 1.0), rel=1e-9)


def test_lattice_paths_lie_between_the_optimum_and_the_octile_bound():
    for one in ROOM:
        least = optimum(one, 0.0)
        grid, any_angle = solve("astar", one), solve("theta_star", one)
        assert grid.safe and any_angle.safe
        assert least - 1e-6 < any_angle.length_m < 1.02 * least
        assert least < grid.length_m < 1.0824 * 1.02 * least


def test_a_star_reports_that_there_is_no_path():
    wall = box_world(np.array([[1.9, -1.0, 2.1, 5.0]]), 4.0, 0.05)
    found = plan("astar", wall, (1.0, 2.0), (3.0, 2.0))
    assert not found.safe


def test_cma_es_comes_near_the_optimum_within_its_budget():
    pytest.importorskip("cma")
    for one in ROOM[:2]:
        found = solve("cma", one, evaluations=6000)
        assert found.safe and found.evaluations <= 6000
        assert -1e-6 < path_cost(found.waypoints_m) / optimum(one, 0.35) - 1.0 < 0.005
        again = solve("cma", one, evaluations=6000)
        assert np.array_equal(found.waypoints_m, again.waypoints_m)


@pytest.mark.parametrize(("name", "within"), [("informed_rrt_star", 0.02), ("bit_star", 0.05)])
def test_sampling_planners_come_near_the_shortest_path(name, within):
    pytest.importorskip("ompl")
    for one in ROOM[:2]:
        found = solve(name, one, seed=1)
        assert found.safe
        assert found.evaluations < 4000 + 500
        assert -1e-6 < found.length_m / optimum(one, 0.0) - 1.0 < within
        again = solve(name, one, seed=1)
        assert np.array_equal(found.waypoints_m, again.waypoints_m)
        other = solve(name, one, seed=2)
        assert not np.array_equal(found.waypoints_m, other.waypoints_m)


@pytest.mark.parametrize("name", ["informed_rrt_star", "bit_star"])
def test_a_sampling_planner_ends_with_the_straight_line(name):
    pytest.importorskip("ompl")
    world = disc_world(np.array([[1.0, 3.0, 0.2]]), (0.0, 0.0, 4.0, 4.0))
    found = plan(name, world, (0.5, 0.5), (3.5, 1.5))
    assert found.safe and found.evaluations < 1000
    assert found.length_m == pytest.approx(math.hypot(3.0, 1.0), rel=1e-8)


@pytest.mark.parametrize("name", ["informed_rrt_star", "bit_star"])
def test_a_sampling_planner_ends_if_the_goal_is_too_close_to_an_obstacle(name):
    pytest.importorskip("ompl")
    world = disc_world(np.array([[3.0, 1.5, 0.4]]), (0.0, 0.0, 4.0, 4.0))
    assert not plan(name, world, (0.5, 0.5), (3.5, 1.5)).safe


def test_a_dear_search_keeps_to_its_own_budget_unless_it_is_to_be_precise():
    few, many = PlannerConfig(max_evaluations=500), PlannerConfig(max_evaluations=50_000)
    assert dear_budget(few) == 500
    assert dear_budget(many) == DEAR_TRIALS
    assert dear_budget(replace(many, precise=True)) == 50_000


@pytest.mark.parametrize("name", ["cma", "bit_star"])
def test_a_dear_planner_stays_within_a_frame_of_the_loop(name):
    pytest.importorskip(name if name == "cma" else "ompl")
    found = solve(name, ROOM[0], evaluations=40_000)
    assert found.safe and found.evaluations < DEAR_TRIALS + 500


@pytest.mark.parametrize("name", ["exact", "visibility"])
def test_a_reference_that_cannot_solve_a_world_reports_it(name):
    field = scene("S4a")[0]
    assert not solve(name, field).safe


@pytest.mark.parametrize(("name", "module"), [("cma", "cma"), ("bit_star", "ompl.base")])
def test_a_missing_library_is_reported_with_the_way_to_install_it(monkeypatch, name, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"pip install 'simloop\[references\]'"):
        make_planner(PlannerConfig(name=name), POINT)
