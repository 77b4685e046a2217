"""The tracker: speed profile, motor loop, slip made good, and a path followed in the plant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.paths import smooth
from helpers.tracking import (
    CONFIG,
    DRIVE,
    ENCODER,
    MOTOR,
    VEHICLE,
    K,
    Slewed,
    at_pose,
    drive_of,
    estimate_of,
    tracker_to,
)
from helpers.vehicles import plant_on_plane

from simloop.control.drive import sprocket_speeds
from simloop.geometry.se2 import wrap_angle
from simloop.messages import EncoderReading, Estimate, Mode, Velocity
from simloop.sensors import Encoders
from simloop.tracker import SPEED, speed_profile


def drive_along(points, start, goal=None, seconds=40.0):
    """Follow a path in the plant with the truth for an estimate: poses, commands, the tracker."""
    plant = plant_on_plane()
    truth = plant.reset(np.array(start, float))
    tracker = tracker_to(goal if goal is not None else points[-1])
    tracker.follow(smooth(points, start), K)
    slewed = Slewed(tracker)
    drive, encoders = drive_of(), Encoders(ENCODER)
    truths, commands = [truth], []
    for _ in range(round(seconds / 0.01)):
        estimate = estimate_of(truth)
        command = drive.command(*slewed.velocity(estimate), estimate, encoders.read(truth))
        truth = plant.step(command.voltage_v)
        truths.append(truth)
        commands.append(command)
        if tracker.arrived and abs(truth.velocity_body[0]) < 1e-3:
            break
    return truths, commands, tracker


def test_it_follows_bends_within_centimetres_and_stands_still_at_the_goal():
    points = [(0, 0), (1.2, 0.0), (1.6, 1.0), (2.6, 1.2)]
    path = smooth(points, (0, 0, 0))
    truths, _, tracker = drive_along(points, (0, 0, 0))
    poses = np.array([t.pose_xyyaw for t in truths])
    off = [np.hypot(*(path.xy_m - p[:2]).T).min() for p in poses]
    assert max(off) < 0.03
    assert tracker.arrived
    assert np.hypot(*(poses[-1, :2] - points[-1])) < 0.10
    assert truths[-1].t_ns * 1e-9 < 1.35 * path.arc_m[-1] / DRIVE.max_speed_mps


def test_it_turns_on_the_spot_when_the_path_lies_behind():
    truths, commands, tracker = drive_along([(0, 0), (-1.5, 0.0)], (0, 0, 0))
    turning = [t for t, c in zip(truths[1:], commands, strict=True) if c.mode == "turn"]
    assert len(turning) > 50
    assert max(np.hypot(*t.pose_xyyaw[:2]) for t in turning) < 0.03
    assert tracker.arrived


def test_asked_speeds_and_their_changes_keep_the_limits():
    _, commands, _ = drive_along([(0, 0), (1.0, 0.0), (1.0, 1.0), (2.0, 1.0)], (0, 0, 0))
    speed = np.array([c.speed_mps for c in commands])
    rate = np.array([c.yaw_rate_radps for c in commands])
    assert speed.max() <= DRIVE.max_speed_mps + 1e-9
    assert np.abs(rate).max() <= DRIVE.max_yaw_rate_radps + 1e-9
    assert np.diff(speed).max() <= DRIVE.max_accel_mps2 * 0.01 + 1e-9
    assert np.diff(speed).min() >= -DRIVE.max_brake_mps2 * 0.01 - 1e-9
    assert np.abs(np.diff(rate)).max() <= DRIVE.max_yaw_accel_radps2 * 0.01 + 1e-9
    assert max(np.abs(c.voltage_v).max() for c in commands) <= MOTOR.supply_v


def test_slip_is_made_good_before_it_happens():
    plant = plant_on_plane()
    truth = plant.reset(np.zeros(3))
    drive, encoders = drive_of(), Encoders(ENCODER)
    for _ in range(200):
        command = drive.command(
            Velocity(0.2, 0.6), Mode.FOLLOW, estimate_of(truth), encoders.read(truth)
        )
        truth = plant.step(command.voltage_v)
    assert truth.velocity_body[0] == pytest.approx(0.2, rel=0.03)
    assert truth.velocity_body[5] == pytest.approx(0.6, rel=0.03)


def test_the_motor_loop_makes_the_counts_come():
    plant = plant_on_plane()
    truth = plant.reset(np.zeros(3))
    drive, encoders = drive_of(), Encoders(ENCODER)
    ahead = Velocity(5.0 * VEHICLE.sprocket_radius_m, 0.0)
    for _ in range(300):
        command = drive.command(ahead, Mode.FOLLOW, estimate_of(truth), encoders.read(truth))
        truth = plant.step(command.voltage_v)
    assert truth.sprocket_radps == pytest.approx(5.0, rel=0.02)
    assert truth.sprocket_rad[0] == pytest.approx(15.0, abs=DRIVE.angle_error_limit_rad)


def test_standing_still_draws_no_current():
    plant = plant_on_plane()
    truth = plant.reset(np.zeros(3))
    drive, encoders = drive_of(), Encoders(ENCODER)
    for _ in range(50):
        command = drive.command(
            Velocity(0.0, 0.0), Mode.STOP, estimate_of(truth), encoders.read(truth)
        )
        truth = plant.step(command.voltage_v)
    assert np.abs(truth.motor_current_a).max() < 1e-3
    assert truth.energy_j < 1e-3


@pytest.mark.parametrize(("speed", "rate"), [(0.45, 1.0), (0.1, -1.6), (-0.3, 0.5)])
def test_a_track_too_fast_scales_both_and_keeps_the_curvature(speed, rate):
    left, right = sprocket_speeds(speed, rate, K * VEHICLE.gauge_m, 0.47, VEHICLE.sprocket_radius_m)
    assert max(abs(left), abs(right)) * VEHICLE.sprocket_radius_m <= 0.47 + 1e-9
    v = 0.5 * (left + right)
    w = (right - left) / (K * VEHICLE.gauge_m)
    assert w / v == pytest.approx(rate / speed, rel=1e-9)


def test_speed_is_lower_in_bends_and_near_obstacles():
    tracker = tracker_to((9, 9))
    tracker.follow(smooth([(0, 0), (1.0, 0.0), (1.0, 2.0)], (0, 0, 0)), K)
    path, profile = tracker.path, tracker._samples[:, SPEED]
    sharpest = int(np.argmax(np.abs(path.curvature_1pm)))
    assert profile[sharpest] * abs(path.curvature_1pm[sharpest]) <= DRIVE.max_yaw_rate_radps + 1e-9
    assert profile[sharpest] < 0.8 * profile.max()
    assert profile[-1] == 0.0
    braking = np.diff(profile**2) / (2 * np.diff(path.arc_m))
    assert braking.min() >= -DRIVE.max_decel_mps2 - 1e-6
    assert math.isclose(profile.max(), DRIVE.max_speed_mps, rel_tol=1e-6)


AHEAD = 0.6  # rad, which way the straight path leads


def straight_tracker():
    """Half way along a long, straight path, at full speed."""
    tracker, end = tracker_to((9, 9)), 2.5 * np.array([math.cos(AHEAD), math.sin(AHEAD)])
    tracker.follow(smooth([-end, end], (*-end, AHEAD)), K)
    tracker._at = len(tracker.path.arc_m) // 2
    return tracker


def beside_path(tracker, aside, off_heading):
    """The estimate so far to the left of where the tracker is, and turned so far from it."""
    left = np.array([-math.sin(AHEAD), math.cos(AHEAD)])
    return at_pose(*(tracker.path.xy_m[tracker._at] + aside * left), AHEAD + off_heading)


@pytest.mark.parametrize(
    ("y", "yaw"),
    [(0.008, 0), (-0.008, 0), (0, 0.02), (0, -0.02), (0.004, -0.015), (0.2, 0.1), (0, -0.7)],
)
def test_errors_are_steered_away_by_samsons_law(y, yaw):
    tracker = straight_tracker()
    (speed, rate), mode = tracker.velocity(beside_path(tracker, y, yaw))
    v = DRIVE.max_speed_mps
    sinc = math.sin(yaw) / yaw if yaw else 1.0
    wanted = -v * (CONFIG.lateral_gain_1pm2 * y * sinc + CONFIG.heading_gain_1pm * yaw)
    assert mode is Mode.FOLLOW
    assert rate == pytest.approx(wanted)
    assert speed == pytest.approx(v * math.cos(yaw))


def test_turning_on_the_spot_begins_late_and_ends_early():
    tracker = straight_tracker()
    for yaw, turning in ((0.75, False), (0.85, True), (0.3, True), (0.16, True), (0.14, False),
                         (0.3, False), (-0.85, True), (-0.1, False)):  # fmt: skip
        _, mode = tracker.velocity(beside_path(tracker, 0.0, yaw))
        assert (mode == "turn") == turning
    slewed = Slewed(tracker)
    for _ in range(60):
        (_, rate), _ = slewed.velocity(beside_path(tracker, 0.0, 2.0))
    assert rate == -DRIVE.max_yaw_rate_radps


@pytest.mark.parametrize(("off", "arrived"), [(0.069, True), (0.071, False)])
def test_it_has_arrived_a_margin_inside_the_tolerance(off, arrived):
    tracker = tracker_to((1.0, 0.0), 0.10)
    tracker.follow(smooth([(0, 0), (1.0, 0.0)], (0, 0, 0)), K)
    tracker.velocity(at_pose(1.0, off, 0.0))
    assert tracker.arrived == arrived


class PlainTracker:
    """The control law step by step, as the oracle of the kernel; ``path`` and ``profile`` given."""

    def __init__(self, path, profile):
        self.path, self.profile = path, profile
        self.at, self.turning, self.asked = 0, False, (0.0, 0.0)

    def velocity(self, pose):
        path = self.path
        near = path.arc_m - path.arc_m[self.at] <= 0.5
        near[: self.at] = False
        away = np.where(near, np.hypot(*(path.xy_m - pose[:2]).T), np.inf)
        self.at = i = int(np.argmin(away))
        last = len(away) - 1
        off = wrap_angle(pose[2] - path.yaw_rad[min(i + 1, last)])
        limit = CONFIG.end_turn_rad if self.turning else CONFIG.turn_on_spot_rad
        self.turning = abs(off) > limit
        if self.turning:
            return self.slew(0.0, -CONFIG.turn_gain_1ps * off)
        heading = np.array([math.cos(path.yaw_rad[i]), math.sin(path.yaw_rad[i])])
        offset = pose[:2] - path.xy_m[i]
        if i == last and heading @ offset > 0.0:
            return self.slew(0.0, 0.0)
        v = max(0.05, self.profile[i : i + 2].min())
        aside = heading[0] * offset[1] - heading[1] * offset[0]
        back = CONFIG.lateral_gain_1pm2 * aside * np.sinc(off / np.pi)
        back += CONFIG.heading_gain_1pm * off
        rate = v * (path.curvature_1pm[i] - back)
        return self.slew(v * max(0.0, math.cos(off)), rate)

    def slew(self, speed, rate):
        rate = np.clip(rate, -DRIVE.max_yaw_rate_radps, DRIVE.max_yaw_rate_radps)
        before, turned = self.asked
        faster = abs(speed) > abs(before)
        step = 0.01 * (DRIVE.max_accel_mps2 if faster else DRIVE.max_brake_mps2)
        turn = 0.01 * DRIVE.max_yaw_accel_radps2
        speed = before + np.clip(speed - before, -step, step)
        self.asked = (speed, turned + np.clip(rate - turned, -turn, turn))
        return self.asked


@pytest.mark.parametrize("seed", range(4))
def test_the_compiled_law_is_the_plain_one(seed):
    """Along a bent path and past its end, off it by decimetres and turned away now and then."""
    rng = np.random.default_rng(seed)
    tracker = tracker_to((99.0, 99.0))
    path = smooth([(0, 0), (1.0, 0.0), (1.2, 0.8), (2.0, 0.8)], (0, 0, 0))
    tracker.follow(path, K)
    plain, slewed = PlainTracker(path, tracker._samples[:, SPEED]), Slewed(tracker)
    modes = set()
    for t in range(800):
        i = min(t, 799) * (len(path.arc_m) + 5) // 800
        over = max(0, i - len(path.arc_m) + 1) * 0.02
        i = min(i, len(path.arc_m) - 1)
        pose = np.array([*path.xy_m[i], path.yaw_rad[i]]) + rng.normal(size=3) * [0.05, 0.05, 0.2]
        pose[0] += over
        pose[2] = wrap_angle(pose[2] + (2.5 if t % 200 > 170 else 0.0))
        state = np.array([*pose, 0.0, 0.0, 0.0, K])
        (speed, rate), mode = slewed.velocity(Estimate(t, state, np.eye(7)))
        assert (speed, rate) == pytest.approx(plain.velocity(pose), abs=1e-9)
        assert (mode == "turn") == plain.turning
        modes.add(mode)
    assert modes == {"turn", "follow"}
    assert plain.at == len(path.arc_m) - 1


class PlainMotorLoop:
    """One sprocket's loop step by step, as the oracle of the kernel."""

    def __init__(self):
        self.error, self.counts = 0.0, None

    def voltage(self, asked, counts):
        come = 0 if self.counts is None else counts - self.counts
        self.counts = counts
        if asked == 0.0:
            self.error = 0.0
            return 0.0
        limit = DRIVE.angle_error_limit_rad
        missing = asked * 0.01 - come * 2.0 * math.pi / ENCODER.counts_per_turn
        self.error = float(np.clip(self.error + missing, -limit, limit))
        volts = MOTOR.back_emf_v_per_radps * asked + DRIVE.angle_gain_v_per_rad * self.error
        volts += np.sign(asked) * MOTOR.resistance_ohm * MOTOR.no_load_current_a
        return float(np.clip(volts, -MOTOR.supply_v, MOTOR.supply_v))


