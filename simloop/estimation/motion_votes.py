"""Find which of LiDAR, wheels and IMU measured a wrong motion between two scans.

The three measurements are independent. When a LiDAR fix contradicts the belief, two sensors that
agree show which one is wrong:

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

# Columns of an odometry history: 0-2 pose in odom, 3-5 pose by the wheels, then the following.
ACCEL_X, ACCEL_Y, GYRO, DT, SPEED, LATERAL_SPEED, BELTS_OK = range(6, 13)
COLUMNS = 13

_YAW_RAD = 0.004  # largest yaw error from noise and quantisation in a few tenths of a second
_XY_M = 0.02  # tolerance of the position
_GRAVITY_MPS2 = 9.81
_ACCEL_MPS2 = 0.15  # covers bias and tilt of the accelerometer and the filter's speed error


class Preintegrated(NamedTuple):
    """Motion that an IMU measured between two times, in the body frame at the first time.

    Attributes:
        yaw: Heading change, rad.
        velocity: (2,) velocity that the accelerations added, m/s.
        position: (2,) displacement that the accelerations added, m.
        duration: Time difference, s.
        by_bias: (5,) derivatives of yaw, velocity and position with respect to the gyro bias. With
            them, another bias needs no second integration.
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
        The motion over all rows, and its derivatives with respect to the bias.
    """
    yaw = duration = 0.0
    velocity, position, by_bias = np.zeros(2), np.zeros(2), np.zeros(5)
    for i in range(rows.shape[0]):
        ax, ay, rate, dt = rows[i, 0], rows[i, 1], rows[i, 2] - bias, rows[i, 3]
        # The heading in the middle of the period turns the acceleration into the first frame.
        cos, sin = math.cos(yaw + 0.5 * rate * dt), math.sin(yaw + 0.5 * rate * dt)
        a = np.array([cos * ax - sin * ay, sin * ax + cos * ay])
        # d(heading) / d(bias) in the middle of the period, and from it d(a) / d(bias).
        turning = by_bias[0] - 0.5 * dt
        a_by_bias = np.array([-a[1] * turning, a[0] * turning])
        # Update position, then velocity, then yaw: each needs the others' values at the start.
        position += velocity * dt + 0.5 * a * dt * dt
        by_bias[3:] += by_bias[1:3] * dt + 0.5 * a_by_bias * dt * dt
        velocity += a * dt
        by_bias[1:3] += a_by_bias * dt
        by_bias[0] -= dt
        yaw += rate * dt
        duration += dt
    return Preintegrated(yaw, velocity, position, duration, by_bias)


class OdometryHistory:
    """Odometry and IMU readings of the last control periods, in order.

    The rows lie in one array, so that a span of them is a slice.

    Attributes:
        last_ns: Stamp of the last period, ns; 0 before the first.
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
            t_ns: Stamp of the period, ns, later than the last one.

        Returns:
            The period's row (13,), a view that the caller fills; see the columns above.
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
        """Return copies of the odom poses in a span of time.

        Args:
            since_ns: Start, ns; the last period at or before it is included.
            until_ns: End, ns, inclusive.

        Returns:
            Stamps (k,), ns, rising, and odom_from_base (k, 3).
        """
        first = max(0, self._at(since_ns))
        last = max(first, self._at(until_ns))
        return self._t_ns[first : last + 1].copy(), self._rows[first : last + 1, :3].copy()

    def odom_motion(self, since_ns: int, until_ns: int) -> FloatArray:
        """Compute the motion between two times by the odom path.

        Args:
            since_ns: First time, ns.
            until_ns: Second time, ns.

        Returns:
            (3,) x, y, m, and yaw, rad, in base_link at the first time.
        """
        first, last = max(0, self._at(since_ns)), max(0, self._at(until_ns))
        return between(self._rows[first, :3], self._rows[last, :3])

    def votes(self, since_ns: int, until_ns: int, bias: float) -> MotionVotes | None:
        """Compute the motion between two times as wheels and IMU measured it.

        Args:
            since_ns: First time, ns.
            until_ns: Second time, ns.
            bias: Gyro bias at the first time, rad/s.

        Returns:
            Both measurements; None if the history does not reach back to the first time, or holds
            no period between the two.
        """
        first, last = self._at(since_ns), self._at(until_ns)
        if first < 0 or last <= first:
            return None
        rows = self._rows[first : last + 1]
        imu = preintegrate(np.ascontiguousarray(rows[1:, ACCEL_X : DT + 1]), bias)
        # An IMU measures only changes of velocity, so the first velocity comes from the filter.
        start = rows[0, [SPEED, LATERAL_SPEED]] * imu.duration
        wheels = between(rows[0, 3:6], rows[-1, 3:6]) if rows[1:, BELTS_OK].all() else None
        return MotionVotes(wheels, np.array([*(start + imu.position), imu.yaw]), imu.duration)

    def tilt(self, since_ns: int, until_ns: int) -> float:
        """Estimate how far the ground tilts the robot, by the mean acceleration it does not drive.

        Args:
            since_ns: Start of the mean, ns.
            until_ns: Its end, ns.

        Returns:
            Angle, rad, for small angles; 0 before there are two periods.
        """
        rows = self._rows[max(0, self._at(since_ns)) : self._at(until_ns) + 1]
        if len(rows) < 2:
            return 0.0
        driven = (rows[-1, SPEED] - rows[0, SPEED]) / max(1e-9, rows[1:, DT].sum())
        forward = rows[1:, ACCEL_X].mean() - driven
        lateral = (rows[1:, ACCEL_Y] - rows[1:, SPEED] * rows[1:, GYRO]).mean()
        return math.hypot(forward, lateral) / _GRAVITY_MPS2

    def _at(self, t_ns: int) -> int:
        """Return the last row at or before a time, or -1 if there is none."""
        return int(self._t_ns[: self._end].searchsorted(t_ns, side="right")) - 1


class Outlier(StrEnum):
    """Sensor that the two others contradict."""

    GYRO = "gyro"
    WHEELS = "wheels"
    LIDAR = "lidar"


class MotionVotes(NamedTuple):
    """One motion of the robot as wheels and IMU measured it, in base_link at its start.

    Attributes:
        wheels: (3,) x, y, m, and yaw, rad; None if a belt slipped or was ignored.
        imu: (3,) x, y, m, and yaw, rad.
        duration: Duration of the motion, s.
    """

    wheels: FloatArray | None
    imu: FloatArray
    duration: float

    def outlier(self, lidar: FloatArray) -> Outlier:
        """Return which of the three sensors the two others contradict.

        Args:
            lidar: (3,) x, y, m, and yaw, rad: the same motion between two LiDAR fixes.

        Returns:
            The sensor that is wrong. If all three disagree, this is the LiDAR.
        """
        off = abs(wrap_angle(lidar[2] - self.imu[2]))
        if off > _YAW_RAD:
            if self.wheels is None:
                return Outlier.LIDAR
            by_wheels = abs(wrap_angle(lidar[2] - self.wheels[2]))
            apart = math.dist(lidar[:2], self.wheels[:2])
            agree = by_wheels < 0.5 * off and apart < 2.0 * _XY_M
            return Outlier.GYRO if agree else Outlier.LIDAR
        # A constant acceleration error makes a position error of half of it times time squared.
        slack = _XY_M + _ACCEL_MPS2 * self.duration * max(0.1, 0.5 * self.duration)
        agree = math.dist(lidar[:2], self.imu[:2]) < slack
        return Outlier.WHEELS if agree else Outlier.LIDAR
