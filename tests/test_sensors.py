"""The sensors: quantisation, noise, bias, and a scan that motion distorts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.truths import truth_at

from simloop.config import EncoderConfig, ImuConfig, LidarConfig
from simloop.sensors import Encoders, Imu, Lidar, beam_rays


class Wall:
    """A world with one wall, the plane x = 3 m."""

    def cast(self, origins_m, directions, cutoff_m):
        with np.errstate(divide="ignore"):
            ranges = (3.0 - origins_m[:, 0]) / directions[:, 0]
        return np.where((ranges > 0) & (ranges < cutoff_m), ranges, -1.0)


def test_encoders_count_whole_steps():
    encoders = Encoders(EncoderConfig())
    step = 2 * math.pi / 980
    reading = encoders.read(truth_at(sprocket=(step * 10.4, -step * 0.1)))
    assert (reading.left_counts, reading.right_counts) == (10, -1)
    turn = encoders.read(truth_at(sprocket=(2 * math.pi + 1e-9, 0.0)))
    assert turn.left_counts == 980


def test_imu_noise_has_the_data_sheets_density_and_a_constant_bias():
    config = replace(ImuConfig(), gyro_bias_walk_radps_rts=0.0, accel_bias_walk_mps2_rts=0.0)
    imu = Imu(config, 0.01, np.random.default_rng(1))
    truth = truth_at(rates=(0, 0, 0, 0.1, 0.2, 0.3))
    gyro = np.array([imu.read(truth).gyro_radps for _ in range(4000)])
    assert gyro.std(axis=0) == pytest.approx(config.gyro_noise_radps_rthz * 10.0, rel=0.05)
    assert gyro.mean(axis=0) == pytest.approx(np.array([0.1, 0.2, 0.3]) + imu.bias[:3], abs=2e-4)
    assert np.abs(imu.bias[:3]).max() > 1e-4


def test_imu_bias_walks():
    ends = []
    for seed in range(200):
        imu = Imu(ImuConfig(), 0.01, np.random.default_rng(seed))
        start = imu.bias.copy()
        for _ in range(100):
            imu.read(truth_at())
        ends.append(imu.bias - start)
    spread = np.std(ends, axis=0)
    assert spread[:3] == pytest.approx(ImuConfig().gyro_bias_walk_radps_rts, rel=0.2)
    assert spread[3:] == pytest.approx(ImuConfig().accel_bias_walk_mps2_rts, rel=0.2)


def sweep_of(lidar, start, end, ticks=10):
    """One turn while the body moves evenly between two poses."""
    scan, before = None, truth_at(0.0, start)
    for k in range(1, ticks + 1):
        pose = np.asarray(start) + k / ticks * (np.asarray(end) - np.asarray(start))
        now = truth_at(0.01 * k, tuple(pose))
        scan = lidar.sweep(before, now, Wall())
        assert (scan is None) == (k < ticks)
        before = now
    return scan


def quiet_lidar(seed=0, **changes):
    config = replace(LidarConfig(), **{"noise_m": 0.0, "dropout": 0.0, **changes})
    return Lidar(config, 0.1, np.array([0.0, 0.0, 0.2]), np.random.default_rng(seed))


def test_a_standing_robot_sees_the_wall_where_it_is():
    scan = sweep_of(quiet_lidar(), (0, 0, 0), (0, 0, 0))
    seen = np.isfinite(scan.ranges_m)
    x = scan.ranges_m[seen] * np.cos(scan.angles_rad[seen])
    assert seen.sum() > 100
    assert x == pytest.approx(3.0, abs=1e-9)
    assert np.all(scan.ranges_m[~seen] == np.inf)


def test_a_moving_robot_gets_each_beam_from_the_pose_of_its_instant():
    end = np.array([0.045, 0.0, 0.16])
    scan = sweep_of(quiet_lidar(), (0, 0, 0), end)
    fraction = 1.0 - scan.age_ns / 1e8
    yaw, x = fraction * end[2], fraction * end[0]
    seen = np.isfinite(scan.ranges_m)
    wall = x + scan.ranges_m * np.cos(scan.angles_rad + yaw)
    # Attitude is interpolated between ticks by a chord, hence the hair of tolerance.
    assert wall[seen] == pytest.approx(3.0, abs=1e-5)
    skewed = (scan.ranges_m * np.cos(scan.angles_rad))[seen]
    assert np.ptp(skewed) > 0.05


def test_ages_run_to_zero_over_one_turn():
    scan = sweep_of(quiet_lidar(), (0, 0, 0), (0, 0, 0))
    assert scan.age_ns[-1] == 0
    assert scan.t_ns == 100_000_000
    assert np.all(np.diff(scan.age_ns) < 0)
    assert scan.age_ns[0] < 100_000_000


def test_range_noise_dropout_and_limits():
    lidar = quiet_lidar(noise_m=0.01, dropout=0.1, range_max_m=4.0, rays=3600)
    scan = sweep_of(lidar, (0, 0, 0), (0, 0, 0))
    cos = np.cos(scan.angles_rad)
    hit = (cos > 0) & (3.0 / np.where(cos > 0, cos, 1) < 3.9)
    lost = ~np.isfinite(scan.ranges_m[hit])
    assert lost.mean() == pytest.approx(0.1, abs=0.02)
    error = scan.ranges_m[hit][~lost] - 3.0 / cos[hit][~lost]
    assert error.std() == pytest.approx(0.01, rel=0.1)
    assert not np.isfinite(scan.ranges_m[~hit & (3.0 / np.maximum(cos, 1e-9) > 4.1)]).any()


def test_beams_follow_the_attitude_in_all_three_axes():
    rng = np.random.default_rng(3)
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    origins, directions = np.empty((5, 3)), np.empty((5, 3))
    angles = np.linspace(-3, 3, 5)
    mount = np.array([0.1, -0.2, 0.3])
    beam_rays(np.ones(3), q, np.ones(3), q, np.full(5, 0.5), angles, mount, origins, directions)
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    rotation = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    expected = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(5))) @ rotation.T
    np.testing.assert_allclose(directions, expected, atol=1e-12)
    np.testing.assert_allclose(origins, np.tile(1 + rotation @ mount, (5, 1)), atol=1e-12)


def test_the_accelerometer_errs_by_its_own_noise_and_its_own_bias():
    config = replace(ImuConfig(), gyro_bias_walk_radps_rts=0.0, accel_bias_walk_mps2_rts=0.0)
    imu = Imu(config, 0.01, np.random.default_rng(2))
    accel = np.array([imu.read(truth_at()).accel_mps2 for _ in range(4000)])
    assert accel.std(axis=0) == pytest.approx(config.accel_noise_mps2_rthz * 10.0, rel=0.05)
    mean = imu.bias[3:] + truth_at().acceleration_mps2
    assert accel.mean(axis=0) == pytest.approx(mean, abs=2e-3)
    biases = [Imu(config, 0.01, np.random.default_rng(s)).bias for s in range(400)]
    sizes = [config.gyro_bias_radps] * 3 + [config.accel_bias_mps2] * 3
    assert np.std(biases, axis=0) == pytest.approx(sizes, rel=0.12)


def test_nothing_is_told_from_within_the_blind_zone_or_beyond_the_reach():
    near = sweep_of(quiet_lidar(range_min_m=3.2), (0, 0, 0), (0, 0, 0))
    true = 3.0 / np.maximum(np.cos(near.angles_rad), 1e-9)
    assert np.all(np.isinf(near.ranges_m[true < 3.2]))
    assert np.all(np.isfinite(near.ranges_m[(true > 3.2) & (true < 11.9)]))
    # A wall just within reach, whose noise would carry it beyond.
    far = sweep_of(quiet_lidar(range_max_m=3.01, noise_m=0.02, rays=3600), (0, 0, 0), (0, 0, 0))
    heard = np.isfinite(far.ranges_m)
    assert heard.sum() > 50 and far.ranges_m[heard].max() <= 3.01


def test_the_lasers_place_on_the_body_is_that_of_the_beams():
    config = replace(LidarConfig(), noise_m=0.0, dropout=0.0)
    lidar = Lidar(config, 0.1, np.array([0.3, 0.2, 0.2]), np.random.default_rng(0))
    yaw = 0.7
    scan = sweep_of(lidar, (1.0, 0.0, yaw), (1.0, 0.0, yaw))
    seen = np.isfinite(scan.ranges_m)
    x = 1.0 + 0.3 * math.cos(yaw) - 0.2 * math.sin(yaw)
    wall = x + scan.ranges_m * np.cos(scan.angles_rad + yaw)
    assert wall[seen] == pytest.approx(3.0, abs=1e-9)


@pytest.mark.parametrize(("rays", "period_s"), [(8, 0.1), (360, 4.0), (9, 0.37)])
def test_a_period_without_a_beam_casts_nothing_and_no_beam_is_lost(rays, period_s):
    """The laser has fewer beams in a turn than there are control periods."""

    class CountingWall(Wall):
        def __init__(self):
            self.counts = []

        def cast(self, origins_m, directions, cutoff_m):
            self.counts.append(len(origins_m))
            return super().cast(origins_m, directions, cutoff_m)

    config = replace(LidarConfig(), rays=rays, noise_m=0.0, dropout=0.0)
    lidar = Lidar(config, period_s, np.array([0.0, 0.0, 0.2]), np.random.default_rng(0))
    world, scans = CountingWall(), []
    for k in range(3 * round(period_s / 0.01)):
        before, now = truth_at(0.01 * k, (0, 0, 0)), truth_at(0.01 * (k + 1), (0, 0, 0))
        scan = lidar.sweep(before, now, world)
        scans += [] if scan is None else [scan]
    assert len(scans) == 3 and sum(world.counts) == 3 * rays and min(world.counts) > 0
    seen = np.isfinite(scans[1].ranges_m)
    x = scans[1].ranges_m[seen] * np.cos(scans[1].angles_rad[seen])
    assert seen.any() and x == pytest.approx(3.0, abs=1e-9)
