"""Terrain, friction images and loose things, from the scenario to the plant."""

from __future__ import annotations

import math

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.data_files import models_dir
from simloop.common.errors import InputError
from simloop.common.grey_image import read_grey
from simloop.config import Config, FrictionImage, FrictionZone
from simloop.loop import Simulation
from simloop.physics.plant import Plant
from simloop.physics.track_model import friction_at, friction_map
from simloop.physics.vehicle_geoms import ground_height
from simloop.recording.scene_shapes import scene_shapes
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.arena import build
from simloop.worlds.mjcf_ground import climbable_height, climbing_angle_of, heights_of
from simloop.worlds.terrain import HeightField, Loose, Ramp, Step, Terrain

FIELD = HeightField((-2.0, -1.5), (2.0, 1.5), rms_m=0.004, correlation_m=0.3, seed=3)


@pytest.fixture
def grey(tmp_path):
    """A picture of 2 x 3 pixels whose upper row is black, grey, white, and whose lower is white."""
    file = tmp_path / "grey.png"
    cv2.imwrite(str(file), np.array([[0, 128, 255], [255, 255, 255]], np.uint8))
    return str(file)


def names(model):
    return [model.geom(i).name for i in range(model.ngeom)]


def scenario_with(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(f'arena = "clutter"\nstart = [0, 0, 0]\ngoal = [3, 3]\n{text}')
    return load(file)


def refusal(tmp_path, text):
    with pytest.raises(InputError) as caught:
        build_world(scenario_with(tmp_path, text))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_an_image_gives_each_place_its_pixels_friction_and_zones_lie_over_it(grey):
    image = FrictionImage(grey, (0.0, 0.0), (3.0, 2.0), black=0.1, white=0.9)
    ground = friction_map([FrictionZone((2.0, 1.0), (3.0, 2.0), 0.5)], image)
    places = [(0.5, 1.5), (1.5, 1.5), (2.5, 1.5), (0.5, 0.5), (2.999, 0.001), (3.1, 1.0)]
    found = [friction_at(x, y, ground, 0.7) for x, y in places]
    assert found == pytest.approx([0.1, 0.1 + 0.8 * 128 / 255, 0.5, 0.9, 0.9, 0.7])


@given(st.floats(0, 3), st.floats(0, 2))
@settings(max_examples=50)
def test_no_place_on_an_image_has_a_friction_that_is_not_in_it(x, y):
    pixels = np.linspace(0.2, 0.8, 6).reshape(2, 3)
    ground = friction_map([])._replace(zones=np.array([[0.0, 0.0, 3.0, 2.0, np.nan]]), image=pixels)
    row, column = min(int(y), 1), min(int(x), 2)
    assert friction_at(x, y, ground, 9.0) == pixels[row, column]


def test_a_drive_over_an_image_slips_where_it_is_black(tmp_path, grey):
    text = f"""[tracks.friction_image]
file = "{grey}"
min_m = [-10, -10]
max_m = [10, 10]
black = 0.05
white = 0.05
"""
    slippery = scenario_with(tmp_path, text)
    world = build_world(slippery)
    speeds = []
    for config in (slippery.config, Config()):
        plant = Plant(world.model, config)
        plant.reset(np.zeros(3))
        for _ in range(30):
            truth = plant.step(np.array([20.0, 20.0]))
        speeds.append(truth.velocity_body[0])
    assert speeds[0] < 0.6 * speeds[1]
    assert speeds[0] <= 0.05 * 9.81 * 0.3 + 1e-3  # friction is all that accelerates


@pytest.mark.parametrize("bad", [b"", b"no image", b"\x89PNG\r\n\x1a\n broken"])
def test_a_file_that_is_no_image_is_refused_in_one_line(tmp_path, bad):
    file = tmp_path / "bad.png"
    file.write_bytes(bad)
    with pytest.raises(InputError, match="not a picture"):
        read_grey(str(file))
    for table in (
        f'[tracks.friction_image]\nfile="{file}"\nmin_m=[0,0]\nmax_m=[1,1]\nblack=0.1\nwhite=0.9',
        f'[terrain.height_field]\nimage="{file}"\nheight_m=0.05\nmin_m=[0,0]\nmax_m=[1,1]',
    ):
        assert "bad.png" in refusal(tmp_path, table)


def test_images_are_looked_for_beside_the_scenario(tmp_path, grey):
    text = '[terrain.height_field]\nimage="grey.png"\nheight_m=0.03\nmin_m=[1,1]\nmax_m=[2,2]'
    scenario = scenario_with(tmp_path, text)
    assert scenario.terrain.height_field.image == grey
    assert "no_such.png" in refusal(tmp_path, text.replace("grey.png", "no_such.png"))


def test_a_drawn_field_has_the_spread_and_correlation_asked_for():
    field = HeightField((0, 0), (20, 20), rms_m=0.01, correlation_m=0.4, cell_m=0.05, seed=1)
    heights = heights_of(field)
    assert heights.shape == (401, 401) and heights.min() == 0.0
    assert np.all(heights[[0, -1]] == 0.0) and np.all(heights[:, [0, -1]] == 0.0)
    inner = heights[20:-20, 20:-20] - heights[20:-20, 20:-20].mean()
    assert inner.std() == pytest.approx(0.01, rel=0.05)
    shift = round(field.correlation_m / field.cell_m)
    correlation = (inner[:, shift:] * inner[:, :-shift]).mean() / inner.var()
    assert correlation == pytest.approx(math.exp(-1.0), abs=0.06)


def test_a_fields_image_stands_the_right_way_up(grey):
    field = HeightField((0, 0), (3, 2), image=grey, height_m=0.1, cell_m=0.1)
    heights = heights_of(field)
    assert heights[0].min() == pytest.approx(0.1)  # the lower, white row at the least y
    assert heights[-1, 0] == pytest.approx(0.0) and heights[-1, -1] == pytest.approx(0.1)


def test_the_vehicle_is_put_down_on_the_field_and_stays_on_it():
    model = build("open", terrain=Terrain(height_field=FIELD))
    plant = Plant(model, Config())
    truth = plant.reset(np.zeros(3))
    heights = heights_of(FIELD)
    assert 0.0 < truth.position_m[2] < heights.max() + 0.002
    for _ in range(200):
        truth = plant.step(np.array([8.0, 8.0]))
        assert -0.002 < truth.position_m[2] < heights.max() + 0.01
    assert truth.position_m[0] > 0.2 and plant.tracks.touching[0] == 0


@pytest.mark.parametrize(
    ("height", "run", "expected"), [(0.05, 0.5, "ground"), (0.5, 0.5, "obstacle")]
)
def test_what_no_track_can_climb_is_an_obstacle(height, run, expected):
    ramp = Ramp((1.5, 0.0), height, run, top_m=0.5)
    assert (math.atan2(height, run) < climbing_angle_of(0.6)) == (expected == "ground")
    model = build("open", terrain=Terrain(ramps=(ramp,)))
    assert f"{expected}_ramp_01" in names(model)
    low, high = Step((1.0, 0.0), (0.3, 1.0), 0.01), Step((1.0, 2.0), (0.3, 1.0), 0.035)
    model = build("open", terrain=Terrain(steps=(low, high)))
    assert {"ground_step_01", "obstacle_step_02"} <= set(names(model))


def test_the_border_between_ground_and_obstacle_is_theorys():
    world = vehicle_alone()
    highest, steepest = climbable_height(world, 0.5), climbing_angle_of(0.5)
    assert steepest == pytest.approx(math.atan(0.5))
    steps = tuple(Step((1.0, y), (0.3, 1.0), k * highest) for y, k in ((0.0, 0.98), (2.0, 1.02)))
    ramps = tuple(
        Ramp((1.0, y), math.tan(k * steepest) * 0.4, 0.4) for y, k in ((-2.0, 0.98), (-4.0, 1.02))
    )
    terrain = Terrain(ramps, steps)
    found = set(names(build("open", terrain=terrain, friction=0.5)))
    assert {"ground_step_01", "obstacle_step_02", "ground_ramp_01", "obstacle_ramp_02"} <= found


def vehicle_alone():
    return mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml"))


def test_what_is_turned_stands_turned_to_the_left():
    """By rays from above: a third of a turn from +x, and not as much to the other side."""
    yaw = 2.0
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    ramp = Ramp((1.0, 1.0), 0.1, 0.6, top_m=0.6, width_m=0.4, yaw_rad=yaw)
    step = Step((-1.0, 1.0), (1.0, 0.2), 0.015, yaw_rad=yaw)
    box = Loose("box", (0.0, -1.5), (1.0, 0.2), 1.0, 0.3, 0.4, yaw_rad=yaw)
    model = build("open", terrain=Terrain((ramp,), (step,)), loose=(box,))
    data = mujoco.MjData(model)
    for name, place, height in (
        ("ground_ramp_01", np.array([1.0, 1.0]) + 0.3 * ahead, 0.05),
        ("ground_ramp_01", np.array([1.0, 1.0]) + 0.9 * ahead, 0.1),
        ("ground_step_01", np.array([-1.0, 1.0]) + 0.45 * ahead, 0.015),
        ("obstacle_loose_01", np.array([0.0, -1.5]) - 0.45 * ahead, 0.3),
    ):
        found = ground_height(model, data, [model.geom(name).id], place[None])
        assert found == pytest.approx(height, abs=1e-6)


def test_it_is_put_down_on_whatever_lies_under_its_wheels():
    """A sill under the front wheels of a robot that looks to +y, or to -y, and not beside it."""
    sill = Step((0.0, 0.0), (0.04, 0.1), 0.015)
    plant = Plant(build("open", terrain=Terrain(steps=(sill,))), Config())
    forward, left, beside = 0.172917, 0.195, np.array([0.0, 0.9, 0.0])
    for yaw in (0.5 * math.pi, -0.5 * math.pi, 2.0):
        cos, sin = math.cos(yaw), math.sin(yaw)
        # Where the left front wheel stands on the sill, and where nothing does.
        on = np.array([-(cos * forward - sin * left), -(sin * forward + cos * left), yaw])
        assert plant.reset(on, settle_s=0.0).position_m[2] == pytest.approx(0.016, abs=1e-6)
        assert plant.reset(on + beside, settle_s=0.0).position_m[2] < 0.0011


@pytest.mark.parametrize("friction", [0.15, 0.7])
def test_a_loose_thing_slides_on_the_floor_with_its_own_friction(friction):
    """Thrown, it slides v^2 / 2 mu g far, whatever the floor's own friction."""
    box = Loose("box", (1.0, 1.0), (0.3, 0.3), 1.0, 0.05, friction)
    plant = Plant(build("open", loose=(box,)), Config())
    plant.reset(np.zeros(3))
    start = plant.loose_truth().position_m[0, 0]
    dof = plant.model.body("obstacle_loose_01").dofadr[0]
    plant.data.qvel[dof] = 1.0
    for _ in range(100):
        plant.step(np.zeros(2))
    slid = plant.loose_truth().position_m[0, 0] - start
    assert slid == pytest.approx(1.0 / (2.0 * friction * 9.81), rel=0.05)


def test_ramps_are_driven_up_and_their_height_is_reached():
    ramp = Ramp((0.5, 0.0), 0.08, 0.8, top_m=2.0, width_m=1.5)
    plant = Plant(build("open", terrain=Terrain(ramps=(ramp,))), Config())
    plant.reset(np.zeros(3))
    for _ in range(700):
        truth = plant.step(np.array([12.0, 12.0]))
    assert truth.position_m[2] == pytest.approx(0.08, abs=0.002)
    assert plant.tracks.touching[0] == 0


def test_a_loose_box_is_pushed_along_and_is_told_of():
    box = Loose("box", (0.6, 0.0), (0.2, 0.3), 1.0, 0.15, 0.4, pushable=True)
    plant = Plant(build("open", loose=(box,)), Config())
    plant.reset(np.zeros(3))
    before = plant.loose_truth()
    assert before.bodies == ("loose_01",)
    assert before.position_m[0] == pytest.approx([0.6, 0.0, 0.075], abs=0.002)
    for _ in range(400):
        truth = plant.step(np.array([8.0, 8.0]))
    moved = plant.loose_truth().position_m[0, 0] - 0.6
    assert moved > 0.25
    # Between bow and sprockets ahead of the robot, or a little on, as it hops when it is pushed.
    assert 0.29 < 0.6 + moved - truth.position_m[0] < 0.40
    assert truth.contact_count == 0  # it may be pushed
    assert before.position_m[0, 0] == pytest.approx(0.6, abs=0.002)  # what was said stays


def test_touching_what_may_not_be_pushed_is_a_contact():
    box = Loose("cylinder", (0.6, 0.0), (0.2,), 1.0, 0.15, 0.4)
    plant = Plant(build("open", loose=(box,)), Config())
    plant.reset(np.zeros(3))
    for _ in range(300):
        truth = plant.step(np.array([8.0, 8.0]))
    assert truth.contact_count >= 1


def test_two_plants_of_one_world_keep_their_own_step():
    model = build("open")
    fine = Config.__pydantic_validator__.validate_python({"rates": {"physics_s": 0.001}})
    plants = [Plant(model, Config()), Plant(model, fine)]
    assert [plant.model.opt.timestep for plant in plants] == [0.002, 0.001]
    for plant in plants:
        plant.reset(np.zeros(3))
        for _ in range(100):
            truth = plant.step(np.array([12.0, 12.0]))
        assert truth.position_m[0] == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[loose]]\nshape="box"\nposition_m=[0,0.1]\nsize_m=[0.2,0.2]\nmass_kg=1', "robot"),
        (
            '[[loose]]\nshape="box"\nposition_m=[2,2]\nsize_m=[0.2,0.2]\nmass_kg=1\n'
            '[[loose]]\nshape="cylinder"\nposition_m=[2.1,2]\nsize_m=[0.2]\nmass_kg=1',
            "obstacle_loose_02",
        ),
        ('[[loose]]\nshape="box"\nposition_m=[2,2]\nsize_m=[0.2]\nmass_kg=1', "length, width"),
        ('[[loose]]\nshape="box"\nposition_m=[2,2]\nsize_m=[0.2,0.2]', "mass_kg"),
        ("[terrain.height_field]\nmin_m=[1,1]\nmax_m=[0,2]\nrms_m=0.01", "min_m"),
        ("[terrain.height_field]\nmin_m=[0,0]\nmax_m=[1,2]", "image"),
        ("[terrain.height_field]\nmin_m=[0,0]\nmax_m=[90,2]\nrms_m=0.01", "1001"),
        (
            "[terrain.height_field]\nmin_m=[0,0]\nmax_m=[2,2]\nrms_m=0.01\n"
            "correlation_m=9.0\ncell_m=0.02",
            "correlation_m",
        ),
        (
            '[terrain.height_field]\nmin_m=[0,0]\nmax_m=[1,2]\nheight_m=0.1\nimage="a\\u0000.png"',
            "name of a file",
        ),
        ("[[terrain.ramps]]\nposition_m=[1,1]\nheight_m=0.1", "up_m"),
        ("[[terrain.steps]]\nposition_m=[1,1]\nheight_m=0.1\nsize=[1,1]", "size"),
        ("[[terrain.hills]]\nposition_m=[1,1]", "hills"),
        (
            "[terrain.height_field]\nmin_m=[1,1]\nmax_m=[2,2]\nrms_m=0.01\n"
            "[rates]\nphysics_s=0.005",
            "physics_s",
        ),
        (
            '[tracks.friction_image]\nfile="x"\nmin_m=[1,0]\nmax_m=[1,1]\nblack=0.1\nwhite=1',
            "min_m",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path, text, said):
    assert said in refusal(tmp_path, text)


def test_a_recorded_field_is_the_field_that_is_driven_over():
    model = build("open", terrain=Terrain(height_field=FIELD))
    (shape,) = [s for s in scene_shapes(model) if s.name == "ground_field"]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ground = model.geom("ground_field").id
    down, normal = np.array([0.0, 0.0, -1.0]), np.zeros(3)
    for vertex in shape.vertices_m[[500, 1234, 3000]]:
        where = np.array([vertex[0] + 1e-6, vertex[1] + 1e-6, 1.0])
        far = mujoco.mj_rayHfield(model, data, ground, where, down, normal)
        assert 1.0 - far == pytest.approx(vertex[2], abs=1e-5)
    assert shape.faces.max() < len(shape.vertices_m)


@pytest.mark.parametrize("name", ["zones", "rough", "loose"])
def test_the_robot_crosses_what_it_knows_nothing_of(name):
    result = Simulation(load(name, seed=1000)).run()
    assert result.outcome == "reached" and result.metrics["contact_count"] == 0
