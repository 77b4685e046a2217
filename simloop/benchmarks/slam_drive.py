"""A drive along a course by a driver that knows the true pose, with the sensor data of the drive.

Plant, encoders, gyro and swept laser are the same as in every run. The driver follows the route by
the true pose, so the drive does not depend on the mapper.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simloop.benchmarks.slam_courses import Course
from simloop.config import Config
from simloop.geometry.se2 import wrap_angle
from simloop.messages import EncoderReading, FloatArray, LidarScan
from simloop.physics.plant import Plant
from simloop.sensors import Encoders, Imu, Lidar
from simloop.truth import Truth
from simloop.worlds.arena import build
from simloop.worlds.cross_section import floor_plan
from simloop.worlds.floor_plan import FloorPlan

_SPEED_MPS, _MOST_RATE_RADPS = 0.4, 0.8
_LOOKAHEAD_M, _NEAR_M = 0.5, 0.25
# Tracks slip when turning, so they need a larger difference of speed than wheels.
_GAUGE_RATIO = 1.25
_HEADING_GAIN_1PS = 2.5
_STOP_OFF_RAD = 0.7  # heading error above which the driver turns on the spot
_SPIN_GAIN = 3.0  # V per rad/s
_LIMIT_S = 1800.0
_STILL_S = 1.0  # time at rest at the start, to estimate the gyro's bias


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The data of one drive.

    Attributes:
        scans: The LiDAR's scans.
        trails: For each scan the odometry over its sweep: t_ns (k,), poses x, y, yaw (k, 3), m and
            rad, odometry frame.
        truth: (n, 3) true x, y, yaw at the end of each scan, m and rad, map frame.
        laser: (3,) mounting pose of the laser in base_link, m and rad.
        floor: The true floor plan.
        done: Whether the drive reached the end of the route.
    """

    scans: list[LidarScan]
    trails: list[tuple[np.ndarray, FloatArray]]
    truth: FloatArray
    laser: FloatArray
    floor: FloorPlan
    done: bool


def drive(course: Course, seed: int) -> Drive:
    """Drive a course from the first corner of its route to the last.

    Args:
        course: The course.
        seed: Seed of the sensors' noise.

    Returns:
        The data of the drive; it ends early after `_LIMIT_S` or at a contact.
    """
    config = Config()
    config = replace(config, tracks=replace(config.tracks, zones=course.zones))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{course.name}.xml"
        path.write_text(course.to_mjcf(), encoding="utf-8")
        model = build(path, (), config.rates.physics_s)
    floor, plant = floor_plan(model), Plant(model, config)
    imu_rng, lidar_rng = np.random.default_rng(seed).spawn(2)
    imu = Imu(config.imu, config.rates.control_s, imu_rng)
    lidar = Lidar(config.lidar, config.rates.lidar_s, plant.base_from_laser, lidar_rng)
    encoders, odometry = Encoders(config.encoder), _GyroOdometry(config)
    first = course.route_m[1] - course.route_m[0]
    start = np.array([*course.route_m[0], math.atan2(first[1], first[0])])
    truth, driver = plant.reset(start), _Driver(course.route_m, config)
    scans: list[LidarScan] = []
    trails, truths = [], []
    while not driver.done and truth.t_ns < _LIMIT_S * 1e9 and not truth.contact_count:
        before, truth = truth, plant.step(driver.voltage(truth))
        odometry.advance(encoders.read(truth), imu.read(truth).gyro_radps[2])
        scan = lidar.sweep(before, truth, plant)
        if scan is not None:
            scans.append(scan)
            trails.append(odometry.trail(scan))
            truths.append(truth.pose_xyyaw)
    laser = np.array([*plant.base_from_laser[:2], 0.0])
    return Drive(scans, trails, np.array(truths), laser, floor, driver.done)


