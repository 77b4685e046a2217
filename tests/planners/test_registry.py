"""What the registry says of the planners is what they are."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from simloop.benchmarks.planners.scenes import box_world, disc_world
from simloop.common.errors import InputError
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners import registry
from simloop.planners.metaheuristics.population import Rule
from simloop.planners.protocol import PlanningTask, WorldKind, kind_of

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
BOX = (0.0, 0.0, 5.0, 5.0)
START, GOAL, SAFE_M = np.array([0.5, 0.5, 0.0]), np.array([4.5, 4.5]), 0.3
WORLDS = {
    WorldKind.DISCS: disc_world([[2.5, 2.4, 0.4]], BOX),
    WorldKind.FIELD: box_world(np.array([[2.2, 2.1, 2.8, 2.7]]), 5.0, 0.05),
}


@pytest.fixture(params=registry.available())
def info(request):
    """Each planner's entry."""
    return registry.info(request.param)


def make(info, **settings):
    """The planner; the test is skipped where its library is missing."""
    settings = {"max_evaluations": 400, "learners": 20, "start_turn_weight": 0.0} | settings
    try:
        return registry.make_planner(PlannerConfig(name=info.name, **settings), POINT)
    except InputError as error:
        pytest.skip(str(error))


def test_a_name_that_is_not_known_is_refused_with_the_list_of_names():
    with pytest.raises(ValueError, match=r"unknown planner 'warp'; choose from .*tlbo"):
        registry.make_planner(PlannerConfig(name="warp"), POINT)
    with pytest.raises(ValueError, match=r"unknown planner 'warp'"):
        registry.info("warp")


def test_what_is_listed_is_not_imported():
    code = (
        "import sys; from simloop.planners import registry; "
        "print([registry.info(n).summary for n in registry.available()]); "
        "assert not [m for m in sys.modules if m.startswith('simloop.planners.') "
        "and m.count('.') > 2], sorted(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_the_class_is_what_the_entry_says(info):
    found = registry.load(info.name)
    assert found.name == info.name and info.summary
    assert issubclass(found, Rule) == info.update_rule
    assert hasattr(found, "steering") == info.stepwise
    if info.update_rule:
        assert info.options == tuple(f.name for f in fields(found.Options))
    assert set(info.invariances) <= {"shift", "rotate", "mirror", "scale"}


def test_options_are_those_of_the_entry(info):
    if info.update_rule:
        registry.check_options(info.name, {"points": 6, "coding": "box", "seeding": "uniform"})
        with pytest.raises(ValueError, match="unknown option 'warp'"):
            registry.check_options(info.name, {"warp": 1})
    else:
        assert info.options == ()
        with pytest.raises(ValueError, match=f"planner {info.name} has no options"):
            registry.check_options(info.name, {"warp": 1})


def test_a_plan_states_the_safe_distance_of_its_task(info):
    planner = make(info)
    for kind in WORLDS:
        if kind in info.worlds:
            task = PlanningTask(WORLDS[kind], START, GOAL, SAFE_M, reason="test")
            plan = planner.plan(task, np.random.default_rng(0))
            assert plan.safe_distance_m == SAFE_M and plan.reason == "test"
            assert plan.planner == info.name


def test_what_is_not_stochastic_draws_nothing(info):
    planner, state = make(info), np.random.default_rng(0)
    before = state.bit_generator.state
    planner.plan(PlanningTask(WORLDS[WorldKind.DISCS], START, GOAL, SAFE_M), state)
    assert (state.bit_generator.state == before) == (not info.stochastic)


def test_one_planner_serves_several_safe_distances(info):
    """As the gap choice asks of it: no plan leaves anything behind that changes another."""
    shared, kind = make(info), info.worlds[-1]
    for safe_m in (0.26, 0.34, 0.2, 0.26):
        task = PlanningTask(WORLDS.get(kind, WORLDS[WorldKind.DISCS]), START, GOAL, safe_m)
        ours = shared.plan(task, np.random.default_rng(1))
        alone = make(info).plan(task, np.random.default_rng(1))
        assert ours.waypoints_m.tobytes() == alone.waypoints_m.tobytes()
        assert ours.cost == alone.cost


def test_a_view_is_of_the_richest_kind_that_it_holds():
    discs, square = WORLDS[WorldKind.DISCS], np.array([[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]])
    assert kind_of(discs) is WorldKind.DISCS
    assert kind_of(replace(discs, polygons_m=(square,))) is WorldKind.POLYGONS
    assert kind_of(WORLDS[WorldKind.FIELD]) is WorldKind.FIELD
