"""The filter: Jacobians against finite differences, consistency over seeds, gates, rest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.vehicles import plant_on_plane
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from simloop.common.profiler import Profiler
from simloop.config import EkfConfig, EncoderConfig, ImuConfig, VehicleConfig
from simloop.ekf import Ekf, PeriodicEkf
from simloop.estimation.ekf_model import (
    BIAS,
    GAUGE,
    LEAST_GAUGE,
    MOST_GAUGE,
    NO_LEFT,
    NO_RIGHT,
    OFFSET,
    RATE,
    SLIPPING_VAR,
    SPEED,
    STATES,
    gyro_jacobian,
    motion,
    motion_jacobian,
    motion_noise,
    wheel_jacobian,
    wheel_speed,
)
from simloop.geometry.se2 import wrap_angle
from simloop.localiser import Localiser
from simloop.messages import EncoderReading, Frames, ImuReading, PoseFix, Readings
from simloop.physics.plant import Plant
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.sensors import Encoders, Imu, Lidar
from simloop.truth import Truth

DT = 0.01
GAUGE_M = VehicleConfig().gauge_m
METRES_A_COUNT = 2 * math.pi * 0.037 / 980
states = st.tuples(
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.floats(-3, 3),
    st.floats(-0.5, 0.5),
    st.floats(-2, 2),
    st.floats(-0.01, 0.01),
    st.floats(1.0, 1.6),
    st.floats(-0.05, 0.05),
    st.floats(-0.1, 0.1),
).map(np.array)
WALK = np.array([0.1, 1.0, 0.01, 2e-5, 0.015, 0.005, 0.005])
NO_GATES = np.full(3, 1e9)


def inputs_row(accel=0.0, wheels=(0.0, 0.0), gyro=0.0, wheel_var=1e-4, gyro_var=3e-6, shove=0.0):
    return np.array([accel, DT, *wheels, gyro, wheel_var, wheel_var, gyro_var, shove, 0.0, 0.0])


def finite_difference(function, x, h=1e-6):
    columns = [(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(len(x))]
    return np.column_stack(columns)


@given(states, st.floats(-1, 1))
@settings(max_examples=60)
def test_motion_jacobian(x, accel):
    numeric = finite_difference(lambda s: motion(s, accel, DT), x)
    np.testing.assert_allclose(motion_jacobian(x, accel, DT), numeric, atol=1e-7)


@given(states, st.sampled_from([1.0, -1.0]))
@settings(max_examples=60)
def test_wheel_jacobian(x, side):
    numeric = finite_difference(lambda s: np.array([wheel_speed(s, GAUGE_M, side)]), x)
    np.testing.assert_allclose(wheel_jacobian(x, GAUGE_M, side), numeric[0], atol=1e-7)


@given(states)
@settings(max_examples=20)
def test_gyro_jacobian(x):
    numeric = finite_difference(lambda s: np.array([s[RATE] + s[BIAS]]), x)
    np.testing.assert_allclose(gyro_jacobian(), numeric[0], atol=1e-7)


@given(states)
@settings(max_examples=60)
def test_belts_of_the_models_centres_of_rotation(x):
    """v_x = (V_r y_l - V_l y_r) / (y_l - y_r), w = (V_r - V_l) / (y_l - y_r): Martinez 2005."""
    y_l, y_r = x[OFFSET] + 0.5 * x[GAUGE] * GAUGE_M, x[OFFSET] - 0.5 * x[GAUGE] * GAUGE_M
    left, right = wheel_speed(x, GAUGE_M, 1.0), wheel_speed(x, GAUGE_M, -1.0)
    assert (right - left) / (y_l - y_r) == pytest.approx(x[RATE], abs=1e-9)
    assert (right * y_l - left * y_r) / (y_l - y_r) == pytest.approx(x[SPEED], abs=1e-9)


@given(states)
@settings(max_examples=60)
def test_process_noise_is_a_covariance(x):
    noise = motion_noise(x, DT, WALK, 1e-4)
    np.testing.assert_allclose(noise, noise.T, rtol=0.0, atol=1e-20)
    assert np.linalg.eigvalsh(noise).min() > -1e-15


def random_covariance(seed):
    size = [0.1, 0.1, 0.05, 0.1, 0.2, 1e-3, 0.1, 0.02, 0.05]
    root = np.random.default_rng(seed).normal(size=(STATES, STATES)) * size
    return root.T @ root + 1e-8 * np.eye(STATES)


def filterpys_step(kf, inputs, gates):
    """The oracle: filterpy's own predict and update with the same models, one scalar at a time."""
    accel, _, *belts, gyro, wheel_var, _, gyro_var, shove, _, _ = inputs
    x = kf.x
    kf.F = motion_jacobian(x, accel, DT)
    kf.Q = motion_noise(x, DT, WALK, shove)
    kf.predict_x = lambda u=0: setattr(kf, "x", motion(x, accel, DT))
    kf.predict()
    row = gyro_jacobian()[None]
    kf.update(np.array([gyro]), lambda _: row, lambda s: row @ s, np.array([[gyro_var]]))
    rows = np.array([wheel_jacobian(kf.x, GAUGE_M, side) for side in (1.0, -1.0)])
    off = np.array(belts) - [wheel_speed(kf.x, GAUGE_M, side) for side in (1.0, -1.0)]
    spread = rows @ kf.P @ rows.T + (wheel_var + gates[2]) * np.eye(2)
    alone = off**2 / np.diag(spread)
    refused = np.zeros(2, bool)
    if off @ np.linalg.solve(spread, off) > gates[1]:
        refused = (alone == alone.max()) | (alone > gates[0])
    for side, z, out in zip((1.0, -1.0), belts, refused, strict=True):
        kf.update(
            np.array([z]),
            lambda s, side=side: wheel_jacobian(s, GAUGE_M, side)[None],
            lambda s, side=side: np.array([wheel_speed(s, GAUGE_M, side)]),
            np.array([[SLIPPING_VAR if out else wheel_var]]),
        )
    return refused


