"""Dead reckoning, smooth as REP-105 wants odom to be, and planar poses by the hundred.

Two paths are reckoned side by side. ``odom_from_base`` adds up the filter's speeds, which wheels,
gyro and LiDAR all have their part in; no fix ever moves it. ``odom_from_base_by_wheels`` adds up
what the encoders counted and nothing else, with the centres of rotation that the filter has learnt:
it shows what the tracks alone are worth, and is one of the voices when the others disagree.
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
def moved(pose: FloatArray, ahead: float, aside: float, turned: float) -> None:
    """Move ``pose`` (3,), in place, by m and rad in its own frame, along an arc."""
    middle = pose[2] + 0.5 * turned
    cos, sin = math.cos(middle), math.sin(middle)
    pose[0] += ahead * cos - aside * sin
    pose[1] += ahead * sin + aside * cos
    pose[2] = wrap_angle(pose[2] + turned)


@njit(cache=True)
def by_belts(left: float, right: float, state: FloatArray, gauge: float) -> FloatArray:
    """(3,) m ahead, m aside and rad turned of a robot whose belts have come so far, m.

    Martinez & Mandow 2005, with the centres of rotation of a filter's ``state`` (9,).
    """
    width = gauge * state[GAUGE]
    y_left = state[OFFSET] + 0.5 * width
    turned = (right - left) / width
    return np.array([left + y_left * turned, -state[ICR_X] * turned, turned])


@njit(cache=True)
def reckon(
    odom: FloatArray,
    wheels: FloatArray,
    state: FloatArray,
    dt: float,
    left: float,
    right: float,
    gauge: float,
) -> None:
    """Carry both paths, (3,) each, one period dt, s, on; left, right: m of belt in it."""
    turned = state[RATE] * dt
    moved(odom, state[SPEED] * dt, -state[ICR_X] * turned, turned)
    ahead, aside, turned = by_belts(left, right, state, gauge)
    moved(wheels, ahead, aside, turned)


@njit(cache=True)
def frames_now(odom: FloatArray, wheels: FloatArray, pose: FloatArray) -> FloatArray:
    """(3, 3) odom_from_base, map_from_odom of a belief ``pose`` (3,), and the wheels' path."""
    out = np.empty((3, 3))
    bx, by, byaw = inverse_xyt(odom[0], odom[1], odom[2])
    x, y, yaw = compose_xyt(pose[0], pose[1], pose[2], bx, by, byaw)
    out[0], out[2] = odom, wheels
    out[1, 0], out[1, 1], out[1, 2] = x, y, yaw
    return out


class DeadReckoning:
    """Both paths, from zero on."""

    def __init__(self, vehicle: VehicleConfig, encoder: EncoderConfig) -> None:
        self._gauge = vehicle.gauge_m
        self._metres_a_count = 2.0 * math.pi * vehicle.sprocket_radius_m / encoder.counts_per_turn
        self.odom_from_base, self.by_wheels = np.zeros(3), np.zeros(3)
        self._last: EncoderReading | None = None
        self._t_ns = -1

    def advance(self, encoders: EncoderReading, estimate: Estimate) -> None:
        """Go on to the estimate's instant; counts that are not new move nothing."""
        last, left, right = self._last or encoders, 0.0, 0.0
        if encoders.t_ns >= last.t_ns:
            left = (encoders.left_counts - last.left_counts) * self._metres_a_count
            right = (encoders.right_counts - last.right_counts) * self._metres_a_count
            self._last = encoders
        dt = (estimate.t_ns - self._t_ns) * 1e-9 if self._t_ns >= 0 else 0.0
        self._t_ns = estimate.t_ns
        reckon(self.odom_from_base, self.by_wheels, estimate.state, dt, left, right, self._gauge)

    def frames(self, estimate: Estimate) -> Frames:
        """The transforms now, of the belief that ``estimate`` is."""
        odom, map_from_odom, wheels = frames_now(
            self.odom_from_base, self.by_wheels, estimate.state
        )
        return Frames(estimate.t_ns, odom, map_from_odom, wheels)
