"""The proper acceleration of the truth: what an ideal accelerometer at the IMU's site reads."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from helpers.vehicles import plant_on_plane, vehicle_on_plane

from simloop.config import Config, RatesConfig
from simloop.physics.plant import Plant

ARM_M = np.array([0.12, -0.05, 0.07])


def model_with_imu_at(place_m):
    """The vehicle on a plane, MuJoCo's own accelerometer at the IMU's site."""
    spec = vehicle_on_plane()
    spec.site("imu").pos = list(place_m)
    spec.add_sensor(
        name="accelerometer",
        type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="imu",
    )
    return spec.compile()


def settled(model, config=None):
    plant = Plant(model, config or Config())
    plant.reset(np.zeros(3))
    return plant


def test_turning_on_the_spot_it_feels_the_centripetal_acceleration():
    plant = settled(model_with_imu_at(ARM_M))
    for _ in range(200):
        plant.step(np.array([-12.0, 12.0]))
    felt, rates = [], []
    for _ in range(50):
        truth = plant.step(np.array([-12.0, 12.0]))
        felt.append(truth.acceleration_mps2)
        rates.append(truth.velocity_body[5])
    rate = float(np.mean(rates))
    assert rate > 1.0
    expected = [-(rate**2) * ARM_M[0], -(rate**2) * ARM_M[1], 9.81]
    assert np.mean(felt, axis=0) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("place_m", [(0.0, 0.0, 0.07), tuple(ARM_M)])
def test_it_is_the_mean_of_what_mujocos_accelerometer_reads(place_m):
    """The same run in control periods of one physics step, whose readings are averaged."""
    model = model_with_imu_at(place_m)
    coarse = settled(model)
    fine = settled(model, Config(rates=RatesConfig(control_s=0.002)))
    errors, felt = [], []
    for k in range(200):
        volts = np.array([10.0 * math.sin(0.05 * k), 14.0 * math.sin(0.03 * k + 0.5)])
        truth = coarse.step(volts)
        readings = []
        for _ in range(coarse.substeps):
            fine.step(volts)
            readings.append(fine.data.sensor("accelerometer").data.copy())
        errors.append(truth.acceleration_mps2 - np.mean(readings, axis=0))
        felt.append(truth.acceleration_mps2)
    assert fine.data.qpos == pytest.approx(coarse.data.qpos, abs=1e-12)
    assert np.ptp(felt, axis=0)[:2].min() > 0.2
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 0.003


def test_on_a_slope_it_feels_the_gravity_of_the_model():
    truth = plant_on_plane(pitch_rad=0.2).step(np.zeros(2))
    expected = [9.81 * math.sin(0.2), 0.0, 9.81 * math.cos(0.2)]
    assert truth.acceleration_mps2 == pytest.approx(expected, abs=0.01)


def test_velocity_and_pose_are_of_the_same_instant():
    """In the axes of the pose that is told, not in those of a physics step before it."""
    plant = plant_on_plane()
    for _ in range(200):
        truth = plant.step(np.array([2.0, 14.0]))
    yaw, world = truth.pose_xyyaw[2], plant.data.qvel[:2]
    ahead = math.cos(yaw) * world[0] + math.sin(yaw) * world[1]
    aside = -math.sin(yaw) * world[0] + math.cos(yaw) * world[1]
    assert truth.velocity_body[:2] == pytest.approx([ahead, aside], abs=1e-6)


def test_the_imus_site_must_be_on_the_chassis():
    spec = vehicle_on_plane()
    spec.delete(spec.site("imu"))
    spec.body("sprocket_left").add_site(name="imu")
    with pytest.raises(ValueError, match="'imu' must be in the body base_link"):
        Plant(spec.compile(), Config())