@given(
    states,
    st.integers(0, 2**32 - 1),
    st.floats(-1, 1),
    st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-2, 2)).map(np.array),
    st.sampled_from([1e-6, 1e-4]),
    st.sampled_from([1e-9, 18.0, 1e9]),
    st.sampled_from([0.0, 1e-4, 0.1]),
)
@settings(max_examples=60)
def test_the_compiled_step_is_filterpys_predict_and_update(
    x, seed, accel, z, wheel_var, gate, lone_var
):
    covariance, gates = random_covariance(seed), np.array([0.8 * gate, gate, lone_var])
    ours, theirs = (PeriodicEkf(dim_x=STATES, dim_z=3) for _ in range(2))
    for kf in (ours, theirs):
        kf.x, kf.P = x.copy(), covariance.copy()
    inputs = inputs_row(accel, (z[0], z[1]), z[2], wheel_var, shove=1e-5)
    refused = filterpys_step(theirs, inputs, gates)
    ours.predict_and_correct(inputs, WALK, GAUGE_M, gates)
    assert [inputs[NO_LEFT], inputs[NO_RIGHT]] == refused.tolist()
    theirs.x[GAUGE] = np.clip(theirs.x[GAUGE], LEAST_GAUGE, MOST_GAUGE)
    off = ours.x - theirs.x
    off[2] = wrap_angle(off[2])
    np.testing.assert_allclose(off, 0.0, atol=1e-10)
    np.testing.assert_allclose(ours.P, theirs.P, atol=1e-11 * np.abs(theirs.P).max() + 1e-13)
    np.testing.assert_array_equal(ours.P, ours.P.T)


def test_a_gyro_that_contradicts_the_belts_leaves_the_gauge_ratio_usable():
    """A robot at rest whose gyro says that it spins: the belts could only fit with a gauge of 0."""
    kf = make_filter()
    for i in range(1, 200):
        kf.advance(*reading(i * 10_000_000, 0.0, 0.0, rate=700.0), may_move=True)
        state = kf.estimate().state
        assert np.isfinite(state).all() and LEAST_GAUGE <= state[GAUGE] <= MOST_GAUGE


