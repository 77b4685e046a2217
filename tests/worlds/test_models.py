"""The model files of vehicle and arenas: masses, sizes, rest and contacts."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from simloop.common.data_files import models_dir
from simloop.config import VehicleConfig
from simloop.worlds.arena import arena_names, build

SENSOR = ("visual_lidar", "hull_mast")
WHEELS = [f"road_{side}_{i}" for side in ("left", "right") for i in range(6)]


@pytest.fixture(scope="module")
def vehicle() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(models_dir() / "tracked_ugv.xml"))


def at_home(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    return data


def warnings_in(data: mujoco.MjData) -> list[int]:
    return [int(w.number) for w in data.warning if w.number]


def test_weighs_ten_kilograms_with_its_centre_over_the_tracks(vehicle: mujoco.MjModel) -> None:
    data, base = at_home(vehicle), vehicle.body("base_link").id
    assert vehicle.body_subtreemass[base] == pytest.approx(10.0, abs=1e-9)
    assert data.subtree_com[base] == pytest.approx([0.0, 0.0, 0.07], abs=1e-4)


def test_road_wheels_share_the_contact_length_evenly_at_the_gauge(vehicle: mujoco.MjModel) -> None:
    facts = VehicleConfig()
    data = at_home(vehicle)
    where = np.array([data.geom(name).xpos for name in WHEELS]).reshape(2, 6, 3)
    radius = np.array([vehicle.geom(name).size[0] for name in WHEELS]).reshape(2, 6)
    # Each in the middle of its sixth of the contact length, front to rear.
    middles = 0.415 * (0.5 - (np.arange(6) + 0.5) / 6)
    assert where[0, :, 0] == pytest.approx(middles, abs=1e-6)
    assert where[1, :, 0] == pytest.approx(middles, abs=1e-6)
    assert where[0, :, 1] - where[1, :, 1] == pytest.approx(facts.gauge_m)
    assert where[:, :, 2] == pytest.approx(radius)  # their lowest points on the ground


def test_outline_is_that_of_the_configuration(vehicle: mujoco.MjModel) -> None:
    facts = VehicleConfig()
    tracks = [vehicle.geom(f"hull_track_{side}") for side in ("left", "right")]
    assert 2 * tracks[0].size[0] == pytest.approx(facts.length_m)
    outer = [abs(t.pos[1]) + t.size[1] for t in tracks]
    assert outer == pytest.approx([0.5 * facts.width_m] * 2)


def test_only_wheels_and_hull_can_touch_and_wheels_carry_without_friction(
    vehicle: mujoco.MjModel,
) -> None:
    for index in range(vehicle.ngeom):
        geom = vehicle.geom(index)
        if geom.name == "ground":
            continue
        assert geom.contype == 0, geom.name  # so no two of its geoms meet
        assert (geom.conaffinity != 0) == (geom.name in WHEELS or geom.name.startswith("hull_"))
    assert all(vehicle.geom(name).condim == 1 for name in WHEELS)
    assert all(vehicle.geom(name).priority == 2 for name in WHEELS)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_sprocket_turning_positively_drives_forward(vehicle: mujoco.MjModel, side: str) -> None:
    data = at_home(vehicle)
    data.joint(f"sprocket_{side}_joint").qpos = 0.1
    mujoco.mj_kinematics(vehicle, data)
    top = data.body(f"sprocket_{side}").xmat.reshape(3, 3) @ [0.0, 0.0, 1.0]
    assert top[0] > 0.09  # the upper run moves forward, so the lower one pushes backwards
    actuator = vehicle.actuator(f"motor_{side}")
    assert actuator.trnid[0] == vehicle.joint(f"sprocket_{side}_joint").id
    assert vehicle.dof_armature[vehicle.joint(f"sprocket_{side}_joint").dofadr[0]] == 0.02


def test_opened_alone_it_rests(vehicle: mujoco.MjModel) -> None:
    data = at_home(vehicle)
    mujoco.mj_step(vehicle, data, 500)
    assert not warnings_in(data)
    assert data.ncon == 12
    assert abs(data.qpos[2]) < 1e-4
    assert np.abs(data.qvel).max() < 1e-6
    assert np.abs(data.qpos[:2]).max() < 1e-6


@pytest.mark.parametrize("name", arena_names())
def test_every_arena_steps_for_a_second_on_the_wheels_alone(name: str) -> None:
    model = build(name)
    data = at_home(model)
    mujoco.mj_step(model, data, 500)
    assert not warnings_in(data)
    assert np.abs(data.qvel).max() < 1e-6
    pairs = {(model.geom(c.geom1).name, model.geom(c.geom2).name) for c in data.contact}
    assert pairs == {("floor", wheel) for wheel in WHEELS}


def test_the_hull_meets_a_wall_before_the_wheels_do() -> None:
    model = build("experiment")
    data = at_home(model)
    data.qpos[0] = -0.65 + 0.24  # its tail 5 mm inside the west wall
    mujoco.mj_forward(model, data)
    names = {model.geom(g).name for c in data.contact for g in (c.geom1, c.geom2)}
    assert "wall_west" in names
    touching = {
        model.geom(c.geom2).name for c in data.contact if model.geom(c.geom1).name == "wall_west"
    }
    assert any(name.startswith("hull_") for name in touching)


def test_the_lidar_sees_the_arena_and_not_the_vehicle() -> None:
    model = build("open")
    data = at_home(model)
    eye = data.site("lidar").xpos
    assert eye[2] == pytest.approx(0.2)
    groups, geom = np.array([1, 0, 0, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    for angle in np.linspace(0.0, 2.0 * np.pi, 72):
        ray = np.array([np.cos(angle), np.sin(angle), 0.0])
        assert mujoco.mj_ray(model, data, eye, ray, groups, 1, -1, geom) == -1.0
    # Nothing solid or drawn but the sensor itself reaches the plane in which it looks.
    for index in range(model.ngeom):
        part = model.geom(index)
        if part.name.startswith(("hull_", "visual_")) and part.name not in SENSOR:
            low, high = geom_heights(model, data, index)
            assert not low < 0.2 < high, part.name


def geom_heights(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> tuple[float, float]:
    """From the geom's own bounding box, turned into the world."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    middle = data.geom_xpos[geom][2] + rotation[2] @ centre
    reach = np.abs(rotation[2]) @ half
    return middle - reach, middle + reach
