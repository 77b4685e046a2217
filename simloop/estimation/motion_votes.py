"""Compare the motion between two scans as LiDAR, wheels and IMU measured it, and find the outlier.

The three measurements are independent. When a LiDAR fix contradicts the belief, two sensors that
agree tell which one is wrong:

    LiDAR and wheels agree, gyro does not    the gyro's bias has jumped
    LiDAR and IMU agree, wheels do not       the belts slip, or something pushed the robot
    LiDAR agrees with neither                the scan was matched to the wrong place
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import between, wrap_angle
from simloop.messages import FloatArray

# Columns of an odometry history: 0-2 the odom pose, 3-5 the wheel odometry's pose, and these.
ACCEL_X, ACCEL_Y, GYRO, DT, SPEED, LATERAL_SPEED, BELTS_OK = range(6, 13)
COLUMNS = 13

_YAW_RAD = 0.004  # above what noise and quantisation make of a few tenths of a second
_XY_M = 0.02
_ACCEL_MPS2 = 0.15  # bias and tilt of the accelerometer, and the error of the believed speed


class Preintegrated(NamedTuple):
    """The motion that an IMU measured between two instants, in the body frame at the first.

    Attributes:
        yaw: Heading change, rad.
        velocity: (2,) m/s, the velocity that the accelerations added.
        position: (2,) m, the displacement that the accelerations added.
        duration: Time between the instants, s.
        by_bias: (5,) derivatives of yaw, velocity and position with respect to the gyro bias, so
            that another bias needs no second integration.
    """

    yaw: float
    velocity: FloatArray
    position: FloatArray
    duration: float
    by_bias: FloatArray


@njit(cache=True)
def preintegrate(rows: FloatArray, bias: float) -> Preintegrated:
    """Integrate IMU readings in the plane (Forster et al. 2017, Sec. VI, reduced to SE(2)).

    Args:
        rows: (n, 4) forward and lateral acceleration, m/s^2, yaw rate, rad/s, and period, s.
        bias: Gyro bias, rad/s, subtracted from the yaw rate.

    Returns:
        The motion over all rows, with its derivatives with respect to the bias.
    """
    yaw = duration = 0.0
    velocity, position, by_bias = np.zeros(2), np.zeros(2), np.zeros(5)
    for i in range(rows.shape[0]):
        ax, ay, rate, dt = rows[i, 0], rows[i, 1], rows[i, 2] - bias, rows[i, 3]
        # The heading in the middle of the period turns the acceleration into the first frame.
        cos, sin = math.cos(yaw + 0.5 * rate * dt), math.sin(yaw + 0.5 * rate * dt)
        a = np.array([cos * ax - sin * ay, sin * ax + cos * ay])
        # d(heading) / d(bias) there, and with it d(a) / d(bias).
        turning = by_bias[0] - 0.5 * dt
        a_by_bias = np.array([-a[1] * turning, a[0] * turning])
        # Position before velocity before yaw: each uses the others' values of the period's start.
        position += velocity * dt + 0.5 * a * dt * dt
        by_bias[3:] += by_bias[1:3] * dt + 0.5 * a_by_bias * dt * dt
        velocity += a * dt
        by_bias[1:3] += a_by_bias * dt
        by_bias[0] -= dt
        yaw += rate * dt
        duration += dt
    return Preintegrated(yaw, velocity, position, duration, by_bias)


class OdometryHistory:
    """The odometry and IMU readings of the last control periods, in order.

    The rows lie in one piece of memory, so that a span of them is a slice.

    Attributes:
        last_ns: Stamp of the last period; 0 before the first.
    """

    def __init__(self, least_rows: int) -> None:
        """Make an empty history that keeps at least ``least_rows`` periods."""
        self._room, self._end = least_rows, 0
        self.last_ns = 0
        self._t_ns = np.zeros(2 * least_rows, np.int64)
        self._rows = np.zeros((2 * least_rows, COLUMNS))

    def push(self, t_ns: int) -> FloatArray:
        """Add a period.

        Args:
            t_ns: Its stamp, later than the last one.

        Returns:
            Its row (13,), a view for the caller to fill in; see the columns above.
        """
        if self._end == len(self._t_ns):
            self._t_ns[: self._room] = self._t_ns[self._room :]
            self._rows[: self._room] = self._rows[self._room :]
            self._end = self._room
        row: FloatArray = self._rows[self._end]
        self._t_ns[self._end] = self.last_ns = t_ns
        self._end += 1
        return row

    def odom_poses(self, since_ns: int, until_ns: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the odom poses over a span of time, as copies.

        Args:
            since_ns: Start; the last period at or before it is included.
            until_ns: End, inclusive.

        Returns:
            Stamps (k,), rising, and odom_from_base (k, 3).
        """
        first = max(0, self._at(since_ns))
        last = max(first, self._at(until_ns))
        return self._t_ns[first : last + 1].copy(), self._rows[first : last + 1, :3].copy()

    def odom_motion(self, since_ns: int, until_ns: int) -> FloatArray:
        """Return how odom moved between two instants.

        Args:
            since_ns: The first instant.
            until_ns: The second instant.

        Returns:
            (3,) x, y, m, and yaw, rad, in base_link at the first instant.
        """
        first, last = max(0, self._at(since_ns)), max(0, self._at(until_ns))
        return between(self._rows[first, :3], self._rows[last, :3])

    def votes(self, since_ns: int, until_ns: int, bias: float) -> MotionVotes | None:
        """Return the motion between two instants as wheels and IMU measured it.

        Args:
            since_ns: The first instant.
            until_ns: The second instant.
            bias: Gyro bias at the first instant, rad/s.

        Returns:
            Both measurements; None if the history does not reach back to the first instant, or
            holds no period between the two.
        """
        first, last = self._at(since_ns), self._at(until_ns)
        if first < 0 or last <= first:
            return None
        rows = self._rows[first : last + 1]
        imu = preintegrate(np.ascontiguousarray(rows[1:, ACCEL_X : DT + 1]), bias)
        # An IMU measures changes of velocity only: the first velocity is the filter's.
        start = rows[0, [SPEED, LATERAL_SPEED]] * imu.duration
        wheels = between(rows[0, 3:6], rows[-1, 3:6]) if rows[1:, BELTS_OK].all() else None
        return MotionVotes(wheels, np.array([*(start + imu.position), imu.yaw]), imu.duration)

    def _at(self, t_ns: int) -> int:
        """The last row at or before an instant; -1: none."""
        return int(self._t_ns[: self._end].searchsorted(t_ns, side="right")) - 1