def test_a_belief_that_was_given_away_never_changes():
    kf = make_filter()
    for i in range(1, 21):
        before = kf.estimate()
        kept = before.state.copy(), before.covariance.copy()
        kf.advance(*reading(i * 10_000_000, 0.003 * i, 0.002 * i, rate=0.2))
        kf.correct(PoseFix(i * 10_000_000, np.array([0.3, 0.0, 0.0]), np.eye(3) * 1e-5, 1.0, True))
        np.testing.assert_array_equal(before.state, kept[0])
        np.testing.assert_array_equal(before.covariance, kept[1])


def make_filter(**changes) -> Ekf:
    config = replace(EkfConfig(), **changes)
    return Ekf(config, EncoderConfig(), ImuConfig(), VehicleConfig(), np.zeros(3), DT)


def reading(t_ns, left_m, right_m, rate=0.0, accel=0.0):
    counts = (math.floor(left_m / METRES_A_COUNT), math.floor(right_m / METRES_A_COUNT))
    imu = ImuReading(t_ns, np.array([0.0, 0.0, rate]), np.array([accel, 0.0, 9.81]))
    return EncoderReading(t_ns, *counts), imu


def simulate(seed, seconds=10.0):
    """Simulate turns with fixes and quantised encoders; return the last belief and the truth."""
    rng, config = np.random.default_rng(seed), EkfConfig()
    k, bias = 1.0 / 0.811, rng.normal() * config.gyro_bias_std
    x = np.array([0, 0, 0, 0, 0, bias, rng.normal(config.gauge_ratio, 0.03), 0.0, 0.0])
    kf, left, right = make_filter(gauge_ratio_std=0.03), 0.0, 0.0
    k = x[GAUGE]
    sd = np.array([0.004, 0.004, 0.002])
    for i in range(1, round(seconds / DT) + 1):
        t_ns = i * 10_000_000
        accel = 0.4 * math.cos(0.5 * i * DT) * 0.5
        accel_walk = rng.normal() * config.speed_walk / math.sqrt(DT)
        spin = 0.8 * math.cos(0.8 * i * DT) + rng.normal() * config.yaw_rate_walk / math.sqrt(DT)
        rate_next = 0.9 * x[RATE] + 0.1 * (0.8 * math.sin(0.8 * i * DT)) + 0.3 * spin * DT
        mean_rate, mean_speed = 0.5 * (x[RATE] + rate_next), x[SPEED] + 0.5 * accel * DT
        aside = config.lateral_walk * x[RATE] * math.sqrt(DT) * rng.normal()
        yaw = x[2] + 0.5 * mean_rate * DT
        x[0] += mean_speed * math.cos(yaw) * DT - aside * math.sin(yaw)
        x[1] += mean_speed * math.sin(yaw) * DT + aside * math.cos(yaw)
        x[2] = wrap_angle(x[2] + mean_rate * DT)
        left += (mean_speed - 0.5 * GAUGE_M * k * mean_rate) * DT
        right += (mean_speed + 0.5 * GAUGE_M * k * mean_rate) * DT
        x[SPEED] += (accel + 0.2 * accel_walk) * DT
        x[RATE] = rate_next
        gyro = x[RATE] + bias + rng.normal() * ImuConfig().gyro_noise_radps_rthz * 10.0
        kf.advance(*reading(t_ns, left, right, gyro, accel))
        if i % 10 == 0:
            z = x[:3] + sd * rng.normal(size=3)
            kf.correct(PoseFix(t_ns, z, np.diag(sd**2), 1.0, True))
    return kf.estimate(), x