@pytest.mark.parametrize("seed", range(4))
def test_the_compiled_motor_loops_are_the_plain_ones(seed):
    rng = np.random.default_rng(seed)
    drive, plain = drive_of(), [PlainMotorLoop() for _ in "lr"]
    counts = np.array([100, -50])
    for t in range(300):
        v, w = (0.0, 0.0) if t % 50 > 45 else rng.uniform([-0.5, -1.5], [0.5, 1.5])
        counts += rng.integers(-30, 30, 2)
        estimate = at_pose(0.0, 0.0, 0.0, 0.01 * t)
        command = drive.command(
            Velocity(v, w), Mode.FOLLOW, estimate, EncoderReading(t, *counts.tolist())
        )
        most = DRIVE.max_track_speed_mps
        belts = v + np.array([-0.5, 0.5]) * K * VEHICLE.gauge_m * w
        asked = belts / max(1.0, np.abs(belts).max() / most) / VEHICLE.sprocket_radius_m
        assert command.sprocket_radps == pytest.approx(asked, abs=1e-9)
        volts = [plain[k].voltage(float(asked[k]), int(counts[k])) for k in range(2)]
        assert command.voltage_v == pytest.approx(volts, abs=1e-9)


def test_the_profile_creeps_at_the_safe_distance_and_hurries_in_the_open():
    arc = np.arange(0.0, 6.0, 0.02)
    clearance = np.interp(arc, [0.0, 2.0, 3.0, 4.0], [0.5, 0.5, 0.2, 0.31])
    limits = np.array([0.45, 1.6, 0.4, 0.3, 0.1, 0.6, 0.2])
    speed = speed_profile(arc, 0 * arc, clearance, 0.26, limits)
    near = (arc < 5.5) & (arc > 0.1)
    room = np.clip((clearance - 0.26) / 0.1, 0.0, 1.0)
    # But for the braking before a narrow place, which must begin ahead of it.
    np.testing.assert_array_less(speed[near], 0.3 + 0.15 * room[near] + 1e-9)
    assert speed[arc < 1.5] == pytest.approx(0.45)
    assert speed[np.abs(arc - 3.0) < 0.1] == pytest.approx(0.3)
    assert speed[(arc > 4.1) & (arc < 5.5)] == pytest.approx(0.3 + 0.15 * 0.5)


