"""Dead reckoning: arcs, the tracks' centres of rotation, and the frames' algebra."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.config import EncoderConfig, VehicleConfig
from simloop.estimation.dead_reckoning import DeadReckoning, belt_motion, move, transforms
from simloop.estimation.ekf_model import GAUGE, ICR_X, OFFSET, RATE, SPEED, STATES, wheel_speed
from simloop.geometry.se2 import compose
from simloop.messages import EncoderReading, Estimate

PERIOD_NS = 10_000_000
GAUGE_M = VehicleConfig().gauge_m
METRES_A_COUNT = 2.0 * math.pi * VehicleConfig().sprocket_radius_m / EncoderConfig().counts_per_turn
poses = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3)).map(np.array)


def state_of(speed=0.0, rate=0.0, gauge=1.2, offset=0.0, icr_x=0.0, pose=(0.0, 0.0, 0.0)):
    state = np.zeros(STATES)
    state[:3], state[SPEED], state[RATE] = pose, speed, rate
    state[GAUGE], state[OFFSET], state[ICR_X] = gauge, offset, icr_x
    return state


def test_small_moves_along_a_circle_close_it():
    pose, n = np.array([1.0, 2.0, 0.3]), 2000
    for _ in range(n):
        move(pose, 0.5 * 2 * math.pi / n, 0.0, 2 * math.pi / n)
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.3], atol=1e-5)


@given(poses, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_without_a_turn_a_move_is_a_shift_in_the_own_frame(pose, forward, lateral):
    expected = compose(pose, np.array([forward, lateral, 0.0]))
    move(pose, forward, lateral, 0.0)
    np.testing.assert_allclose(pose, expected, atol=1e-12)


@given(st.floats(-0.6, 0.6), st.floats(-2, 2), st.floats(-0.05, 0.05), st.floats(-0.1, 0.1))
def test_belt_motion_is_the_inverse_of_the_filters_belt_speeds(speed, rate, offset, icr_x):
    state = state_of(speed, rate, offset=offset, icr_x=icr_x)
    left, right = (wheel_speed(state, GAUGE_M, side) for side in (1.0, -1.0))
    motion = belt_motion(left, right, state, GAUGE_M)
    np.testing.assert_allclose(motion, [speed, -icr_x * rate, rate], atol=1e-9)


@given(poses, poses)
def test_map_from_odom_takes_odom_to_the_belief(odom, pose):
    out = transforms(odom, np.zeros(3), pose)
    there = compose(out[1], odom)
    np.testing.assert_allclose(there[:2], pose[:2], atol=1e-9)
    assert math.remainder(there[2] - pose[2], 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def driven(state, counts_a_period, periods=100):
    reckoning, left, right = DeadReckoning(VehicleConfig(), EncoderConfig()), 0, 0
    for i in range(1, periods + 1):
        estimate = Estimate(i * PERIOD_NS, state.copy(), np.eye(STATES))
        reckoning.advance(EncoderReading(i * PERIOD_NS, left, right), estimate)
        left, right = left + counts_a_period[0], right + counts_a_period[1]
    return reckoning, estimate


def test_odom_adds_up_the_filters_speeds_and_the_wheels_their_counts():
    reckoning, estimate = driven(state_of(speed=0.5), (10, 10))
    frames = reckoning.frames(estimate)
    np.testing.assert_allclose(frames.odom_from_base, [0.5 * 0.99, 0.0, 0.0], atol=1e-9)
    way = 99 * 10 * METRES_A_COUNT
    np.testing.assert_allclose(frames.odom_from_base_by_wheels, [way, 0.0, 0.0], atol=1e-9)


def test_a_fix_moves_map_from_odom_and_not_odom():
    reckoning, estimate = driven(state_of(speed=0.5), (10, 10))
    before = reckoning.frames(estimate)
    jumped = state_of(speed=0.5, pose=(3.0, -1.0, 0.5))
    after = reckoning.frames(Estimate(estimate.t_ns, jumped, np.eye(STATES)))
    np.testing.assert_array_equal(after.odom_from_base, before.odom_from_base)
    np.testing.assert_allclose(
        compose(after.map_from_odom, after.odom_from_base), [3.0, -1.0, 0.5], atol=1e-9
    )


def test_counts_that_are_not_new_move_nothing():
    reckoning, _ = driven(state_of(), (10, 10))
    before = reckoning.by_wheels.copy()
    late = EncoderReading(50 * PERIOD_NS, 0, 0)
    reckoning.advance(late, Estimate(101 * PERIOD_NS, state_of(), np.eye(STATES)))
    np.testing.assert_array_equal(reckoning.by_wheels, before)
