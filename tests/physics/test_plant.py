"""The plant: rest, rays, contacts, and the digest of its state."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from helpers.vehicles import plant_on_plane

from simloop.config import Config, MotorConfig
from simloop.physics.plant import Plant
from simloop.worlds.arena import build
from simloop.worlds.obstacles import Obstacle

GROUPS = np.array([1, 1, 0, 0, 0, 0], np.uint8)
WALL = Obstacle(shape="box", position_m=(1.0, 0.0), size_m=(0.1, 2.0))


def test_at_rest_it_stands_still_and_level():
    plant = plant_on_plane()
    truth = plant.step(np.zeros(2))
    assert np.abs(truth.velocity_body).max() < 1e-5
    assert abs(truth.position_m[2]) < 1e-3
    assert truth.acceleration_mps2 == pytest.approx([0, 0, 9.81], abs=1e-2)
    assert plant.tracks.load.sum() == pytest.approx(98.1, rel=1e-3)
    assert truth.energy_j == pytest.approx(0.0, abs=1e-12)


def test_the_same_commands_give_the_same_bits_and_others_do_not():
    hashes = []
    for volts in (9.0, 9.0, 9.0000001):
        plant = plant_on_plane()
        for k in range(50):
            plant.step(np.array([volts, volts - 0.1 * k]))
        hashes.append(plant.state_hash())
    assert hashes[0] == hashes[1] != hashes[2]


def test_rays_measure_the_walls_and_not_the_robot():
    plant = Plant(build("open", [WALL]), Config())
    plant.reset(np.zeros(3))
    angles = np.linspace(-np.pi, np.pi, 73)[:-1]
    directions = np.column_stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)))
    origins = np.tile(plant.base_from_laser, (72, 1))
    ranges = plant.cast(origins, directions, 50.0)
    assert np.all((ranges > 0.4) | (ranges == -1.0))
    assert np.any(ranges > 0.0)
    ahead = plant.cast(origins + np.array([0.5, 0, 0]), directions, 50.0)
    assert ranges[36] - ahead[36] == pytest.approx(0.5, abs=1e-6)
    assert np.all(plant.cast(origins, directions, 0.3) == -1.0)


def test_rays_of_one_period_are_those_cast_one_by_one():
    """Against MuJoCo's single rays, from origins as far apart as the fastest motion takes them."""
    plant = Plant(build("experiment"), Config())
    plant.reset(np.zeros(3))
    vehicle = plant.model.body("base_link").id
    rng, worst = np.random.default_rng(0), []
    for _ in range(200):
        angles = np.sort(rng.uniform(-np.pi, np.pi, 36))
        directions = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(36)))
        motion = rng.uniform(-0.005, 0.005, 3) * [1, 1, 0.1]
        middle = np.array([*rng.uniform(-0.3, 0.3, 2), 0.2])
        origins = middle + np.linspace(0, 1, 36)[:, None] * motion
        fast = plant.cast(origins, directions, 12.0)
        for origin, direction, got in zip(origins, directions, fast, strict=True):
            exact = mujoco.mj_ray(
                plant.model, plant.data, origin, direction, GROUPS, 1, vehicle, None
            )
            worst.append(abs(got - exact))
    # A ray that passes an edge from one origin may hit it from another: those are a handful.
    assert np.quantile(worst, 0.995) < 1e-4
    assert np.mean(np.array(worst) > 0.01) < 0.004


def test_driving_into_a_wall_is_counted_and_stops_the_robot():
    plant = Plant(build("open", [WALL]), Config())
    plant.reset(np.zeros(3))
    for _ in range(1000):
        truth = plant.step(np.array([20.0, 20.0]))
        if truth.contact_count:
            break
    assert truth.contact_count == 1
    assert truth.in_contact
    x = truth.pose_xyyaw[0]
    for _ in range(100):
        truth = plant.step(np.array([20.0, 20.0]))
    assert truth.pose_xyyaw[0] - x < 0.05


