"""How far the robot has come between two scans, as each of its senses tells it, and who is alone.

LiDAR, wheels, and gyro with accelerometer are three independent voices. Where a fix does not go
with the belief, two that agree say which of the three is wrong: a gyro whose bias has jumped, belts
that slip or a body that was pushed, or a scan that fits a place where the robot cannot be.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.geometry.se2 import between, wrap_angle
from simloop.messages import FloatArray

ACCEL_X, ACCEL_Y, GYRO, DT = 6, 7, 8, 9  # columns of a trail, after odom's and the wheels' poses
SPEED, ASIDE, BELTS = 10, 11, 12
_COLUMNS = 13
_YAW_RAD = 0.004  # more than noise and quantisation make of a few tenths of a second
_XY_M = 0.02
_ACCEL_MPS2 = 0.15  # what an accelerometer's bias, tilt and the belief's speed make together


class Preintegrated(NamedTuple):
    """What an IMU tells of the time between two instants, in the body's frame at the first.

    yaw, rad; velocity, m/s, and position, m, (2,), that its accelerations added; duration, s.
    by_bias: (5,) derivatives of yaw, velocity and position by the gyro's bias (Forster et al.
    2017, in the plane): another bias needs no second integration.
    """

    yaw: float
    velocity: FloatArray
    position: FloatArray
    duration: float
    by_bias: FloatArray


@njit(cache=True)
def preintegrate(rows: FloatArray, bias: float) -> Preintegrated:
    """rows: (n, 4) of a trail, acceleration ahead and aside, m/s^2, gyro, rad/s, and period, s."""
    yaw = duration = 0.0
    velocity, position, by_bias = np.zeros(2), np.zeros(2), np.zeros(5)
    for i in range(rows.shape[0]):
        ax, ay, rate, dt = rows[i, 0], rows[i, 1], rows[i, 2] - bias, rows[i, 3]
        cos, sin = math.cos(yaw + 0.5 * rate * dt), math.sin(yaw + 0.5 * rate * dt)
        a = np.array([cos * ax - sin * ay, sin * ax + cos * ay])
        turning = by_bias[0] - 0.5 * dt
        a_by_bias = np.array([-a[1] * turning, a[0] * turning])
        position += velocity * dt + 0.5 * a * dt * dt
        by_bias[3:] += by_bias[1:3] * dt + 0.5 * a_by_bias * dt * dt
        velocity += a * dt
        by_bias[1:3] += a_by_bias * dt
        by_bias[0] -= dt
        yaw += rate * dt
        duration += dt
    return Preintegrated(yaw, velocity, position, duration, by_bias)


class Trail:
    """The last periods, in order and in one piece: see the columns above; ``room`` at least."""

    def __init__(self, room: int) -> None:
        self._room, self._end = room, 0
        self.last_ns = 0  # the last period's instant; 0 before the first
        self._t_ns, self._rows = np.zeros(2 * room, np.int64), np.zeros((2 * room, _COLUMNS))

    def push(self, t_ns: int) -> FloatArray:
        """Add a period; its row (13,), to be filled in."""
        if self._end == len(self._t_ns):
            self._t_ns[: self._room] = self._t_ns[self._room :]
            self._rows[: self._room] = self._rows[self._room :]
            self._end = self._room
        row: FloatArray = self._rows[self._end]
        self._t_ns[self._end] = self.last_ns = t_ns
        self._end += 1
        return row

    def odom(self, since_ns: int, until_ns: int) -> tuple[np.ndarray, FloatArray]:
        """Instants (k,) and odom's poses (k, 3) from the last at or before ``since_ns`` on."""
        first = max(0, self._at(since_ns))
        last = max(first, self._at(until_ns))
        return self._t_ns[first : last + 1].copy(), self._rows[first : last + 1, :3].copy()

    def odom_between(self, since_ns: int, until_ns: int) -> FloatArray:
        """(3,) how odom moved from one instant to another."""
        first, last = max(0, self._at(since_ns)), max(0, self._at(until_ns))
        return between(self._rows[first, :3], self._rows[last, :3])

    def voices(self, since_ns: int, until_ns: int, bias: float) -> Voices | None:
        """What wheels and IMU say of the motion between two instants; None: it is forgotten."""
        first, last = self._at(since_ns), self._at(until_ns)
        if first < 0 or last <= first:
            return None
        rows = self._rows[first : last + 1]
        imu = preintegrate(np.ascontiguousarray(rows[1:, ACCEL_X : DT + 1]), bias)
        start = rows[0, [SPEED, ASIDE]] * imu.duration
        wheels = between(rows[0, 3:6], rows[-1, 3:6]) if rows[1:, BELTS].all() else None
        felt = np.array([*(start + imu.position), imu.yaw])
        return Voices(wheels, felt, imu.duration)

    def _at(self, t_ns: int) -> int:
        """The last row at or before an instant; -1: none."""
        return int(self._t_ns[: self._end].searchsorted(t_ns, side="right")) - 1


class Voices(NamedTuple):
    """(3,) m, m, rad that wheels (None: not to be heard) and IMU tell, and over how long, s."""

    wheels: FloatArray | None
    imu: FloatArray
    duration: float

    def against(self, lidar: FloatArray) -> str:
        """Who is alone, if the LiDAR says (3,): ``gyro``, ``wheels``, or ``lidar``."""
        off = abs(wrap_angle(lidar[2] - self.imu[2]))
        if off > _YAW_RAD:
            if self.wheels is None:
                return "lidar"
            by_wheels = abs(wrap_angle(lidar[2] - self.wheels[2]))
            apart = math.dist(lidar[:2], self.wheels[:2])
            return "gyro" if by_wheels < 0.5 * off and apart < 2.0 * _XY_M else "lidar"
        slack = _XY_M + _ACCEL_MPS2 * self.duration * max(0.1, 0.5 * self.duration)
        return "wheels" if math.dist(lidar[:2], self.imu[:2]) < slack else "lidar"
