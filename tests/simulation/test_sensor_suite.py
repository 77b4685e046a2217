"""The sensor suite: each sensor at its own rate, faults in between, and the goal's reading."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.common.profiler import Profiler
from simloop.physics.faults import Faults
from simloop.physics.plant import Plant
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.simulation.environment import Environment
from simloop.simulation.random_streams import RandomStreams
from simloop.simulation.sensor_suite import SensorSuite

PERIODS = 40


def drive(name, *overrides, voltage=6.0):
    """Readings and goal positions of the first 0.4 s, with both motors at a constant voltage."""
    scenario = load(name, overrides)
    world, random = build_world(scenario), RandomStreams.from_seed(scenario.seed)
    plant = Plant(world.model, scenario.config)
    faults = Faults(scenario.faults, random.faults)
    environment = Environment(scenario, world, faults, random)
    sensors = SensorSuite(scenario.config, plant, environment.goal, faults, random, Profiler())
    truth = plant.reset(np.array(scenario.start))
    readings, goals = [], []
    for _ in range(PERIODS):
        environment.step(plant, truth)
        before, truth = truth, plant.step(np.full(2, voltage))
        readings.append(sensors.read(before, truth))
        goals.append(environment.goal.position_m)
    return readings, goals


def test_each_sensor_has_its_own_rate():
    readings, _ = drive("open")
    times = [r.encoders.t_ns for r in readings]
    assert times == [10_000_000 * n for n in range(1, PERIODS + 1)]
    assert [r.imu.t_ns for r in readings] == times
    scans = [(n, r.scan.t_ns) for n, r in enumerate(readings, 1) if r.scan is not None]
    assert scans == [(n, 10_000_000 * n) for n in (10, 20, 30, 40)]
    assert all(r.image is None and r.goal is None for r in readings)


def test_a_camera_adds_images_and_changes_nothing_else():
    with_camera, _ = drive("low", "camera.period_s=0.2")
    without, _ = drive("low", "camera.enabled=false")
    images = [n for n, r in enumerate(with_camera, 1) if r.image is not None]
    assert images == [20, 40]
    assert all(r.image is None for r in without)
    for one, other in zip(with_camera, without, strict=True):
        np.testing.assert_array_equal(one.imu.gyro_radps, other.imu.gyro_radps)
        if one.scan is not None:
            np.testing.assert_array_equal(one.scan.ranges_m, other.scan.ranges_m)


def test_faults_act_between_sensor_and_robot():
    fault = '{kind="encoder_stuck", side="left", at_s=0.2}'
    readings, _ = drive("open", f"faults=[{fault}]")
    left = [r.encoders.left_counts for r in readings]
    right = [r.encoders.right_counts for r in readings]
    assert len(set(left[20:])) == 1 and left[18] < left[20]
    assert right[20] < right[-1]
    silent, _ = drive("open", 'faults=[{kind="lidar_silent", at_s=0.25}]')
    assert [n for n, r in enumerate(silent, 1) if r.scan is not None] == [10, 20]


def test_faults_act_on_the_plant():
    """A robot that is put down elsewhere is there at the end of the same period."""
    scenario = load("open", ['faults=[{kind="kidnapped", at_s=0.0, to=[1.0, 0.5, 0.3]}]'])
    world, random = build_world(scenario), RandomStreams.from_seed(0)
    plant = Plant(world.model, scenario.config)
    environment = Environment(scenario, world, Faults(scenario.faults, random.faults), random)
    environment.step(plant, plant.reset(np.zeros(3)))
    assert plant.step(np.zeros(2)).pose_xyyaw == pytest.approx([1.0, 0.5, 0.3], abs=0.02)


def test_a_goal_that_moves_is_read_where_it_is():
    readings, goals = drive("moving_goal", "goal_motion.noise_m=0.0")
    heard = [(r.goal, goal) for r, goal in zip(readings, goals, strict=True) if r.goal is not None]
    assert heard
    for reading, goal in heard:
        np.testing.assert_array_equal(reading.position_m, goal)
    assert np.hypot(*(goals[-1] - goals[0])) > 0.0


def test_a_goal_that_stands_is_not_read():
    scenario = load("open")
    goal = Environment(
        scenario, build_world(scenario), Faults((), None), RandomStreams.from_seed(0)
    ).goal
    goal.step()
    assert not goal.moves and goal.read(0) is None
    assert goal.position_m == pytest.approx(scenario.goal)