def nees_of_the_filters_own_model(seed, seconds=5.0):
    """The pose's NEES after each fix, 10 a second; the truth follows the filter's own model.

    It starts where the first covariance has it, moves with the process noise, and is measured
    with just the noises that are stated.
    """
    rng, config = np.random.default_rng(seed), EkfConfig()
    wheel_sd, gyro_sd, fix_sd = 0.01, 0.0017, np.array([0.004, 0.004, 0.002])
    first_sd = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, config.gyro_bias_std, 0.03, 0.01, 0.01])
    kf, values = PeriodicEkf(dim_x=STATES, dim_z=3), []
    kf.x, kf.P = np.eye(STATES)[GAUGE] * config.gauge_ratio, np.diag(first_sd**2)
    x = kf.x + first_sd * rng.normal(size=STATES)
    for i in range(1, round(seconds / DT) + 1):
        accel, noise = 0.2 * math.cos(0.5 * i * DT), motion_noise(x, DT, WALK, 0.0)
        x = rng.multivariate_normal(motion(x, accel, DT), noise, method="eigh")
        belts = [wheel_speed(x, GAUGE_M, side) for side in (1.0, -1.0)]
        z = np.array([*belts, x[RATE] + x[BIAS]])
        z += [wheel_sd, wheel_sd, gyro_sd] * rng.normal(size=3)
        inputs = inputs_row(accel, z[:2], z[2], wheel_sd**2, gyro_sd**2)
        kf.predict_and_correct(inputs, WALK, GAUGE_M, NO_GATES)
        if i % 10 == 0:
            fix, noise = x[:3] + fix_sd * rng.normal(size=3), np.diag(fix_sd**2)
            kf.update(fix, lambda _: np.eye(3, STATES), lambda s: s[:3], R=noise, residual=pose_off)
            error = pose_off(kf.x[:3], x[:3])
            values.append(error @ np.linalg.solve(kf.P[:3, :3], error))
    return values


def pose_off(a, b):
    """The difference of two poses, its yaw wrapped."""
    return np.array([*(a - b)[:2], wrap_angle(a[2] - b[2])])


def test_nees_over_sixty_seeds_is_inside_its_band():
    """Mean of the pose's NEES, judged at one instant a second.

    Successive instants are correlated; those a second apart hardly, so the band is that of a
    chi-square with 3 degrees of freedom for each (Bar-Shalom 2001, 5.4.2), 95 % two-sided.
    """
    values = np.concatenate([nees_of_the_filters_own_model(seed)[9::10] for seed in range(60)])
    low, high = chi2.ppf([0.025, 0.975], 3 * len(values)) / len(values)
    assert low < values.mean() < high, (low, values.mean(), high)


def test_bias_and_gauge_ratio_are_learnt():
    off = []
    for seed in range(5):
        estimate, truth = simulate(seed, 20.0)
        off.append((estimate.state - truth)[[BIAS, GAUGE]])
    assert np.abs(off).mean(axis=0)[0] < 2e-3
    assert np.abs(off).mean(axis=0)[1] < 0.03


def test_at_rest_the_bias_is_learnt_and_the_pose_stays():
    kf = make_filter()
    for i in range(1, 301):
        kf.advance(*reading(i * 10_000_000, 0.0, 0.0, rate=0.004, accel=0.05))
    estimate = kf.estimate()
    assert kf.stationary
    assert estimate.state[BIAS] == pytest.approx(0.004, abs=2e-4)
    assert np.abs(estimate.pose).max() < 2e-3


def test_a_belt_that_spins_free_is_gated():
    calm, wild = make_filter(), make_filter()
    for i in range(1, 101):
        for kf in (calm, wild):
            kf.advance(*reading(i * 10_000_000, 0.002 * i, 0.002 * i))
    t = 101 * 10_000_000
    calm.advance(*reading(t, 0.202, 0.202))
    wild.advance(*reading(t, 0.202 + 0.05, 0.202))  # one belt at 5 m/s
    assert wild.estimate().speed == pytest.approx(calm.estimate().speed, abs=0.02)
    assert wild.estimate().yaw_rate == pytest.approx(calm.estimate().yaw_rate, abs=0.02)


def test_a_fix_far_off_is_refused_four_times_and_then_taken():
    kf = make_filter()
    for i in range(1, 51):
        kf.advance(*reading(i * 10_000_000, 0.0, 0.0))
    far = PoseFix(500_000_000, np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-5, 1.0, True)
    answers = [kf.correct(far) for _ in range(6)]
    assert answers[:4] == [False] * 4
    assert any(answers)
    assert kf.estimate().pose[0] == pytest.approx(1.0, abs=0.05)


def test_a_good_fix_resets_the_count_of_refused_ones():
    kf = make_filter()
    for i in range(1, 51):
        kf.advance(*reading(i * 10_000_000, 0.0, 0.0))
    far, here = (
        PoseFix(500_000_000, np.array([x, 0.0, 0.0]), np.eye(3) * 1e-5, 1.0, True)
        for x in (1.0, 0.0)
    )
    for _ in range(4):
        answers = [kf.correct(far) for _ in range(4)]
        assert answers == [False] * 4
        assert kf.correct(here)
    assert kf.estimate().pose[0] == pytest.approx(0.0, abs=0.01)


