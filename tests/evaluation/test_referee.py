"""Who may say how a run ended, what each stage draws its chance from, and what planning costs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from simloop.loop import Simulation
from simloop.messages import ImuReading, LidarScan, Plan
from simloop.scenario.load import load


@pytest.fixture(scope="module")
def simulation():
    return Simulation(load("open", ["goal=[2.0, 0.0]", "time_limit_s=5.0"]))


@pytest.mark.parametrize(
    ("where", "speed", "contacts", "t_s", "arrived", "gave_up", "expected"),
    [
        ((1.0, 0.0), 0.3, 0, 1.0, False, False, ""),
        ((1.95, 0.0), 0.0, 0, 1.0, True, False, "reached"),
        ((2.0, 0.09), -0.009, 0, 1.0, True, False, "reached"),
        ((1.95, 0.0), 0.02, 0, 1.0, True, False, ""),  # it must stand
        ((1.95, 0.0), -0.02, 0, 1.0, True, False, ""),
        ((1.95, 0.0), 0.0, 0, 1.0, False, False, ""),  # and say so
        ((1.89, 0.0), 0.0, 0, 1.0, True, False, "missed"),
        ((1.95, 0.0), 0.0, 1, 1.0, True, False, "collision"),
        ((1.0, 0.0), 0.0, 0, 1.0, False, True, "stuck"),
        ((1.0, 0.0), 0.3, 0, 4.99, False, False, ""),
        ((1.0, 0.0), 0.3, 0, 5.0, False, False, "timeout"),
        ((1.95, 0.0), 0.0, 0, 5.0, True, False, "reached"),
        ((1.0, 0.0), 0.3, 1, 5.0, False, True, "collision"),
    ],
)
def test_how_a_run_ends(simulation, where, speed, contacts, t_s, arrived, gave_up, expected):
    simulation.robot = SimpleNamespace(
        arrived=arrived, gave_up=gave_up, lost=False, unreachable=False
    )
    truth = SimpleNamespace(
        t_ns=round(t_s * 1e9),
        pose_xyyaw=np.array([*where, 0.0]),
        velocity_body=np.array([speed, 0, 0, 0, 0, 0]),
        contact_count=contacts,
    )
    assert simulation._outcome(truth) == expected


def test_a_robot_that_stays_lost_ends_its_run(simulation):
    simulation.robot = SimpleNamespace(arrived=False, gave_up=False, lost=True, unreachable=True)
    truth = SimpleNamespace(
        t_ns=1, pose_xyyaw=np.zeros(3), velocity_body=np.zeros(6), contact_count=0
    )
    assert simulation._outcome(truth) == "lost"


def test_a_goal_given_up_ends_the_run_before_one_is_stuck_at_it(simulation):
    simulation.robot = SimpleNamespace(arrived=False, gave_up=True, lost=False, unreachable=True)
    truth = SimpleNamespace(
        t_ns=1, pose_xyyaw=np.zeros(3), velocity_body=np.zeros(6), contact_count=0
    )
    assert simulation._outcome(truth) == "unreachable"


def heard(*overrides, seconds=0.1):
    """All that is said in the first tenth of a second, before any plan can move the robot."""
    messages = []
    limit = f"time_limit_s={seconds}"
    Simulation(load("open", [limit, *overrides], seed=5), listeners=[messages.append]).run()
    return messages


def of(messages, kind, value):
    return np.array([value(m) for m in messages if isinstance(m, kind)])


def test_no_stage_draws_from_anothers_chance():
    """What one sensor draws must not depend on how often, or whether, the others draw."""
    one, other = heard(), heard("lidar.rays=90", "lidar.dropout=0.5")
    gyro = [of(m, ImuReading, lambda r: r.gyro_radps) for m in (one, other)]
    np.testing.assert_array_equal(*gyro)
    quiet = heard("imu.gyro_noise_radps_rthz=0", "imu.gyro_bias_radps=0")
    ranges = [of(m, LidarScan, lambda s: s.ranges_m) for m in (one, quiet)]
    np.testing.assert_array_equal(*ranges)
    # And no two draw the same numbers.
    one = Simulation(load("open"))
    generators = (one._imu._rng, one._lidar._rng, one.robot._planner._rng)
    assert len({g.bit_generator.seed_seq.spawn_key for g in generators}) == 3


@pytest.mark.parametrize(
    ("latency", "seconds", "expected_ns"),
    [
        ("fixed", 0.0, 0),
        ("fixed", 0.5, 500_000_000),
        ("fixed", 0.004, 0),
        ("fixed", 0.006, 10_000_000),
        ("per_evaluation", 2e-5, 160_000_000),
        ("per_evaluation", 1e-9, 0),
    ],
)
def test_a_plan_takes_the_simulated_time_that_was_given(latency, seconds, expected_ns):
    settings = [f"planner.latency='{latency}'", f"planner.latency_s={seconds}"]
    robot = Simulation(load("open", settings)).robot
    plan = Plan(0, np.zeros((2, 2)), 0.0, 0.0, 0.0, True, 8123, 3, "tlbo", safe_distance_m=0.26)
    assert robot._latency_ns(plan) == expected_ns
    twice = replace(plan, evaluations=16246)
    assert robot._latency_ns(twice) == expected_ns * (2 if latency == "per_evaluation" else 1)
