"""Estimate the state of a skid-steered, tracked robot with filterpy's extended Kalman filter.

State and models are those of ``ekf_model``. Wheels, gyro and accelerometer come at 100 Hz and need
the same arithmetic each time. filterpy's ``predict`` and ``update`` take some 80 us for it. Nearly
all of this is overhead of Python, and it is a fifth of the time budget of the whole loop. So
``PeriodicEkf`` adds one compiled step with the same equations (tests compare it with filterpy's, to
1e-10). LiDAR fixes, at 10 Hz, correct the belief at their own time with filterpy's ``update``. Then
the inputs since that time are filtered again (see ``ekf_history``).

A fix is the robot's pose in its own map. The map's error is the same in every fix and does not
average out. So the filter's covariance is relative to the map, and the map's error is kept
separately (Schmidt 1966). An ``Estimate`` contains the sum of both.
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

_STATIONARY_STD = 1e-3  # standard deviation of a belt's speed at rest, m/s
_STATIONARY_NS = 200_000_000  # the robot is at rest after this time without motion
_STATIONARY_RADPS = 0.02  # a larger yaw rate, after the bias is removed, is motion
_REJECTIONS_BEFORE_TRUST = 5  # this many fixes refused in a row widen the belief instead
_REMEMBERED_PERIODS = 4  # number of periods over which the filter averages a belt's speed
_NO_GYRO_VAR = 1e6  # variance that stands for a missing gyro reading, (rad/s)^2
_LONE_BELT_GATE = 4.0  # largest squared Mahalanobis distance of a belt used without the other
_HISTORY_NS = 500_000_000  # largest delay of a fix


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
    """filterpy's filter with one compiled call for the step of each control period.

    Attributes:
        x: (9,) state.
        P: (9, 9) covariance.
    """

    x: FloatArray
    P: FloatArray

    def predict_and_correct(
        self, inputs: FloatArray, walk: FloatArray, gauge_m: float, gates: FloatArray
    ) -> None:
        """Predict over one period and correct with gyro and belts.

        ``x`` and ``P`` become new arrays, so that a belief returned before never changes.

        Args:
            inputs: (11,) the period's inputs; see ``ekf_model.predict_and_correct``.
            walk: (7,) process noise densities.
            gauge_m: Nominal distance of the tracks, m.
            gates: (3,) see ``ekf_model.gate_wheels``.
        """
        self.x, self.P = predict_and_correct(self.x, self.P, inputs, walk, gauge_m, gates)


class Ekf:
    """Filter that fuses encoders, gyro, accelerometer and LiDAR poses.

    Attributes:
        rejected: Number of fixes refused in a row.
        shove_var: Additional process noise of the position while the robot is pushed, m^2/s.
        belts_refused: Whether the gate refused the left and the right belt in the last period.
    """

    def __init__(
        self,
        config: EkfConfig,
        encoder: EncoderConfig,
        imu: ImuConfig,
        vehicle: VehicleConfig,
        pose: FloatArray,
        period_s: float,
    ) -> None:
        """Start at rest.

        Args:
            config: Noises and gates of the filter.
            encoder: Counts per turn.
            imu: Noise of the gyro.
            vehicle: Gauge and sprocket radius.
            pose: (3,) x, y, yaw of base_link in map, m and rad.
            period_s: Control period, s.
        """
        self._gauge, self._period_s = vehicle.gauge_m, period_s
        self._metres_a_count = 2.0 * math.pi * vehicle.sprocket_radius_m / encoder.counts_per_turn
        # The error of a difference of counts is the difference of two uniform errors. If one period
        # counts too much, the next counts too little. So over the periods that the filter averages,
        # the error falls with their number and not with its square root.
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
        """Whether sprockets and gyro have shown no motion for a while."""
        return self._t_ns - self._moved_ns >= _STATIONARY_NS

    @property
    def covariance_in_map(self) -> FloatArray:
        """(3, 3) covariance of the pose relative to the robot's map, without the map's error."""
        return self._filter.P[:3, :3]

    def belief_at(self, t_ns: int) -> tuple[FloatArray, FloatArray] | None:
        """Return the belief at a time.

        Args:
            t_ns: The time, ns.

        Returns:
            Pose (3,) x, y, yaw of base_link in map, and its covariance (3, 3) relative to the map.
            None if that time is no longer in the history.
        """
        row = self._history.find(t_ns)
        if row is None:
            return None
        x, p = self._history.belief(row)
        return x[:3], p[:3, :3]

    def estimate(self) -> Estimate:
        """Return the present belief.

        Returns:
            State and covariance; the covariance includes the map's error.
        """
        covariance = with_pose_error(self._filter.P, self._map_error)
        # The filter makes a new x at each step and never changes an x that was returned before.
        return Estimate(self._t_ns, self._filter.x, covariance)

    def advance(
        self, encoders: EncoderReading, imu: ImuReading, may_move: bool = False
    ) -> Estimate:
        """Predict to the time of the readings with the accelerometer; correct with wheels and gyro.

        A reading counts as missing if its stamp is not newer than the last one: it is late, or the
        sensor has stopped. If both are missing, one period is predicted.

        Args:
            encoders: Sprocket counts.
            imu: Rates and accelerations.
            may_move: Whether the motors are driven. Then constant counts do not mean rest.

        Returns:
            The present belief.
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
        # Counts give the mean speed since the last counts, so it is half that time old.
        left, right = left + accel * lag_s, right + accel * lag_s
        wheel_var = _STATIONARY_STD**2 if rests else self._wheel_var
        if not new_counts:
            wheel_var = SLIPPING_VAR
        values = (accel, dt, left, right, gyro, wheel_var, wheel_var, gyro_var, self.shove_var)
        inputs = self._history.push(now_ns, values)
        self._filter.predict_and_correct(inputs, self._walk, self._gauge, self._gates)
        self._history.keep(self._filter.x, self._filter.P)
        self.belts_refused = (bool(inputs[NO_LEFT]), bool(inputs[NO_RIGHT]))
        return self.estimate()

    def correct(self, fix: PoseFix) -> bool:
        """Correct the belief at the time of a LiDAR pose.

        A fix outside the gate is refused. After several refusals in a row the belief is widened
        instead, and the fix is accepted.

        Args:
            fix: The pose and its covariance.

        Returns:
            False if the fix was refused, is not ok, or is older than the filter's history.
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
        self._replace_belief(row, kf.x, 0.5 * (kf.P + kf.P.T))
        return True

    def widen(self, t_ns: int, deviations: FloatArray) -> None:
        """Add independent errors to the belief at a time.

        Args:
            t_ns: The time, ns. If it is no longer in the history, nothing happens.
            deviations: (9,) standard deviations in the units of the state.
        """
        row = self._history.find(t_ns)
        if row is not None:
            x, p = self._history.belief(row)
            self._replace_belief(row, x, p + np.diag(np.square(deviations)))

    def reset_pose(self, t_ns: int, pose: FloatArray, covariance: FloatArray) -> None:
        """Replace the pose at a time, and keep all other parts of the state.

        Args:
            t_ns: The time, ns. If it is no longer in the history, nothing happens.
            pose: (3,) x, y, yaw of base_link in map, m and rad.
            covariance: (3, 3) covariance of the pose.
        """
        row = self._history.find(t_ns)
        if row is None:
            return
        x, p = self._history.belief(row)
        x[:3], p[:3], p[:, :3] = pose, 0.0, 0.0
        p[:3, :3] = covariance
        self.rejected = 0
        self._replace_belief(row, x, p)

    def add_map_error(self, new_share: float) -> None:
        """Add the error of a scan that was entered in the map at the present belief.

        The first scan is the whole map, so all of its error counts. A later scan adds its own error
        and the error of the belief, both multiplied by the share of the scan that is new: the map
        around the robot moves by this share of the errors. Errors of different scans are
        independent, so their variances add up.

        Args:
            new_share: Share of the scan that was new in the map, 0 to 1.
        """
        x, before = self._filter.x, self._mapped_at
        self._mapped_at = x
        if before is not None:
            # A rotation of the map at the last place is a shift at the robot's present place.
            dx, dy = x[0] - before[0], x[1] - before[1]
            carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            self._map_error = carry @ self._map_error @ carry.T
        self._map_error += new_share**2 * (self._filter.P[:3, :3] + self._entry_noise)

    def _replace_belief(self, row: int, x: FloatArray, p: FloatArray) -> None:
        """Replace a belief in the history, and take the present belief that follows from it."""
        self._filter.x, self._filter.P = self._history.rewrite(
            row, x, p, self._walk, self._gauge, self._gates
        )

    def _wheel_speeds(self, encoders: EncoderReading) -> tuple[float, float, float]:
        """Return both belts' mean speeds since the last counts, m/s, and half that time, s."""
        last, self._last = self._last, encoders
        if last is None:
            return 0.0, 0.0, 0.5 * self._period_s
        left = encoders.left_counts - last.left_counts
        right = encoders.right_counts - last.right_counts
        if left or right:
            self._moved_ns = encoders.t_ns
        dt = (encoders.t_ns - last.t_ns) * 1e-9
        return left * self._metres_a_count / dt, right * self._metres_a_count / dt, 0.5 * dt