def test_a_robot_that_turns_while_its_sprockets_stand_does_not_rest():
    """Pushed or sliding: the counts stand, the gyro turns, and rest begins when it is quiet."""
    kf, turned_s = make_filter(), 1.0
    for i in range(1, 201):
        rate = 0.3 if i * DT <= turned_s else 0.0
        kf.advance(*reading(i * 10_000_000, 0.0, 0.0, rate=rate))
        quiet_s = i * DT - turned_s
        assert kf.stationary == (quiet_s >= 0.2 - 1e-9)


def test_a_fix_that_is_not_ok_changes_nothing():
    kf = make_filter()
    before = kf.estimate()
    assert not kf.correct(PoseFix(0, np.ones(3) * 0.001, np.eye(3) * 1e-5, 0.0, False))
    np.testing.assert_array_equal(kf.estimate().state, before.state)


def test_yaw_residual_wraps():
    kf = Ekf(
        EkfConfig(),
        EncoderConfig(),
        ImuConfig(),
        VehicleConfig(),
        np.array([0.0, 0.0, math.pi - 1e-3]),
        DT,
    )
    fix = PoseFix(0, np.array([0.0, 0.0, -math.pi + 1e-3]), np.eye(3) * 1e-6, 1.0, True)
    assert kf.correct(fix)
    assert abs(kf.estimate().pose[2]) == pytest.approx(math.pi, abs=2e-3)


def driven(seed: int, seconds: float = 8.0) -> list[Truth]:
    """Truths of the plant under random voltages: turns, stops, and reversing."""
    plant, rng = plant_on_plane(), np.random.default_rng(seed)
    volts, aim, truths = np.zeros(2), np.zeros(2), []
    for i in range(round(seconds / DT)):
        if i % 100 == 30:
            aim = rng.uniform(-6.0, 16.0) + rng.uniform(-6.0, 6.0) * np.array([-1.0, 1.0])
        volts = volts + np.clip(aim - volts, -0.3, 0.3)
        truths.append(plant.step(volts))
    return truths


def nees_with_synthetic_fixes(truths: list[Truth], seed: int) -> np.ndarray:
    """The pose's NEES at 10 Hz: the plant's encoders and IMU, fixes of a stated covariance."""
    rng = np.random.default_rng(seed)
    encoders, imu, kf = Encoders(EncoderConfig()), Imu(ImuConfig(), DT, rng), make_filter()
    deviation, values = np.array([0.004, 0.004, 0.002]), []
    for i, truth in enumerate(truths, 1):
        kf.advance(encoders.read(truth), imu.read(truth))
        if i % 10 == 0:
            pose = truth.pose_xyyaw + deviation * rng.normal(size=3)
            kf.correct(PoseFix(truth.t_ns, pose, np.diag(deviation**2), 1.0, True))
            estimate = kf.estimate()
            error = estimate.pose - truth.pose_xyyaw
            error[2] = wrap_angle(error[2])
            values.append(error @ np.linalg.solve(estimate.covariance[:3, :3], error))
    return np.array(values)


def test_nees_on_the_plant_over_sixty_seeds_is_inside_its_band():
    """Encoders and IMU from the plant, with its own slip of the tracks, over four drives."""
    drives = [driven(seed) for seed in range(4)]
    runs = np.array([nees_with_synthetic_fixes(drives[seed % 4], seed) for seed in range(60)])
    low, high = chi2.ppf([0.025, 0.975], 3 * len(runs)) / len(runs)
    assert low < runs.mean() < high, (low, runs.mean(), high)


