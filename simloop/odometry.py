"""Dead reckoning from the tracks alone, and planar poses by the hundred, for drawings.

The robot does not use this: its filter takes the encoders' counts itself. It shows what they
would be worth alone, and gives REP-105's odom frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.config import VehicleConfig
from simloop.messages import EncoderReading, FloatArray
from simloop.se2 import wrap_angles

_COUNTS_PER_TURN = 980


@dataclass(frozen=True, slots=True, eq=False)
class OdometryPiece:
    """odom_from_base (N, 3) at times t_ns (N,), ascending."""

    t_ns: NDArray[np.int64]
    poses: FloatArray

    def at(self, t_ns: Sequence[int]) -> FloatArray:
        """(M, 3) the last poses at or before the given times, or the first there is."""
        index = np.searchsorted(self.t_ns, np.asarray(t_ns, np.int64), side="right") - 1
        return self.poses[np.maximum(index, 0)]


class Odometry:
    """Adds up what the sprockets turned, as if nothing ever slipped. start: (3,) in map."""

    def __init__(
        self, start: FloatArray, vehicle: VehicleConfig, counts_per_turn: int = _COUNTS_PER_TURN
    ) -> None:
        self.start = start
        self._per_count_m = 2.0 * math.pi * vehicle.sprocket_radius_m / counts_per_turn
        self._gauge_m = vehicle.gauge_m
        self._last: tuple[int, int, int, FloatArray] | None = None

    def advance(self, readings: Sequence[EncoderReading]) -> OdometryPiece:
        """Poses from the last reading that was known before to the last of these."""
        if self._last is None:
            first = readings[0] if readings else EncoderReading(0, 0, 0)
            self._last = (first.t_ns, first.left_counts, first.right_counts, np.zeros(3))
        t_ns, left, right, pose = self._last
        times = np.array([t_ns, *(r.t_ns for r in readings)], np.int64)
        counts = np.array([(left, right), *((r.left_counts, r.right_counts) for r in readings)])
        moved = np.diff(counts, axis=0) * self._per_count_m
        ahead, turned = moved.mean(axis=1), (moved[:, 1] - moved[:, 0]) / self._gauge_m
        yaw = pose[2] + np.concatenate([[0.0], np.cumsum(turned)])
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        x = pose[0] + np.concatenate([[0.0], np.cumsum(ahead * np.cos(middle))])
        y = pose[1] + np.concatenate([[0.0], np.cumsum(ahead * np.sin(middle))])
        poses = np.stack([x, y, yaw], axis=1)
        self._last = (int(times[-1]), int(counts[-1, 0]), int(counts[-1, 1]), poses[-1])
        return OdometryPiece(times, poses)


def compose_all(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """a_from_c, (N, 3), of poses (N, 3) or (3,), yaw wrapped."""
    cos, sin = np.cos(a_from_b[..., 2]), np.sin(a_from_b[..., 2])
    x, y = b_from_c[..., 0], b_from_c[..., 1]
    yaw = wrap_angles(a_from_b[..., 2] + b_from_c[..., 2])
    return np.stack(
        [a_from_b[..., 0] + cos * x - sin * y, a_from_b[..., 1] + sin * x + cos * y, yaw], axis=-1
    )


def inverse_all(a_from_b: FloatArray) -> FloatArray:
    """b_from_a, (N, 3), of poses (N, 3)."""
    cos, sin = np.cos(a_from_b[..., 2]), np.sin(a_from_b[..., 2])
    x, y = a_from_b[..., 0], a_from_b[..., 1]
    return np.stack([-cos * x - sin * y, sin * x - cos * y, -a_from_b[..., 2]], axis=-1)
