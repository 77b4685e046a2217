"""The state estimator: filterpy's extended Kalman filter for a skid-steered, tracked robot.

State, in this order: x, y, yaw of base_link in map; forward speed v; yaw rate w; gyro bias b;
gauge ratio k, the slip term. A track that turns must slip sideways, which makes the robot
turn as if its gauge were wider: k B = y_l - y_r, the distance between the tracks' instantaneous
centres of rotation (Martinez & Mandow 2005), so k = 1 / chi. It is estimated online.

    predict   v' = a_x (accelerometer), w' = b' = k' = noise, x' = v cos yaw, y' = v sin yaw
    wheels    v_left = v - k B w / 2,  v_right = v + k B w / 2;  gyro = w + b
    LiDAR     x, y, yaw of a scan-to-map match
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numba import njit
from scipy.stats import chi2

from simloop.config import EkfConfig, EncoderConfig, ImuConfig, VehicleConfig
from simloop.messages import EncoderReading, Estimate, FloatArray, ImuReading, PoseFix
from simloop.se2 import wrap_angle

X, Y, YAW, SPEED, RATE, BIAS, GAUGE = range(7)
_STATIONARY_STD = 1e-3  # m/s, of a sprocket that has not moved one count for a while
_STATIONARY_NS = 200_000_000
_STATIONARY_RADPS = 0.02  # a gyro that says more, its bias taken off, says that it turns
_REJECTIONS_BEFORE_TRUST = 5


@njit(cache=True)
def motion(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """The state (7,) one period dt, s, later under forward acceleration ``accel``, m/s^2."""
    out = x.copy()
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    out[X] += speed * math.cos(yaw) * dt
    out[Y] += speed * math.sin(yaw) * dt
    out[YAW] = wrap_angle(x[YAW] + x[RATE] * dt)
    out[SPEED] += accel * dt
    return out


@njit(cache=True)
def motion_jacobian(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """(7, 7) d motion / d x."""
    jacobian = np.eye(7)
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    cos, sin = math.cos(yaw) * dt, math.sin(yaw) * dt
    jacobian[X, YAW], jacobian[Y, YAW] = -speed * sin, speed * cos
    jacobian[X, SPEED], jacobian[Y, SPEED] = cos, sin
    jacobian[X, RATE], jacobian[Y, RATE] = -0.5 * dt * speed * sin, 0.5 * dt * speed * cos
    jacobian[YAW, RATE] = dt
    return jacobian


@njit(cache=True)
def motion_noise(x: FloatArray, dt: float, walk: FloatArray) -> FloatArray:
    """(7, 7) process noise of one period. walk: (5,) densities of speed, yaw rate, sideways, b, k.

    A track slips sideways only as the robot turns, so that noise scales with the yaw rate.
    """
    noise = np.zeros((7, 7))
    cos, sin = math.cos(x[YAW]), math.sin(x[YAW])
    along = walk[0] ** 2 * dt**3 / 3.0
    aside = (walk[2] * x[RATE]) ** 2 * dt
    noise[X, X] = along * cos * cos + aside * sin * sin
    noise[Y, Y] = along * sin * sin + aside * cos * cos
    noise[X, Y] = noise[Y, X] = (along - aside) * sin * cos
    # White noise in acceleration, integrated over the period: without these cross terms a gyro
    # reading at the period's end would correct the rate but not the yaw that it has brought.
    noise[X, SPEED] = noise[SPEED, X] = walk[0] ** 2 * dt**2 / 2.0 * cos
    noise[Y, SPEED] = noise[SPEED, Y] = walk[0] ** 2 * dt**2 / 2.0 * sin
    noise[SPEED, SPEED] = walk[0] ** 2 * dt
    noise[YAW, YAW] = walk[1] ** 2 * dt**3 / 3.0
    noise[YAW, RATE] = noise[RATE, YAW] = walk[1] ** 2 * dt**2 / 2.0
    noise[RATE, RATE] = walk[1] ** 2 * dt
    noise[BIAS, BIAS] = walk[3] ** 2 * dt
    noise[GAUGE, GAUGE] = walk[4] ** 2 * dt
    return noise


@njit(cache=True)
def wheels_and_gyro(x: FloatArray, gauge: float) -> FloatArray:
    """(3,) expected left and right belt speed, m/s, and gyro reading, rad/s."""
    half = 0.5 * gauge * x[GAUGE] * x[RATE]
    return np.array([x[SPEED] - half, x[SPEED] + half, x[RATE] + x[BIAS]])


@njit(cache=True)
def wheels_and_gyro_jacobian(x: FloatArray, gauge: float) -> FloatArray:
    """(3, 7) d wheels_and_gyro / d x."""
    jacobian = np.zeros((3, 7))
    half = 0.5 * gauge
    jacobian[0, SPEED], jacobian[1, SPEED] = 1.0, 1.0
    jacobian[0, RATE], jacobian[1, RATE] = -half * x[GAUGE], half * x[GAUGE]
    jacobian[0, GAUGE], jacobian[1, GAUGE] = -half * x[RATE], half * x[RATE]
    jacobian[2, RATE], jacobian[2, BIAS] = 1.0, 1.0
    return jacobian


@njit(cache=True)
def squared_mahalanobis(residual: FloatArray, covariance: FloatArray) -> float:
    """r^T S^-1 r of an innovation (n,) with covariance (n, n)."""
    return float(np.dot(residual, np.linalg.solve(covariance, residual)))


@njit(cache=True)
def wheel_surprise(
    x: FloatArray, covariance: FloatArray, z: FloatArray, noise: FloatArray, gauge: float
) -> float:
    """Squared Mahalanobis distance of the two belt speeds in z (3,), noise (3, 3)."""
    jacobian = wheels_and_gyro_jacobian(x, gauge)[:2]
    innovation = jacobian @ covariance @ jacobian.T + noise[:2, :2]
    return squared_mahalanobis((z - wheels_and_gyro(x, gauge))[:2], innovation)


def _pose(x: FloatArray) -> FloatArray:
    return x[:3]


def _pose_residual(z: FloatArray, expected: FloatArray) -> FloatArray:
    residual = z - expected
    residual[2] = wrap_angle(residual[2])
    return residual


_POSE_JACOBIAN = np.eye(3, 7)


def _pose_jacobian(_: FloatArray) -> FloatArray:
    return _POSE_JACOBIAN


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
        self._config, self._gauge, self._period_s = config, vehicle.gauge_m, period_s
        self._metres_a_count = 2.0 * math.pi * vehicle.sprocket_radius_m / encoder.counts_per_turn
        # A count either came or not: the difference of two uniform errors, over the period.
        quantum = self._metres_a_count / period_s / math.sqrt(6.0)
        self._wheel_var = quantum**2 + config.encoder_slip_mps**2
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
        self._wheel_gate = chi2.ppf(config.gate_probability, 2)
        self._fix_gate = chi2.ppf(config.gate_probability, 3)
        self._filter = ExtendedKalmanFilter(dim_x=7, dim_z=3)
        self._filter.x = np.array([*pose, 0.0, 0.0, 0.0, config.gauge_ratio])
        deviations = [1e-3, 1e-3, 1e-3, 1e-3, 1e-3, config.gyro_bias_std, config.gauge_ratio_std]
        self._filter.P = np.diag(np.square(deviations))
        self._t_ns = 0
        self._last: EncoderReading | None = None
        self._moved_ns = 0
        self._rejected = 0

    @property
    def stationary(self) -> bool:
        """Whether no sprocket has moved nor the gyro turned for a while."""
        return self._t_ns - self._moved_ns >= _STATIONARY_NS

    def estimate(self) -> Estimate:
        """The belief now."""
        return Estimate(self._t_ns, self._filter.x.copy(), self._filter.P.copy())

    def advance(self, encoders: EncoderReading, imu: ImuReading) -> Estimate:
        """Predict to the readings' instant with the accelerometer, correct with wheels and gyro."""
        dt = (encoders.t_ns - self._t_ns) * 1e-9 if self._last else self._period_s
        self._t_ns = encoders.t_ns
        wheels = self._wheel_speeds(encoders, dt)
        if abs(imu.gyro_radps[2] - self._filter.x[BIAS]) > _STATIONARY_RADPS:
            self._moved_ns = encoders.t_ns
        self._predict(0.0 if self.stationary else float(imu.accel_mps2[0]), dt)
        self._correct_wheels(wheels, float(imu.gyro_radps[2]))
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
            kf.P[:3, :3] += np.diag(residual**2)
        self._rejected = 0
        kf.update(fix.pose, _pose_jacobian, _pose, R=fix.covariance, residual=_pose_residual)
        self._keep_proper()
        return True

    def _predict(self, accel: float, dt: float) -> None:
        kf = self._filter
        kf.F = motion_jacobian(kf.x, accel, dt)
        kf.Q = motion_noise(kf.x, dt, self._walk)
        kf.predict_x = lambda u=0: setattr(kf, "x", motion(kf.x, accel, dt))
        kf.predict()

    def _wheel_speeds(self, encoders: EncoderReading, dt: float) -> tuple[float, float]:
        last, self._last = self._last, encoders
        if last is None:
            return 0.0, 0.0
        left = encoders.left_counts - last.left_counts
        right = encoders.right_counts - last.right_counts
        if left or right:
            self._moved_ns = encoders.t_ns
        return left * self._metres_a_count / dt, right * self._metres_a_count / dt

    def _correct_wheels(self, wheels: tuple[float, float], gyro: float) -> None:
        kf, gauge = self._filter, self._gauge
        z = np.array([*wheels, gyro])
        wheel_var = _STATIONARY_STD**2 if self.stationary else self._wheel_var
        noise = np.diag([wheel_var, wheel_var, self._gyro_var])
        if wheel_surprise(kf.x, kf.P, z, noise, gauge) > self._wheel_gate:
            noise[0, 0] = noise[1, 1] = 100.0  # the belts slip: all but ignore them this time
        kf.update(z, wheels_and_gyro_jacobian, wheels_and_gyro, noise, (gauge,), (gauge,))
        self._keep_proper()

    def _keep_proper(self) -> None:
        kf = self._filter
        kf.x[YAW] = wrap_angle(kf.x[YAW])
        kf.P = 0.5 * (kf.P + kf.P.T)