def test_the_accelerometer_sees_the_speed_change_and_gravity():
    plant, total = plant_on_plane(), 0.0
    for _ in range(50):
        truth = plant.step(np.array([15.0, 15.0]))
        total += truth.acceleration_mps2[0] * 0.01
    assert total == pytest.approx(truth.velocity_body[0], rel=1e-3)


def test_the_digest_is_of_the_tracks_inner_state_too():
    plant = plant_on_plane()
    before = plant.state_hash()
    for array in plant.tracks:
        kept = array.copy()
        array.flat[0] += 1
        assert plant.state_hash() != before
        array[...] = kept
        assert plant.state_hash() == before


def test_velocity_is_told_in_the_robots_own_frame():
    plant = Plant(build("open"), Config())
    plant.reset(np.array([0.0, 0.0, 2.0]))
    gained = np.zeros(3)
    for _ in range(100):
        truth = plant.step(np.array([12.0, 12.0]))
        gained += truth.acceleration_mps2 * 0.01
    speed = np.hypot(*plant.data.qvel[:2])
    assert truth.velocity_body[0] == pytest.approx(speed, rel=1e-3) and speed > 0.2
    assert abs(truth.velocity_body[1]) < 1e-3
    assert gained[:2] == pytest.approx(truth.velocity_body[:2], abs=2e-3)


def test_rays_pass_through_every_part_of_the_robot():
    plant = Plant(build("open"), Config())
    plant.reset(np.zeros(3))
    x, y = np.meshgrid(np.linspace(-0.24, 0.24, 13), np.linspace(-0.23, 0.23, 13))
    origins = np.column_stack([x.ravel(), y.ravel(), np.full(169, 0.3)])
    for origin in origins:  # each on its own: they are too far apart for one control period
        down = plant.cast(origin[None], np.array([[0.0, 0.0, -1.0]]), 1.0)
        assert down[0] == pytest.approx(0.3, abs=1e-6)


def test_the_driver_pays_for_no_more_than_it_lets_through():
    """Stalled at its current's limit: the battery gives R I^2, whatever voltage was asked for."""
    config = Config()
    energies = []
    for volts in (16.0, 24.0):
        plant = plant_on_plane(config)
        plant.model.dof_armature[6:8] = 1e9  # sprockets that nothing turns
        before = plant.step(np.array([volts, volts])).energy_j
        for _ in range(100):
            truth = plant.step(np.array([volts, volts]))
        assert np.abs(truth.motor_current_a) == pytest.approx(config.motor.current_limit_a)
        energies.append(truth.energy_j - before)
    copper = 2.0 * config.motor.resistance_ohm * config.motor.current_limit_a**2
    assert energies == pytest.approx([copper, copper], rel=1e-3)


def test_the_rotors_inertia_is_the_configurations():
    """Lifted off the ground, with friction alone against the torque: twice J, half the pace."""
    paces = []
    for inertia in (0.02, 0.04):
        plant = plant_on_plane(Config(motor=MotorConfig(rotor_inertia_kgm2=inertia)))
        plant.model.opt.gravity[:] = 0.0
        plant.data.qpos[2] = 1.0
        truth = plant.step(np.array([24.0, 24.0]))
        paces.append(float(truth.sprocket_radps[0]))
    assert paces[0] == pytest.approx(2.0 * paces[1], rel=0.01)


def test_a_track_that_touches_a_wall_is_a_contact():
    """A post as low as no hull reaches stands right before a track: its wheels touch it."""
    model = build("open", [Obstacle("box", (0.5, 0.195), (0.1, 0.06), height_m=0.018)])
    hulls = [i for i in range(model.ngeom) if model.geom(i).name.startswith("hull_")]
    model.geom_conaffinity[hulls] = 0
    plant = Plant(model, Config())
    plant.reset(np.zeros(3))
    for _ in range(150):
        truth = plant.step(np.array([8.0, 8.0]))
    assert truth.contact_count == 1
