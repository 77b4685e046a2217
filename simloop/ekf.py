"""The state estimator: filterpy's extended Kalman filter for a skid-steered, tracked robot.

The state and the models are those of ``ekf_model``. Wheels, gyro and accelerometer come at
100 Hz and ask for the same arithmetic each time; filterpy's ``predict`` and ``update`` spend
some 80 us on it, nearly all of it in Python's own overhead, a fifth of what the whole loop may
take. So ``PeriodicEkf`` adds to filterpy's filter one compiled step with the very same equations
(the tests hold it to filterpy's to 1e-12); LiDAR fixes, at 10 Hz, go through ``update`` itself.

A fix says where the robot stands in its own map. What that map is off by is in every fix alike and
averages out in none, so the filter's covariance is relative to the map, and the map's error is
considered beside it (Schmidt 1966): an ``Estimate`` carries the sum of both.
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.special import chdtri

from simloop.config import EkfConfig, EncoderConfig, ImuConfig, VehicleConfig
from simloop.ekf_model import (
    BIAS,
    GAUGE,
    YAW,
    predict_and_correct,
    squared_mahalanobis,
    with_pose_error,
)
from simloop.messages import EncoderReading, Estimate, FloatArray, ImuReading, PoseFix
from simloop.se2 import wrap_angle

__all__ = ["GAUGE", "Ekf", "PeriodicEkf"]

_STATIONARY_STD = 1e-3  # m/s, of a sprocket that has not moved one count for a while
_STATIONARY_NS = 200_000_000
_STATIONARY_RADPS = 0.02  # a gyro that says more, its bias taken off, says that it turns
_REJECTIONS_BEFORE_TRUST = 5
_REMEMBERED_PERIODS = 4


def _pose(x: FloatArray) -> FloatArray:
    return x[:3]


def _pose_residual(z: FloatArray, expected: FloatArray) -> FloatArray:
    residual = z - expected
    residual[2] = wrap_angle(residual[2])
    return residual


_POSE_JACOBIAN = np.eye(3, 7)


def _pose_jacobian(_: FloatArray) -> FloatArray:
    return _POSE_JACOBIAN


class PeriodicEkf(ExtendedKalmanFilter):
    """filterpy's filter, with the step that every control period repeats compiled into one call."""

    x: FloatArray
    P: FloatArray

    def predict_and_correct(
        self,
        walk: FloatArray,
        accel: float,
        dt: float,
        wheels: tuple[float, float],
        gyro: float,
        noise: tuple[float, float, float, float],
    ) -> None:
        """``predict`` and ``update`` with belt speeds, m/s, and gyro, rad/s, in one.

        noise: variances of a belt's speed and of the gyro; the gauge, m; the wheels' gate. ``x``
        and ``P`` become new arrays: those before stay with whoever holds them.
        """
        self.x, self.P = predict_and_correct(self.x, self.P, walk, accel, dt, *wheels, gyro, *noise)


