"""Motion votes: preintegration against fine steps, the history, and who is the outlier."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.estimation.motion_votes import (
    ACCEL_X,
    ACCEL_Y,
    BELTS_OK,
    DT,
    GYRO,
    LATERAL_SPEED,
    SPEED,
    MotionVotes,
    OdometryHistory,
    Outlier,
    preintegrate,
)
from simloop.geometry.se2 import between, compose

seeds = st.integers(0, 2**32 - 1)
PERIOD_NS, PERIOD_S = 10_000_000, 0.01


def random_rows(rng, n=20):
    return np.column_stack(
        [rng.uniform(-2, 2, (n, 2)), rng.uniform(-2, 2, n), np.full(n, PERIOD_S)]
    )


@given(seed=seeds, bias=st.floats(-0.05, 0.05))
@settings(max_examples=30)
def test_preintegration_is_the_sum_of_many_small_steps(seed, bias):
    rows = random_rows(np.random.default_rng(seed))
    found = preintegrate(rows, bias)
    yaw, velocity, position = 0.0, np.zeros(2), np.zeros(2)
    parts = 200
    for ax, ay, rate, dt in rows:
        for _ in range(parts):
            h = dt / parts
            middle = yaw + 0.5 * (rate - bias) * h
            cos, sin = math.cos(middle), math.sin(middle)
            a = np.array([cos * ax - sin * ay, sin * ax + cos * ay])
            position = position + velocity * h + 0.5 * a * h * h
            velocity = velocity + a * h
            yaw += (rate - bias) * h
    assert found.duration == pytest.approx(rows[:, 3].sum())
    assert found.yaw == pytest.approx(yaw, abs=1e-9)
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-4)
    np.testing.assert_allclose(found.position, position, atol=1e-5)


@given(seed=seeds, bias=st.floats(-0.05, 0.05))
@settings(max_examples=30)
def test_derivatives_by_the_bias_are_those_of_differences(seed, bias):
    rows, h = random_rows(np.random.default_rng(seed)), 1e-6
    plus, minus = preintegrate(rows, bias + h), preintegrate(rows, bias - h)
    numeric = [
        (plus.yaw - minus.yaw) / (2 * h),
        *((plus.velocity - minus.velocity) / (2 * h)),
        *((plus.position - minus.position) / (2 * h)),
    ]
    np.testing.assert_allclose(preintegrate(rows, bias).by_bias, numeric, atol=1e-7)


def history(periods, room=30, belts_ok=True, speed=0.4, rate=0.3):
    """An even arc: odom, wheels and IMU all tell the same."""
    out, pose = OdometryHistory(room), np.zeros(3)
    for i in range(1, periods + 1):
        row = out.push(i * PERIOD_NS)
        turned = rate * PERIOD_S
        middle = 0.5 * turned
        step = [speed * PERIOD_S * math.cos(middle), speed * PERIOD_S * math.sin(middle), turned]
        pose = compose(pose, np.array(step))
        row[:3], row[3:6] = pose, pose
        row[[ACCEL_X, ACCEL_Y]], row[GYRO], row[DT] = (0.0, speed * rate), rate, PERIOD_S
        row[[SPEED, LATERAL_SPEED]], row[BELTS_OK] = (speed, 0.0), belts_ok
    return out


@pytest.mark.parametrize("periods", [5, 30, 60, 61, 200])
def test_the_history_keeps_the_last_periods_in_order(periods):
    kept = history(periods)
    assert kept.last_ns == periods * PERIOD_NS
    since = max(1, periods - 25)
    times, poses = kept.odom_poses(since * PERIOD_NS, periods * PERIOD_NS)
    np.testing.assert_array_equal(times, np.arange(since, periods + 1) * PERIOD_NS)
    assert len(poses) == len(times)
    moved = between(poses[0], poses[-1])
    np.testing.assert_allclose(
        kept.odom_motion(since * PERIOD_NS, periods * PERIOD_NS), moved, atol=1e-12
    )


def test_a_span_begins_with_the_last_period_at_or_before_its_start():
    times, _ = history(20).odom_poses(5 * PERIOD_NS + 3, 8 * PERIOD_NS + 7)
    np.testing.assert_array_equal(times, np.array([5, 6, 7, 8]) * PERIOD_NS)


def test_what_it_gives_away_is_a_copy():
    kept = history(20)
    _, poses = kept.odom_poses(5 * PERIOD_NS, 20 * PERIOD_NS)
    before = poses.copy()
    for i in range(21, 200):
        kept.push(i * PERIOD_NS)[:] = 7.0
    np.testing.assert_array_equal(poses, before)


def test_votes_of_an_even_arc_agree_with_odom():
    kept = history(40)
    votes = kept.votes(10 * PERIOD_NS, 30 * PERIOD_NS, 0.0)
    odom = kept.odom_motion(10 * PERIOD_NS, 30 * PERIOD_NS)
    assert votes.duration == pytest.approx(0.2)
    np.testing.assert_allclose(votes.wheels, odom, atol=1e-12)
    np.testing.assert_allclose(votes.imu, odom, atol=2e-4)


def test_wheels_have_no_vote_when_a_belt_slipped():
    assert history(40, belts_ok=False).votes(10 * PERIOD_NS, 30 * PERIOD_NS, 0.0).wheels is None


@pytest.mark.parametrize(("since", "until"), [(0, 5), (5, 5), (9, 5)])
def test_there_are_no_votes_over_what_is_forgotten_or_no_time(since, until):
    assert history(20).votes(since * PERIOD_NS, until * PERIOD_NS, 0.0) is None


MOTION = np.array([0.04, 0.001, 0.02])


@pytest.mark.parametrize(
    ("wheels", "imu", "expected"),
    [
        ((0, 0, 0), (0, 0, 0.03), Outlier.GYRO),  # gyro alone: its bias has jumped
        ((0.1, 0, 0), (0, 0, 0), Outlier.WHEELS),  # wheels alone: they slip
        ((0, 0, 0), (0.1, 0, 0), Outlier.LIDAR),  # accelerometer and LiDAR disagree on the way
        ((0, 0, 0.03), (0, 0, 0.03), Outlier.LIDAR),  # both say that the LiDAR is wrong
        ((0.1, 0, 0), (0, 0, 0.03), Outlier.LIDAR),  # nobody agrees with anybody
        (None, (0, 0, 0.03), Outlier.LIDAR),  # nobody is left to support the LiDAR
        (None, (0, 0, 0), Outlier.WHEELS),
    ],
)
def test_two_that_agree_tell_which_is_wrong(wheels, imu, expected):
    votes = MotionVotes(None if wheels is None else MOTION + wheels, MOTION + imu, 0.1)
    assert votes.outlier(MOTION) is expected


def test_headings_are_compared_the_short_way_round():
    near_pi = np.array([0.0, 0.0, math.pi - 0.001])
    votes = MotionVotes(near_pi, np.array([0.0, 0.0, -math.pi + 0.001]), 0.1)
    assert votes.outlier(near_pi) is Outlier.WHEELS
