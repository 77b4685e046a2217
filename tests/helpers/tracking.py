"""A tracker and estimates for tests of control."""

from __future__ import annotations

import numpy as np

from simloop.config import EncoderConfig, MotorConfig, TrackerConfig, VehicleConfig
from simloop.ekf import GAUGE
from simloop.messages import Estimate
from simloop.tracker import Tracker

CONFIG, VEHICLE, MOTOR, ENCODER = TrackerConfig(), VehicleConfig(), MotorConfig(), EncoderConfig()
K = 1.0 / 0.811


def estimate_of(truth, t_ns=None) -> Estimate:
    state = np.zeros(7)
    state[:3] = truth.pose_xyyaw
    state[3], state[4], state[GAUGE] = truth.velocity_body[0], truth.velocity_body[5], K
    return Estimate(truth.t_ns if t_ns is None else t_ns, state, np.eye(7) * 1e-6)


def tracker_to(goal, tolerance=0.10):
    return Tracker(CONFIG, VEHICLE, 0.26, np.array(goal, float), tolerance, 0.01)


def at_pose(x, y, yaw, t_s=0.0):
    state = np.zeros(7)
    state[:3], state[GAUGE] = (x, y, yaw), K
    return Estimate(round(t_s * 1e9), state, np.eye(7))
