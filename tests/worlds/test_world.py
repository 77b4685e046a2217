"""The compiled world: built once, and judged by the robot's true outline."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from simloop.loop import Simulation
from simloop.scenario.build import build_world
from simloop.scenario.describe import describe
from simloop.scenario.load import load
from simloop.worlds.arena import assemble
from simloop.worlds.body import Body
from simloop.worlds.layout import Layout
from simloop.worlds.vehicle_body import body_of

SMALL = "vehicle.width_m=0.2"


@pytest.fixture
def compilations(monkeypatch):
    """The names of all worlds with the vehicle that are compiled while a test runs.

    Arenas are also compiled by themselves, without the vehicle and without what a layout adds.
    """
    names = []
    compile_spec = mujoco.MjSpec.compile

    def counted(spec):
        if spec.body("base_link") is not None:
            names.append(spec.modelname)
        return compile_spec(spec)

    monkeypatch.setattr(mujoco.MjSpec, "compile", counted)
    return names


CROWDED = ["crowd.count=3", "clutter.count=4"]


@pytest.mark.parametrize(
    ("name", "more"), [("experiment", []), ("clutter", []), ("hall", []), ("open", CROWDED)]
)
def test_a_world_is_compiled_once(compilations, name, more):
    build_world(load(name, more))
    assert len(compilations) == 1


def test_a_world_that_is_refused_is_not_compiled(compilations):
    with pytest.raises(ValueError, match="outside the arena"):
        build_world(load("clutter", ["goal=[-9.0, 1.0]"]))
    assert compilations == []


def test_a_scenario_is_described_without_being_compiled(compilations):
    layout = describe(load("open", CROWDED))
    assert compilations == []
    assert (len(layout.obstacles), len(layout.movers)) == (4, 3)
    assert describe(load("open", CROWDED)) == layout
    assert describe(load("open", CROWDED, seed=1)) != layout


def test_a_drawn_crowd_keeps_clear_of_drawn_clutter():
    world = build_world(load("open", ["crowd.count=8", "clutter.count=8"], seed=3))
    for mover in world.movers:
        assert world.floor.clearance_m(np.array(mover.start_m))[0] > 0.5 * mover.diameter_m


def test_the_outline_is_that_of_the_compiled_collision_geoms():
    """By the bounding boxes of the geoms, which MuJoCo computes itself."""
    model = build_world(load("open")).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    far = np.zeros(2)
    for geom in range(model.ngeom):
        inside = model.body_rootid[model.geom_bodyid[geom]] == model.body("base_link").id
        if inside and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            rotation = data.geom_xmat[geom].reshape(3, 3)
            middle = data.geom_xpos[geom] + rotation @ model.geom_aabb[geom, :3]
            reach = np.abs(rotation) @ model.geom_aabb[geom, 3:]
            far = np.maximum(far, (np.abs(middle) + reach)[:2])
    body = body_of(assemble(Layout()))
    assert (body.length_m, body.width_m) == pytest.approx(2.0 * far, abs=1e-6)
    assert body == Body(0.49, 0.465, 0.2)
    assert body.footprint_radius_m == 0.25


def test_the_outline_follows_the_vehicles_model():
    world = assemble(Layout())
    world.geom("hull_track_left").pos = [0.0, 0.25, 0.0725]
    world.site("lidar").pos = [0.0, 0.0, 0.3]
    assert body_of(world) == Body(0.49, 0.575, 0.3)


def test_three_discs_of_the_footprints_radius_cover_the_outline():
    for length, width in np.random.default_rng(0).uniform(0.2, 2.0, (50, 2)):
        body = Body(float(length), float(width), 0.2)
        corners = np.array([0.5 * length - np.array([-1, 0, 1]) * length / 3, 3 * [0.5 * width]])
        assert np.hypot(*corners).min() <= body.footprint_radius_m
        assert body.footprint_radius_m < np.hypot(length / 6, width / 2) + 0.01 + 1e-9


def judged(*overrides):
    metrics = Simulation(load("experiment", [*overrides, "time_limit_s=0.5"])).run().metrics
    return {key: metrics[key] for key in ("min_clearance_m", "shortest_path_m")}


@pytest.mark.parametrize(
    "belief", [SMALL, "vehicle.length_m=0.2", "vehicle.footprint_radius_m=0.1"]
)
def test_what_the_robot_believes_of_itself_does_not_move_the_judge(belief):
    """The robot stands at the start for half a second, whatever it believes."""
    assert judged(belief, "motor.supply_v=0.1") == judged("motor.supply_v=0.1")


@pytest.mark.parametrize("name", ["clutter", "maze", "barn", "forest", "hall"])
def test_what_the_robot_believes_of_itself_does_not_move_the_world(name):
    believed = ["vehicle.width_m=0.2", "vehicle.length_m=0.9", "vehicle.footprint_radius_m=0.4"]
    for seed in range(2):
        assert describe(load(name, believed, seed=seed)) == describe(load(name, seed=seed))


def test_a_start_is_judged_by_the_true_outline():
    with pytest.raises(ValueError, match="outline touches wall_east"):
        build_world(load("experiment", ["start=[4.06, 1.95, 0.785]", SMALL]))
    wide = ["vehicle.width_m=3.0", "vehicle.footprint_radius_m=1.0"]
    assert build_world(load("experiment", wide)).body == Body(0.49, 0.465, 0.2)


def test_movers_meet_the_true_outline():
    """A mover walks into the side of the robot, which believes that it is as narrow as a plank."""
    keys = "movers=[{motion='constant', position_m=[1.0, 3.0], heading_rad=-1.5708}]"
    overrides = ["start=[1.0, 1.0, 0.0]", "motor.supply_v=0.1", "time_limit_s=8", keys]

    def places(*more):
        scenario = replace(load("hall", [*overrides, *more]), crowd=None)
        simulation = Simulation(scenario)
        simulation.run()
        return simulation.plant.data.mocap_pos[:, :2].copy()

    assert places(SMALL) == pytest.approx(places(), abs=0.01)
