"""The state estimator: filterpy's extended Kalman filter for a skid-steered, tracked robot.

The state and the models are those of ``ekf_model``. Wheels, gyro and accelerometer come at
100 Hz and ask for the same arithmetic each time; filterpy's ``predict`` and ``update`` spend
some 80 us on it, nearly all of it in Python's own overhead, a fifth of what the whole loop may
take. So ``PeriodicEkf`` adds to filterpy's filter one compiled step with the very same equations
(the tests hold it to filterpy's to 1e-12); LiDAR fixes, at 10 Hz, go through ``update`` itself, at
the instant that they tell of, and what was heard since is replayed (see ``ekf_history``).

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
from simloop.estimation.ekf_history import History
from simloop.estimation.ekf_model import (
    BIAS,
    GAUGE,
    ICR_X,
    NO_LEFT,
    NO_RIGHT,
    OFFSET,
    SLIPPING_VAR,
    STATES,
    YAW,
    predict_and_correct,
    with_pose_error,
)
from simloop.geometry.se2 import wrap_angle
from simloop.geometry.small_matrices import squared_mahalanobis
from simloop.messages import EncoderReading, Estimate, FloatArray, ImuReading, PoseFix

__all__ = ["GAUGE", "ICR_X", "OFFSET", "Ekf", "PeriodicEkf"]

_STATIONARY_STD = 1e-3  # m/s, of a sprocket that has not moved one count for a while
_STATIONARY_NS = 200_000_000
_STATIONARY_RADPS = 0.02  # a gyro that says more, its bias taken off, says that it turns
_REJECTIONS_BEFORE_TRUST = 5
_REMEMBERED_PERIODS = 4
_NO_GYRO_VAR = 1e6
_LONE_BELT_GATE = 4.0  # squared deviations within which a belt is heard though the other is not
_HISTORY_NS = 500_000_000


def _pose(x: FloatArray) -> FloatArray:
    return x[:3]


def _pose_residual(z: FloatArray, expected: FloatArray) -> FloatArray:
    residual = z - expected
    residual[2] = wrap_angle(residual[2])
    return residual


_POSE_JACOBIAN = np.eye(3, STATES)


def _pose_jacobian(_: FloatArray) -> FloatArray:
    return _POSE_JACOBIAN


class PeriodicEkf(ExtendedKalmanFilter):
    """filterpy's filter, with the step that every control period repeats compiled into one call."""

    x: FloatArray
    P: FloatArray

    def predict_and_correct(
        self, inputs: FloatArray, walk: FloatArray, gauge_m: float, gates: FloatArray
    ) -> None:
        """``predict`` and ``update`` with gyro and belts in one; see the function of this name.

        ``x`` and ``P`` become new arrays: those before stay with whoever holds them.
        """
        self.x, self.P = predict_and_correct(self.x, self.P, inputs, walk, gauge_m, gates)


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
                config.icr_walk,
                config.icr_walk,
            ]
        )
        lone_var = quantum**2 * (1.0 - 1.0 / _REMEMBERED_PERIODS)
        pair_gate = chdtri(2, 1.0 - config.gate_probability)
        self._gates = np.array([_LONE_BELT_GATE, pair_gate, lone_var])
        self._fix_gate = float(chdtri(3, 1.0 - config.gate_probability))
        self._filter = PeriodicEkf(dim_x=STATES, dim_z=3)
        self._filter.x = np.array([*pose, 0.0, 0.0, 0.0, config.gauge_ratio, 0.0, 0.0])
        deviations = [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, config.gyro_bias_std]
        deviations += [config.gauge_ratio_std, config.icr_std_m, config.icr_std_m]
        self._filter.P = np.diag(np.square(deviations))
        self._history = History(max(2, round(_HISTORY_NS * 1e-9 / period_s)))
        self._history.start(0, self._filter.x, self._filter.P)
        self._t_ns = 0
        self._last: EncoderReading | None = None
        self._imu_ns = -1
        self._moved_ns = 0
        self.rejected = 0
        self.shove_var = 0.0
        self.belts_refused = (False, False)
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

    def belief_at(self, t_ns: int) -> tuple[FloatArray, FloatArray] | None:
        """Pose (3,) and its covariance in the map (3, 3) at an instant; None: too long ago."""
        row = self._history.find(t_ns)
        if row is None:
            return None
        x, p = self._history.belief(row)
        return x[:3], p[:3, :3]

    def estimate(self) -> Estimate:
        """The belief now."""
        covariance = with_pose_error(self._filter.P, self._map_error)
        # The filter makes a new x at each step, and never writes into one that it gave away.
        return Estimate(self._t_ns, self._filter.x, covariance)

    def advance(
        self, encoders: EncoderReading, imu: ImuReading, may_move: bool = False
    ) -> Estimate:
        """Predict to the readings' instant with the accelerometer, correct with wheels and gyro.

        may_move: whether the motors are driven, so that counts that stand need not mean rest. A
        reading whose stamp is not newer than the last one's has not come: it was late, or the
        sensor has stopped. Where neither is new, nothing but a period's time has passed.
        """
        new_counts = self._last is None or encoders.t_ns > self._last.t_ns
        new_imu = imu.t_ns > self._imu_ns
        now_ns = max(encoders.t_ns if new_counts else 0, imu.t_ns if new_imu else 0)
        period_ns = round(self._period_s * 1e9)
        before_ns = now_ns - period_ns if self._last is None else self._t_ns
        if now_ns <= before_ns:
            now_ns = before_ns + period_ns
        dt, self._t_ns = (now_ns - before_ns) * 1e-9, now_ns
        gyro, gyro_var = 0.0, _NO_GYRO_VAR
        if new_imu:
            gyro, gyro_var, self._imu_ns = float(imu.gyro_radps[2]), self._gyro_var, imu.t_ns
        turned = new_imu and abs(gyro - self._filter.x[BIAS]) > _STATIONARY_RADPS
        if turned or may_move or not new_counts:
            self._moved_ns = now_ns
        left, right, lag_s = self._wheel_speeds(encoders) if new_counts else (0.0, 0.0, 0.0)
        rests = self.stationary
        accel = float(imu.accel_mps2[0]) if new_imu and not rests else 0.0
        # Counts tell the mean speed over the time that they took, which was that of half of it ago.
        left, right = left + accel * lag_s, right + accel * lag_s
        wheel_var = _STATIONARY_STD**2 if rests else self._wheel_var
        if not new_counts:
            wheel_var = SLIPPING_VAR
        told = (accel, dt, left, right, gyro, wheel_var, wheel_var, gyro_var, self.shove_var)
        inputs = self._history.push(now_ns, told)
        self._filter.predict_and_correct(inputs, self._walk, self._gauge, self._gates)
        self._history.keep(self._filter.x, self._filter.P)
        self.belts_refused = (bool(inputs[NO_LEFT]), bool(inputs[NO_RIGHT]))
        return self.estimate()

    def correct(self, fix: PoseFix) -> bool:
        """Correct with a LiDAR pose, at its own instant; False if it was refused.

        A fix outside the gate is refused, but not for ever: after several in a row it is the
        belief that is doubted, and widened. One that is older than what is remembered is refused.
        """
        row = self._history.find(fix.t_ns) if fix.ok else None
        if row is None:
            return False
        kf, (x, p) = self._filter, self._history.belief(row)
        residual = _pose_residual(fix.pose, x[:3])
        if squared_mahalanobis(residual, p[:3, :3] + fix.covariance) > self._fix_gate:
            self.rejected += 1
            if self.rejected < _REJECTIONS_BEFORE_TRUST:
                return False
            p[:3, :3] += np.diag(residual**2)
        self.rejected = 0
        kf.x, kf.P = x, p
        kf.update(fix.pose, _pose_jacobian, _pose, R=fix.covariance, residual=_pose_residual)
        kf.x[YAW] = wrap_angle(kf.x[YAW])
        self._believe(row, kf.x, 0.5 * (kf.P + kf.P.T))
        return True

    def widen(self, t_ns: int, deviations: FloatArray) -> None:
        """Widen the belief of an instant by independent errors of these deviations (9,)."""
        row = self._history.find(t_ns)
        if row is not None:
            x, p = self._history.belief(row)
            self._believe(row, x, p + np.diag(np.square(deviations)))

    def reset_pose(self, t_ns: int, pose: FloatArray, covariance: FloatArray) -> None:
        """Stand at ``pose`` (3,) at an instant, whatever was believed; all but the pose is kept."""
        row = self._history.find(t_ns)
        if row is None:
            return
        x, p = self._history.belief(row)
        x[:3], p[:3], p[:, :3] = pose, 0.0, 0.0
        p[:3, :3] = covariance
        self.rejected = 0
        self._believe(row, x, p)

    def add_map_error(self, new_share: float) -> None:
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

    def _believe(self, row: int, x: FloatArray, p: FloatArray) -> None:
        """Put a belief into the history, and take up what follows from it now."""
        self._filter.x, self._filter.P = self._history.rewrite(
            row, x, p, self._walk, self._gauge, self._gates
        )

    def _wheel_speeds(self, encoders: EncoderReading) -> tuple[float, float, float]:
        """Both belts' mean speeds, m/s, since the last counts, and half the time since then, s."""
        last, self._last = self._last, encoders
        if last is None:
            return 0.0, 0.0, 0.5 * self._period_s
        left = encoders.left_counts - last.left_counts
        right = encoders.right_counts - last.right_counts
        if left or right:
            self._moved_ns = encoders.t_ns
        dt = (encoders.t_ns - last.t_ns) * 1e-9
        return left * self._metres_a_count / dt, right * self._metres_a_count / dt, 0.5 * dt
