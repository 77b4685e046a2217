"""A tracker and estimates for tests of control."""

from __future__ import annotations

import numpy as np

from simloop.config import (
    DriveConfig,
    EncoderConfig,
    MonitorConfig,
    MotorConfig,
    RecoveryConfig,
    SeparationConfig,
    TrackerConfig,
    VehicleConfig,
)
from simloop.control.arbiter import STILL, Situation, VelocityArbiter
from simloop.control.collision_monitor import CollisionMonitor, stoppable_part, stopping_limits
from simloop.control.drive import Drive
from simloop.control.separation import Separation
from simloop.ekf import GAUGE
from simloop.messages import Estimate, Mode
from simloop.tracker import Tracker

CONFIG, DRIVE, MONITOR = TrackerConfig(), DriveConfig(), MonitorConfig()
VEHICLE, MOTOR, ENCODER = VehicleConfig(), MotorConfig(), EncoderConfig()
PERIOD_S = 0.01
K = 1.0 / 0.811


def estimate_of(truth, t_ns=None) -> Estimate:
    state = np.zeros(7)
    state[:3] = truth.pose_xyyaw
    state[3], state[4], state[GAUGE] = truth.velocity_body[0], truth.velocity_body[5], K
    return Estimate(truth.t_ns if t_ns is None else t_ns, state, np.eye(7) * 1e-6)


def tracker_to(goal, tolerance=0.10, has_camera=False):
    return Tracker(CONFIG, DRIVE, VEHICLE, 0.26, np.array(goal, float), tolerance, has_camera)


def at_pose(x, y, yaw, t_s=0.0):
    state = np.zeros(7)
    state[:3], state[GAUGE] = (x, y, yaw), K
    return Estimate(round(t_s * 1e9), state, np.eye(7))


def drive_of(drive=DRIVE):
    return Drive(drive, MOTOR, ENCODER, VEHICLE, PERIOD_S)


def monitor_of(monitor=MONITOR, drive=DRIVE):
    return CollisionMonitor(monitor, drive, VEHICLE)


def allowed(monitor, speed, rate, pose):
    """The part of a velocity from which a robot at ``pose`` (3,) can stop."""
    part = stoppable_part(monitor.points_at(pose), speed, rate, monitor.limits)
    return part * speed, part * rate


def separation_of(separation=None):
    return Separation(separation or SeparationConfig(), MONITOR, DRIVE, VEHICLE)


def arbiter_of(drive=DRIVE, separation=None):
    limits = stopping_limits(MONITOR, drive, VEHICLE)
    return VelocityArbiter(drive, RecoveryConfig(), separation_of(separation), limits, PERIOD_S)


def situation(pose=(0.0, 0.0, 0.0), points=(), t_ns=0, **others):
    """What the arbiter knows; points: (n, 2) in base_link."""
    near = np.array(points, float).reshape(-1, 2)
    others = {"movers": None, "doing": Mode.FOLLOW, **others}
    return Situation(t_ns, np.array(pose, float), near, **others)


class Slewed:
    """A tracker behind an arbiter that sees nothing: its velocity keeps the limits."""

    def __init__(self, tracker):
        self.tracker, self.arbiter, self.last = tracker, arbiter_of(), STILL

    def velocity(self, estimate):
        asked, doing = self.tracker.velocity(estimate)
        now = situation(estimate.pose, t_ns=estimate.t_ns, doing=doing)
        self.last, mode = self.arbiter.choose(asked, self.last, now)
        return self.last, mode
