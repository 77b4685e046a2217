"""The worlds of the papers: each scenario is its paper's scene, at the scale that it states."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from simloop.benchmarks.planners.paper_scenes import online_scene
from simloop.loop import Simulation
from simloop.planners.problem.clearance import make_problem, point_clearance
from simloop.scenario.build import build_world
from simloop.scenario.catalog import scenario_files
from simloop.scenario.load import load
from simloop.worlds.floor_plan import distance_to_bounds
from simloop.worlds.movers.crowd import on_path

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import paper_scenarios as papers

_ROUNDED_M = 0.0015  # the files give positions and sizes to the millimetre
_SPEED_MPS = 0.47  # the robot's full speed, which is 0.5 units a step in the online simulator
_STEP_UNITS = 0.5
PLANNERS = {"sabiha": "tlbo_paper", "mohamed": "ga_apf", "wu": "niwtlbo", "abed": "avoa_online"}


def scale(name):
    return papers.scale_of(load(name).description)


def test_every_paper_scenario_belongs_to_a_scene():
    assert {name for name in scenario_files() if name.startswith("paper_")} == set(papers.WORLDS)


@pytest.mark.parametrize("name", papers.WORLDS)
def test_the_floor_is_the_scene_of_the_paper_at_the_stated_scale(name):
    unit_m, scenario = scale(name), load(name)
    scene, walls = papers.scene_of(name, unit_m), papers.WORLDS[name][1]
    np.testing.assert_allclose([scenario.start[:2], scenario.goal], unit_m * scene.ends, atol=5e-4)
    np.testing.assert_allclose(scenario.bounds_m, unit_m * scene.bounds, atol=5e-4)
    ahead = np.diff(scene.ends, axis=0)[0]
    assert scenario.start[2] == pytest.approx(np.arctan2(ahead[1], ahead[0]), abs=5e-4)
    # The distance to the nearest obstacle, at many places, is that of the planners' scene.
    low, high = unit_m * scene.bounds[:2], unit_m * scene.bounds[2:]
    places = np.random.default_rng(0).uniform(low, high, (500, 2))
    found = build_world(scenario).floor.clearance_m(places)
    problem = make_problem(scene.view, np.array([*scene.ends[0], 0.0]), scene.ends[1], safe_m=0.1)
    expected = np.array([unit_m * point_clearance(problem, *place) for place in places / unit_m])
    if walls:
        expected = np.minimum(expected, distance_to_bounds(places, np.array(scenario.bounds_m)))
    # Inside an obstacle only the sign matters: a box that is cut off at the bounds is less deep.
    np.testing.assert_array_equal(found < 0.0, expected < 0.0)
    free = expected > 0.0
    np.testing.assert_allclose(found[free], expected[free], atol=_ROUNDED_M)


@pytest.mark.parametrize("name", papers.WORLDS)
def test_the_narrowest_passage_on_the_papers_path_is_wide_enough(name):
    scenario, unit_m = load(name), scale(name)
    width, _ = papers.narrowest(name, unit_m)
    config = scenario.config
    assert unit_m * width > 2.0 * (config.planner.safe_distance_m + config.smoother.extra_room_m)


@pytest.mark.parametrize("name", papers.WORLDS)
def test_the_default_planner_is_the_papers_own_and_another_one_can_be_chosen(name):
    assert load(name).config.planner.name == PLANNERS[name.split("_")[1]]
    assert load(name, planner="tlbo").config.planner.name == "tlbo"


def test_the_movers_and_the_goal_move_as_in_the_papers_scenes():
    """At the same speed relative to the robot's."""
    step_s = _STEP_UNITS * scale("paper_abed_moving") / _SPEED_MPS
    tracks = [mover.track for mover in online_scene("moving_obstacles").movers]
    radii = [mover.radius_m for mover in online_scene("moving_obstacles").movers]
    movers = load("paper_abed_moving").movers
    goal = load("paper_abed_moving_goal").goal_motion
    keys = [mover.keys_txy for mover in movers] + [goal.keys_txy]
    unit_m = scale("paper_abed_moving")
    np.testing.assert_allclose([m.diameter_m for m in movers], 2.0 * unit_m * np.array(radii))
    for track, path in zip([*tracks, online_scene("moving_goal").goal], keys, strict=True):
        for t in np.linspace(0.0, 250.0, 101):
            place = on_path(np.array(path), t)
            np.testing.assert_allclose(place, unit_m * track.at(t / step_s), atol=5e-3)


@pytest.mark.parametrize("name", ["paper_wu", "paper_abed_moving_goal"])
def test_the_lead_planner_drives_there(name):
    result = Simulation(load(name, seed=0, planner="tlbo")).run().metrics
    assert result["outcome"] == "reached" and result["contact_count"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", papers.WORLDS)
def test_the_lead_planner_arrives_in_every_world_of_the_papers(name):
    runs = [Simulation(load(name, seed=seed, planner="tlbo")).run().metrics for seed in range(5)]
    assert [run["outcome"] for run in runs] == ["reached"] * 5
    assert sum(run["contact_count"] for run in runs) == 0
