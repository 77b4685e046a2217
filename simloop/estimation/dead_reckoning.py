"""Compute two odometry paths by dead reckoning. No LiDAR fix moves them: they are smooth (REP-105).

``odom_from_base`` integrates the filter's speeds, to which wheels, gyro and LiDAR all contribute.
``odom_from_base_by_wheels`` integrates the encoder counts only, with the centres of rotation that
the filter has estimated. It shows how accurate the tracks alone are. It is also one of the
measurements that ``motion_votes`` compares.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import EncoderConfig, VehicleConfig
from simloop.estimation.ekf_model import GAUGE, ICR_X, OFFSET, RATE, SPEED
from simloop.geometry.se2 import compose_xyt, inverse_xyt, wrap_angle
from simloop.messages import EncoderReading, Estimate, FloatArray, Frames


@njit(cache=True)
def move(pose: FloatArray, forward: float, lateral: float, turned: float) -> None:
    """Move a pose along an arc, in place.

    Args:
        pose: (3,) x, y, yaw, m and rad.
        forward: Distance along the pose's own x, m.
        lateral: Distance along the pose's own y, m.
        turned: Turn along the arc, rad.
    """
    middle = pose[2] + 0.5 * turned
    cos, sin = math.cos(middle), math.sin(middle)
    pose[0] += forward * cos - lateral * sin
    pose[1] += forward * sin + lateral * cos
    pose[2] = wrap_angle(pose[2] + turned)


@njit(cache=True)
def belt_motion(left: float, right: float, state: FloatArray, gauge: float) -> FloatArray:
    """Compute the body's motion from the motion of its belts (Martinez & Mandow 2005).

    Args:
        left: Distance that the left belt moved, m.
        right: Distance that the right belt moved, m.
        state: (9,) state of the filter, with the centres of rotation; see ``ekf_model``.
        gauge: Nominal distance of the tracks, m.

    Returns:
        (3,) forward, m, lateral, m, and turn, rad.
    """
    width = gauge * state[GAUGE]
    y_left = state[OFFSET] + 0.5 * width
    turned = (right - left) / width
    return np.array([left + y_left * turned, -state[ICR_X] * turned, turned])


@njit(cache=True)
def advance_paths(
    odom: FloatArray,
    wheels: FloatArray,
    state: FloatArray,
    dt: float,
    left: float,
    right: float,
    gauge: float,
) -> None:
    """Advance both paths by one period, in place.

    Args:
        odom: (3,) x, y, yaw, moved by the filter's speeds.
        wheels: (3,) x, y, yaw, moved by the belts.
        state: (9,) state of the filter.
        dt: The period, s.
        left: Distance that the left belt moved in the period, m.
        right: Distance that the right belt moved in the period, m.
        gauge: Nominal distance of the tracks, m.
    """
    turned = state[RATE] * dt
    move(odom, state[SPEED] * dt, -state[ICR_X] * turned, turned)
    forward, lateral, turned = belt_motion(left, right, state, gauge)
    move(wheels, forward, lateral, turned)


@njit(cache=True)
def transforms(odom: FloatArray, wheels: FloatArray, pose: FloatArray) -> FloatArray:
    """Compute the transforms between the frames.

    Args:
        odom: (3,) odom_from_base.
        wheels: (3,) odom_from_base by the wheels alone.
        pose: (3,) or longer, estimated map_from_base.

    Returns:
        (3, 3) rows: odom_from_base, map_from_odom, odom_from_base by the wheels; each x, y, yaw.
    """
    out = np.empty((3, 3))
    bx, by, byaw = inverse_xyt(odom[0], odom[1], odom[2])
    x, y, yaw = compose_xyt(pose[0], pose[1], pose[2], bx, by, byaw)
    out[0], out[2] = odom, wheels
    out[1, 0], out[1, 1], out[1, 2] = x, y, yaw
    return out


class DeadReckoning:
    """Integrator of both odometry paths, which start at zero.

    Attributes:
        odom_from_base: (3,) x, y, yaw by the filter's speeds, m and rad.
        by_wheels: (3,) x, y, yaw by the encoders alone, m and rad.
    """

    def __init__(self, vehicle: VehicleConfig, encoder: EncoderConfig) -> None:
        """Start at zero.

        Args:
            vehicle: Gauge and sprocket radius.
            encoder: Counts per turn.
        """
        self._gauge = vehicle.gauge_m
        self._metres_a_count = 2.0 * math.pi * vehicle.sprocket_radius_m / encoder.counts_per_turn
        self.odom_from_base, self.by_wheels = np.zeros(3), np.zeros(3)
        self._last: EncoderReading | None = None
        self._t_ns = -1

    def advance(self, encoders: EncoderReading, estimate: Estimate) -> None:
        """Advance both paths to the time of an estimate.

        Args:
            encoders: The last counts. If they are not new, the wheels' path does not move.
            estimate: The filter's present estimate.
        """
        last, left, right = self._last or encoders, 0.0, 0.0
        if encoders.t_ns >= last.t_ns:
            left = (encoders.left_counts - last.left_counts) * self._metres_a_count
            right = (encoders.right_counts - last.right_counts) * self._metres_a_count
            self._last = encoders
        dt = (estimate.t_ns - self._t_ns) * 1e-9 if self._t_ns >= 0 else 0.0
        self._t_ns = estimate.t_ns
        advance_paths(
            self.odom_from_base, self.by_wheels, estimate.state, dt, left, right, self._gauge
        )

    def frames(self, estimate: Estimate) -> Frames:
        """Return the transforms now.

        Args:
            estimate: The estimate with the pose of base_link in map.

        Returns:
            Both paths, and map_from_odom.
        """
        odom, map_from_odom, wheels = transforms(
            self.odom_from_base, self.by_wheels, estimate.state
        )
        return Frames(estimate.t_ns, odom, map_from_odom, wheels)