class _Driver:
    """Pure pursuit of the route's straight segments (Coulter 1992), by the true pose."""

    def __init__(self, route: FloatArray, config: Config) -> None:
        self._route, self._next, self._config = route, 1, config
        self.done = False

    def voltage(self, truth: Truth) -> FloatArray:
        """Compute the voltages for one control period.

        Args:
            truth: The true state of the robot.

        Returns:
            (2,) voltages of the left and the right motor, V.
        """
        if truth.t_ns < _STILL_S * 1e9:
            return np.zeros(2)
        pose = truth.pose_xyyaw
        while math.dist(pose[:2], self._route[self._next]) < _NEAR_M:
            if self._next + 1 == len(self._route):
                self.done = True
                return np.zeros(2)
            self._next += 1
        target = self._target(pose)
        off = wrap_angle(math.atan2(target[1] - pose[1], target[0] - pose[0]) - pose[2])
        rate = float(np.clip(_HEADING_GAIN_1PS * off, -_MOST_RATE_RADPS, _MOST_RATE_RADPS))
        speed = _SPEED_MPS * max(0.0, 1.0 - abs(off) / _STOP_OFF_RAD)
        half = 0.5 * self._config.vehicle.gauge_m * _GAUGE_RATIO * rate
        radius, motor = self._config.vehicle.sprocket_radius_m, self._config.motor
        spin = np.array([speed - half, speed + half]) / radius
        # Feedforward of the back EMF plus a proportional speed loop.
        error = spin - truth.sprocket_radps
        volts = motor.back_emf_v_per_radps * spin + _SPIN_GAIN * error
        return np.clip(volts, -motor.supply_v, motor.supply_v)

    def _target(self, pose: FloatArray) -> FloatArray:
        """Find the point (2,), m, one look-ahead distance on, on the segment to the next corner."""
        a, b = self._route[self._next - 1], self._route[self._next]
        along = (b - a) / math.dist(a, b)
        at = float(np.clip((pose[:2] - a) @ along + _LOOKAHEAD_M, 0.0, math.dist(a, b)))
        return np.asarray(a + at * along)


class _GyroOdometry:
    """Dead reckoning: distance from the tracks, turn from the gyro, bias from the time at rest."""

    def __init__(self, config: Config) -> None:
        turn_m = 2.0 * math.pi * config.vehicle.sprocket_radius_m
        self._per_count_m = turn_m / config.encoder.counts_per_turn
        self._period_s = config.rates.control_s
        self._pose = np.zeros(3)
        self._last: EncoderReading | None = None
        self._still: list[float] = []
        self._t_ns: list[int] = []
        self._poses: list[FloatArray] = []

    def advance(self, reading: EncoderReading, rate_radps: float) -> None:
        """Integrate one control period.

        Args:
            reading: The encoders' counts at the end of the period.
            rate_radps: The gyro's yaw rate, rad/s.
        """
        last, self._last = self._last or reading, reading
        if reading.t_ns <= _STILL_S * 1e9:
            self._still.append(rate_radps)
        turn = (rate_radps - float(np.mean(self._still))) * self._period_s
        ahead = reading.left_counts + reading.right_counts - last.left_counts - last.right_counts
        x, y, yaw = self._pose
        step, middle = 0.5 * ahead * self._per_count_m, yaw + 0.5 * turn
        self._pose = np.array(
            [x + step * math.cos(middle), y + step * math.sin(middle), wrap_angle(yaw + turn)]
        )
        self._t_ns.append(reading.t_ns)
        self._poses.append(self._pose)

    def trail(self, scan: LidarScan) -> tuple[np.ndarray, FloatArray]:
        """Return the poses over a scan's sweep, and drop older ones.

        Args:
            scan: The scan; its sweep ends now.

        Returns:
            Times (k,), ns, and poses x, y, yaw (k, 3), m and rad, odometry frame.
        """
        first = max(0, len(self._t_ns) - 2 - int(scan.age_ns.max() * 1e-9 / self._period_s))
        times, poses = np.array(self._t_ns[first:], np.int64), np.array(self._poses[first:])
        self._t_ns, self._poses = self._t_ns[first:], self._poses[first:]
        return times, poses
