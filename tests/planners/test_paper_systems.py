"""Each paper's system on the scenes of its own paper: safe paths from any seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.scene_clearance import scene_clearance

from simloop.benchmarks.planners.paper_scenes import (
    ONLINE_SCENES,
    PAPER_SCENES,
    online_scene,
    paper_scene,
)
from simloop.benchmarks.planners.scenes import scene
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.metaheuristics.rule_avoa import AfricanVultures
from simloop.planners.metaheuristics.rule_swarm import AdaptiveSwarm
from simloop.planners.problem.account import lack_of, problem_of
from simloop.planners.problem.clearance import SAFE_WITHIN_M
from simloop.planners.protocol import PlanningTask
from simloop.planners.reactive.fuzzy import FuzzySteering
from simloop.planners.reactive.online import simulate
from simloop.planners.reactive.steering import RuleSteering
from simloop.planners.registry import make_planner

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
SHORTEST = {"length_weight": 1.0, "turning_weight": 0.0}
SABIHA = [(name, "sabiha4", {}) for name in ("tlbo_paper", "tlbo", "ga", "pso", "ga_pso")]
WU = [(name, "wu180", SHORTEST) for name in ("niwtlbo", "tlbo_elitist", "pso", "abc", "de")]
MOHAMED = [("ga_apf", name, SHORTEST) for name in ("strip20x60", "abed5", "abed50", "abed150")]
STEERINGS = {
    "avoa": lambda: RuleSteering(AfricanVultures),
    "apso": lambda: RuleSteering(AdaptiveSwarm),
    "fuzzy_wdo": FuzzySteering,
}
QUICK, MANY = 2, 50


def plan(name, one, seed, **settings):
    config = PlannerConfig(name=name, safe_distance_m=one.safe_m, start_turn_weight=0.0, **settings)
    rng = np.random.default_rng(seed)
    return make_planner(config, POINT).plan(
        PlanningTask(one.world, one.start, one.goal, one.safe_m), rng
    )


def is_safe(one, found):
    """Whether a plan reaches the goal and keeps the safe distance everywhere, by samples."""
    clear = scene_clearance(one, found.waypoints_m, 2e-3 * one.safe_m)
    return clear >= one.safe_m - SAFE_WITHIN_M and np.allclose(found.waypoints_m[-1], one.goal)


def share_safe(name, where, settings, seeds):
    one = paper_scene(where)
    return np.mean([is_safe(one, plan(name, one, seed, **settings)) for seed in seeds])


def share_arrived(steering, where, seeds):
    runs = [simulate(online_scene(where), STEERINGS[steering](), np.random.default_rng(seed))
             for seed in seeds]  # fmt: skip
    return np.mean([run.reached and run.collisions == 0 for run in runs])


@pytest.mark.parametrize(("name", "where", "settings"), SABIHA + WU + MOHAMED[:2])
def test_a_system_finds_a_safe_path_on_its_papers_scene(name, where, settings):
    assert share_safe(name, where, settings, range(1000, 1000 + QUICK)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "where", "settings"), SABIHA + WU + MOHAMED)
def test_a_system_finds_a_safe_path_from_nearly_every_seed(name, where, settings):
    assert share_safe(name, where, settings, range(2000, 2000 + MANY)) >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("where", ["abed50", "abed150"])
def test_the_deformed_field_crosses_newly_drawn_maps(where):
    todo = [(paper_scene(where, seed), seed) for seed in range(1, 1 + MANY)]
    assert np.mean([is_safe(one, plan("ga_apf", one, s, **SHORTEST)) for one, s in todo]) >= 0.95


@pytest.mark.parametrize("where", ONLINE_SCENES)
@pytest.mark.parametrize("steering", STEERINGS)
def test_a_steering_crosses_an_unknown_world(steering, where):
    assert share_arrived(steering, where, range(1000, 1001)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("where", ONLINE_SCENES)
@pytest.mark.parametrize("steering", STEERINGS)
def test_a_steering_crosses_an_unknown_world_from_nearly_every_seed(steering, where):
    assert share_arrived(steering, where, range(2000, 2000 + MANY)) >= 0.95


def test_the_plain_field_stops_in_the_local_minimum():
    one = paper_scene("local_minimum")
    found = plan("potential_field", one, 0)
    assert not found.safe and np.hypot(*(found.waypoints_m[-1] - one.goal)) > 10.0


def test_checking_only_the_waypoints_lets_paths_through_obstacles():
    """Eq. 8 of the TLBO papers checks only the waypoints; the planner reports an unsafe path."""
    one = paper_scene("sabiha4")
    for seed in range(1000, 1003):
        found = plan("tlbo_paper", one, seed, options={"examined": 0})
        assert not found.safe and not is_safe(one, found)


def test_obstacles_between_the_examined_points_are_missed():
    """The more points of a segment are examined, the less it cuts corners; it always does a bit."""
    one = paper_scene("sabiha4")
    lacks = []
    for examined in (1, 30):
        paths = [plan("tlbo_paper", one, s, options={"examined": examined}) for s in range(3)]
        clear = min(scene_clearance(one, p.waypoints_m, 1e-3) for p in paths)
        lacks.append(one.safe_m - clear)
    assert lacks[0] > 0.01 and 0.0 < lacks[1] < SAFE_WITHIN_M


def test_the_printed_rule_depends_on_where_the_origin_is():
    """In a shifted world the results differ: T_f = 2 moves the class relative to the origin."""
    one, costs = paper_scene("sabiha4"), []
    for shift in (np.zeros(2), np.array([60.0, 60.0])):
        world = one.world
        shift_3 = np.array([*shift, 0.0])
        discs = world.discs_xyr_m + shift_3
        moved = replace(
            one,
            world=replace(world, discs_xyr_m=discs, bounds_m=world.bounds_m + np.tile(shift, 2)),
            start=one.start + shift_3,
            goal=one.goal + shift,
        )
        settings = {"idle_generations": 1000, "max_evaluations": 3000}
        costs.append([plan("tlbo_paper", moved, seed, **settings).cost for seed in range(12)])
    assert np.median(costs[1]) > 1.02 * np.median(costs[0])


def test_every_scene_is_fixed_and_its_ends_are_free():
    for name in PAPER_SCENES:
        one, again = paper_scene(name), paper_scene(name)
        assert one.world.discs_xyr_m.tobytes() == again.world.discs_xyr_m.tobytes()
        ends = np.array([one.start[:2], one.goal])
        for end in ends:
            assert scene_clearance(one, np.array([end, end]), 1.0) >= one.safe_m
        low, high = one.world.bounds_m[:2], one.world.bounds_m[2:]
        assert (ends >= low).all() and (ends <= high).all()
    with pytest.raises(ValueError, match="choose from sabiha4"):
        paper_scene("atlantis")
    with pytest.raises(ValueError, match="choose from narrow"):
        online_scene("atlantis")


def test_the_printed_rule_plans_for_a_point():
    """Paths that keep d_safe from base_link may be too narrow for the vehicle's front and rear."""
    one, narrow = scene("S1")[0], 0
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    config = PlannerConfig(name="tlbo_paper", safe_distance_m=one.safe_m)
    for seed in range(6):
        found = make_planner(config, VehicleConfig()).plan(task, np.random.default_rng(seed))
        narrow += (
            not found.safe and lack_of(problem_of(config, 0.0, task), found.waypoints_m) < 0.02
        )
    assert narrow > 0


def test_the_printed_rule_begins_anew_each_frame():
    one = paper_scene("sabiha4")
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    planner = make_planner(PlannerConfig(name="tlbo_paper", safe_distance_m=one.safe_m), POINT)
    old = plan("tlbo", one, 0)
    fresh, again = (
        planner.plan(replace(task, previous=previous), np.random.default_rng(1))
        for previous in (None, old)
    )
    assert old.safe and fresh.waypoints_m.tobytes() == again.waypoints_m.tobytes()


@pytest.mark.parametrize("seed", range(3))
def test_a_path_that_leaves_the_strip_of_known_discs_is_not_taken(seed):
    """The deformed field knows the discs near the line to the goal; others block the way too."""
    for one in scene("S3"):
        assert is_safe(one, plan("ga_apf", one, seed))