class Outlier(StrEnum):
    """The sensor that the two others contradict."""

    GYRO = "gyro"
    WHEELS = "wheels"
    LIDAR = "lidar"


class MotionVotes(NamedTuple):
    """One motion of the robot as wheels and IMU measured it, in base_link at its start.

    Attributes:
        wheels: (3,) x, y, m, and yaw, rad; None if a belt slipped or was not heard.
        imu: (3,) x, y, m, and yaw, rad.
        duration: s.
    """

    wheels: FloatArray | None
    imu: FloatArray
    duration: float

    def outlier(self, lidar: FloatArray) -> Outlier:
        """Return which of the three sensors the two others contradict.

        Args:
            lidar: (3,) x, y, m, and yaw, rad: the same motion as two LiDAR fixes give it.

        Returns:
            The sensor that is wrong. It is the LiDAR where it agrees with neither of the others.
        """
        off = abs(wrap_angle(lidar[2] - self.imu[2]))
        if off > _YAW_RAD:
            if self.wheels is None:
                return Outlier.LIDAR
            by_wheels = abs(wrap_angle(lidar[2] - self.wheels[2]))
            apart = math.dist(lidar[:2], self.wheels[:2])
            agree = by_wheels < 0.5 * off and apart < 2.0 * _XY_M
            return Outlier.GYRO if agree else Outlier.LIDAR
        # An acceleration's error grows into the position with half the squared time.
        slack = _XY_M + _ACCEL_MPS2 * self.duration * max(0.1, 0.5 * self.duration)
        agree = math.dist(lidar[:2], self.imu[:2]) < slack
        return Outlier.WHEELS if agree else Outlier.LIDAR