def test_the_maps_error_is_considered_and_no_fix_takes_it_away():
    kf = make_filter()
    kf.advance(*reading(10_000_000, 0.0, 0.0))
    kf.add_map_error(1.0)
    first = kf.estimate().covariance[:3, :3] - kf.covariance_in_map
    assert np.all(np.diag(first) >= np.square([0.0012, 0.0012, 0.0005]))
    for i in range(2, 102):
        kf.advance(*reading(i * 10_000_000, 0.004 * i, 0.004 * i))
        pose = np.array([0.004 * i, 0.0, 0.0])
        kf.correct(PoseFix(i * 10_000_000, pose, np.eye(3) * 1e-7, 1.0, True))
        kf.add_map_error(0.0)
    last = kf.estimate().covariance[:3, :3] - kf.covariance_in_map
    # Nothing new was seen: yaw's part is as it was, and has become one of y, 0.4 m further on.
    assert last[2, 2] == pytest.approx(first[2, 2])
    way = kf.estimate().pose[0]
    assert last[1, 1] == pytest.approx(first[1, 1] + way**2 * first[2, 2], rel=0.05)
    kf.add_map_error(0.5)
    assert kf.estimate().covariance[0, 0] - kf.covariance_in_map[0, 0] > last[0, 0]


@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, -2.0])
def test_a_yaw_error_of_the_map_is_a_lateral_error_further_on(heading):
    """A yaw error e of the map moves a place d ahead of the start sideways by e d."""
    parts = EkfConfig(), EncoderConfig(), ImuConfig(), VehicleConfig()
    kf = Ekf(*parts, np.array([0.0, 0.0, heading]), DT)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    kf.advance(*reading(10_000_000, 0.0, 0.0))
    kf.add_map_error(1.0)
    first = kf.estimate().covariance[:3, :3] - kf.covariance_in_map
    for i in range(2, 102):
        kf.advance(*reading(i * 10_000_000, 0.004 * i, 0.004 * i))
        pose = np.array([*(0.004 * i * ahead), heading])
        kf.correct(PoseFix(i * 10_000_000, pose, np.eye(3) * 1e-7, 1.0, True))
        kf.add_map_error(0.0)
    last = kf.estimate().covariance[:3, :3] - kf.covariance_in_map
    way = kf.estimate().pose[:2] @ ahead
    to_left = way * np.array([-ahead[1], ahead[0]])
    np.testing.assert_allclose((last - first)[:2, 2], to_left * first[2, 2], atol=2e-9)


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9])
def test_wheels_alone_keep_the_yaw_over_ten_turns_once_the_centres_are_learnt(friction):
    """Turning on the spot in a room: encoders with the learnt k within 3 %; nominal 20 % off."""
    scenario = load("faults", [f"tracks.friction={friction}", "obstacles=[]"], seed=5)
    world, config = build_world(scenario), scenario.config
    plant = Plant(world.model, config)
    start = np.array([1.8, 1.9, 0.0])
    truth = plant.reset(start)
    rngs = [np.random.default_rng(i) for i in range(3)]
    encoders = Encoders(config.encoder)
    imu = Imu(config.imu, config.rates.control_s, rngs[1])
    lidar = Lidar(config.lidar, config.rates.lidar_s, plant.base_from_laser, rngs[2])
    localiser = Localiser(config, start, plant.base_from_laser, Profiler())
    wheels, true, nominal = [], [], []
    metres_a_count = 2.0 * math.pi * 0.037 / config.encoder.counts_per_turn
    while not true or true[-1] < 22.0 * math.pi:
        before, truth = truth, plant.step(np.array([-9.0, 9.0]))
        counts = encoders.read(truth)
        scan = lidar.sweep(before, truth, plant)
        localiser.predict(Readings(counts, imu.read(truth), scan), driven=True)
        located = None if scan is None else localiser.match(scan, None)
        if located is not None:
            localiser.enter(located, None)
        localiser.conclude()
        (frames,) = [m for m in localiser.messages if isinstance(m, Frames)]
        by_wheels = frames.odom_from_base_by_wheels
        for found, yaw in ((wheels, by_wheels[2]), (true, truth.pose_xyyaw[2])):
            found.append(yaw if not found else found[-1] + wrap_angle(yaw - found[-1]))
        belts = (counts.right_counts - counts.left_counts) * metres_a_count
        nominal.append(belts / config.vehicle.gauge_m)
    learnt = int(np.searchsorted(true, 2.0 * math.pi))  # one turn to learn in
    turned = true[-1] - true[learnt]
    assert turned > 19.9 * math.pi
    assert (wheels[-1] - wheels[learnt]) / turned == pytest.approx(1.0, abs=0.03)
    assert abs((nominal[-1] - nominal[learnt]) / turned - 1.0) > 0.15