def test_where_no_counts_come_a_belt_is_driven_by_its_motors_law_and_not_faster():
    """The same reading again and again, for half a second at full speed, then fresh ones."""
    plant, drive = plant_on_plane(), drive_of()
    truth, encoders, speeds = plant.reset(np.zeros(3)), Encoders(ENCODER), []
    heard = encoders.read(truth)
    for tick in range(400):
        fresh = encoders.read(truth)
        heard = heard if 150 <= tick < 200 else fresh
        speed = min(0.45, 0.008 * tick)
        command = drive.command(Velocity(speed, 0.0), Mode.FOLLOW, estimate_of(truth), heard)
        truth = plant.step(command.voltage_v)
        speeds.append(truth.velocity_body[0])
    assert max(speeds[150:]) < 0.47
    assert speeds[199] == pytest.approx(0.45, abs=0.03)
    assert speeds[-1] == pytest.approx(0.45, abs=0.01)


def test_at_the_goal_it_waits_for_a_pose_that_it_can_believe():
    tracker = tracker_to((1.0, 0.0))
    there = at_pose(1.0, 0.0, 0.0)
    for _ in range(3):
        velocity, mode = tracker.velocity(there, sure=False)
        assert (velocity, mode) == (Velocity(0.0, 0.0), Mode.STOP) and not tracker.arrived
        assert tracker.doubts_since_ns == there.t_ns
    tracker.velocity(at_pose(0.0, 0.0, 0.0), sure=False)
    assert tracker.doubts_since_ns is None  # it is elsewhere after all
    assert tracker.velocity(there)[1] is Mode.ARRIVED and tracker.arrived
    assert tracker.doubts_since_ns is None