class Ekf:
    """Fuses encoders, gyro, accelerometer and LiDAR poses; starts at rest at ``pose`` (3,)."""

    def __init__(
        self,
        config: EkfConfig,
        encoder: EncoderConfig,
        imu: ImuConfig,
        vehicle: VehicleConfig,
        pose: FloatArray,
        period_s: float,
    ) -> None:
        self._gauge, self._period_s = vehicle.gauge_m, period_s
        self._metres_a_count = 2.0 * math.pi * vehicle.sprocket_radius_m / encoder.counts_per_turn
        # A count either came or not: the difference of two uniform errors, over the period. But
        # what one period has too much the next has too little, so over the few periods that the
        # filter remembers a speed the error falls with their number, not with its root.
        quantum = self._metres_a_count / period_s / math.sqrt(6.0)
        self._wheel_var = quantum**2 / _REMEMBERED_PERIODS + config.encoder_slip_mps**2
        self._gyro_var = imu.gyro_noise_radps_rthz**2 / period_s
        self._walk = np.array(
            [
                config.speed_walk,
                config.yaw_rate_walk,
                config.lateral_walk,
                config.gyro_bias_walk,
                config.gauge_ratio_walk,
            ]
        )
        self._wheel_gate = float(chdtri(2, 1.0 - config.gate_probability))
        self._fix_gate = float(chdtri(3, 1.0 - config.gate_probability))
        self._filter = PeriodicEkf(dim_x=7, dim_z=3)
        self._filter.x = np.array([*pose, 0.0, 0.0, 0.0, config.gauge_ratio])
        deviations = [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, config.gyro_bias_std, config.gauge_ratio_std]
        self._filter.P = np.diag(np.square(deviations))
        self._t_ns = 0
        self._last: EncoderReading | None = None
        self._moved_ns = 0
        self._rejected = 0
        entered = [config.map_std_xy_m, config.map_std_xy_m, config.map_std_yaw_rad]
        self._entry_noise = np.diag(np.square(entered))
        self._map_error = np.zeros((3, 3))
        self._mapped_at: FloatArray | None = None

    @property
    def stationary(self) -> bool:
        """Whether no sprocket has moved nor the gyro turned for a while."""
        return self._t_ns - self._moved_ns >= _STATIONARY_NS

    @property
    def covariance_in_map(self) -> FloatArray:
        """(3, 3) of the pose relative to the robot's own map, whatever that is off by."""
        return self._filter.P[:3, :3]

    def estimate(self) -> Estimate:
        """The belief now."""
        covariance = with_pose_error(self._filter.P, self._map_error)
        # The filter makes a new x at each step, and never writes into one that it gave away.
        return Estimate(self._t_ns, self._filter.x, covariance)

    def advance(self, encoders: EncoderReading, imu: ImuReading) -> Estimate:
        """Predict to the readings' instant with the accelerometer, correct with wheels and gyro."""
        dt = (encoders.t_ns - self._t_ns) * 1e-9 if self._last else self._period_s
        self._t_ns = encoders.t_ns
        wheels, gyro = self._wheel_speeds(encoders, dt), float(imu.gyro_radps[2])
        if abs(gyro - self._filter.x[BIAS]) > _STATIONARY_RADPS:
            self._moved_ns = encoders.t_ns
        rests = self.stationary
        accel = 0.0 if rests else float(imu.accel_mps2[0])
        # Counts tell a period's mean speed, which was that of half a period ago.
        wheels = (wheels[0] + 0.5 * accel * dt, wheels[1] + 0.5 * accel * dt)
        wheel_var = _STATIONARY_STD**2 if rests else self._wheel_var
        noise = (wheel_var, self._gyro_var, self._gauge, self._wheel_gate)
        self._filter.predict_and_correct(self._walk, accel, dt, wheels, gyro, noise)
        return self.estimate()

    def correct(self, fix: PoseFix) -> bool:
        """Correct with a LiDAR pose of this instant; False if it was refused.

        A fix outside the gate is refused, but not for ever: after several in a row it is the
        belief that is doubted, and widened.
        """
        if not fix.ok:
            return False
        kf = self._filter
        residual = _pose_residual(fix.pose, kf.x[:3])
        if squared_mahalanobis(residual, kf.P[:3, :3] + fix.covariance) > self._fix_gate:
            self._rejected += 1
            if self._rejected < _REJECTIONS_BEFORE_TRUST:
                return False
            kf.P = kf.P + np.diag([*residual**2, 0.0, 0.0, 0.0, 0.0])
        self._rejected = 0
        kf.update(fix.pose, _pose_jacobian, _pose, R=fix.covariance, residual=_pose_residual)
        kf.x[YAW] = wrap_angle(kf.x[YAW])
        kf.P = 0.5 * (kf.P + kf.P.T)
        return True

    def mapped(self, new_share: float) -> None:
        """A scan has been entered in the map at this belief; new_share: of it, what was new there.

        The first view is the map, and brings in its whole error. Later ones bring theirs, and the
        belief's, for what is new in them alone: the map about the robot moves by that share of
        it. Errors of different scans are independent, so their variances add up.
        """
        x, before = self._filter.x, self._mapped_at
        self._mapped_at = x
        if before is not None:
            # The map is turned about where it began: further off, a turn is a shift.
            dx, dy = x[0] - before[0], x[1] - before[1]
            carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            self._map_error = carry @ self._map_error @ carry.T
        self._map_error += new_share**2 * (self._filter.P[:3, :3] + self._entry_noise)

    def _wheel_speeds(self, encoders: EncoderReading, dt: float) -> tuple[float, float]:
        last, self._last = self._last, encoders
        if last is None:
            return 0.0, 0.0
        left = encoders.left_counts - last.left_counts
        right = encoders.right_counts - last.right_counts
        if left or right:
            self._moved_ns = encoders.t_ns
        return left * self._metres_a_count / dt, right * self._metres_a_count / dt
