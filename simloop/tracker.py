"""The tracker: velocity control along a path, slip-compensated track speeds, motor loops.

It follows a ``SmoothPath`` with the curvature of the path fed forward and a lateral and a
heading error fed back (Samson's form: w = v kappa - k1 v e sinc(a) - k2 |v| a), at the speed
that curvature, clearance, the motors and the braking distance allow; turns on the spot where
the path asks for it; and stands still in the goal's tolerance. Body velocities become track
speeds with the estimated gauge ratio, so that slip is made good before it happens.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import EncoderConfig, MotorConfig, TrackerConfig, VehicleConfig
from simloop.ekf import GAUGE
from simloop.messages import EncoderReading, Estimate, FloatArray, SmoothPath, TrackCommand
from simloop.se2 import wrap_angle

_SEARCH_M = 0.5  # how far along the path the nearest point may have moved since last time


@njit(cache=True)
def speed_profile(
    arc: FloatArray,
    curvature: FloatArray,
    clearance: FloatArray,
    safe: float,
    limits: FloatArray,
) -> FloatArray:
    """(k,) m/s allowed at each sample of a path, ending at rest.

    limits: (7,) speed, yaw rate, lateral acceleration, creep speed, open clearance, braking
    deceleration, track speed per half of the effective gauge: see ``Tracker._limits``.
    """
    top, rate, lateral, creep, opening, brake, half_gauge = limits
    n = arc.shape[0]
    speed = np.empty(n)
    for i in range(n):
        bend = abs(curvature[i])
        allowed = top / (1.0 + half_gauge * bend)  # the outer track's speed is what is limited
        if bend > 1e-6:
            allowed = min(allowed, rate / bend, math.sqrt(lateral / bend))
        room = min(1.0, max(0.0, (clearance[i] - safe) / opening))
        speed[i] = min(allowed, creep + room * max(0.0, top - creep))
    speed[n - 1] = 0.0
    for i in range(n - 2, -1, -1):
        reach = math.sqrt(speed[i + 1] ** 2 + 2.0 * brake * (arc[i + 1] - arc[i]))
        speed[i] = min(speed[i], reach)
    return speed


@njit(cache=True)
def nearest_sample(xy: FloatArray, arc: FloatArray, x: float, y: float, start: int) -> int:
    """Index of the sample (k, 2) nearest to (x, y), at or within ``_SEARCH_M`` after ``start``."""
    best, found = 1e18, start
    for i in range(start, xy.shape[0]):
        if arc[i] - arc[start] > _SEARCH_M:
            break
        d = (xy[i, 0] - x) ** 2 + (xy[i, 1] - y) ** 2
        if d < best:
            best, found = d, i
    return found


class MotorLoop:
    """Voltages that make the sprockets turn as asked: the motor's law ahead, counts fed back.

    The error is kept as an angle (counts asked for less counts come), which is an integral of the
    speed error that quantisation cannot disturb.
    """

    def __init__(
        self, config: TrackerConfig, motor: MotorConfig, encoder: EncoderConfig, period_s: float
    ) -> None:
        self._config, self._motor, self._period_s = config, motor, period_s
        self._rad_a_count = 2.0 * math.pi / encoder.counts_per_turn
        self._error = np.zeros(2)
        self._counts: tuple[int, int] | None = None

    def voltages(self, asked_radps: FloatArray, encoders: EncoderReading) -> FloatArray:
        """(2,) V for the sprocket speeds asked (2,) rad/s."""
        motor, limit = self._motor, self._config.angle_error_limit_rad
        counts = (encoders.left_counts, encoders.right_counts)
        if self._counts is not None:
            come = np.subtract(counts, self._counts) * self._rad_a_count
            self._error += asked_radps * self._period_s - come
            self._error[asked_radps == 0.0] = 0.0
            np.clip(self._error, -limit, limit, out=self._error)
        self._counts = counts
        # Gear friction needs its current whenever the sprocket turns.
        friction_v = motor.resistance_ohm * motor.no_load_current_a * np.sign(asked_radps)
        volts = motor.back_emf_v_per_radps * asked_radps + friction_v
        volts = volts + self._config.angle_gain_v_per_rad * self._error
        return np.clip(volts, -motor.supply_v, motor.supply_v)


class Tracker:
    """Follows one path at a time; what it asks for is a body velocity, m/s and rad/s."""

    def __init__(
        self,
        config: TrackerConfig,
        vehicle: VehicleConfig,
        safe_distance_m: float,
        goal: FloatArray,
        goal_tolerance_m: float,
        period_s: float,
    ) -> None:
        self._config, self._vehicle, self._safe = config, vehicle, safe_distance_m
        self._goal, self._period_s = goal, period_s
        self._arrive_m = max(0.5 * goal_tolerance_m, goal_tolerance_m - config.goal_margin_m)
        self._path: SmoothPath | None = None
        self._profile = np.empty(0)
        self._at = 0
        self._speed = self._rate = 0.0
        self.arrived = False
        self.turning = False

    @property
    def path(self) -> SmoothPath | None:
        """The path that is being followed."""
        return self._path

    @property
    def ahead(self) -> slice:
        """The samples of the path that are still to come."""
        return slice(self._at, None)

    def follow(self, path: SmoothPath, gauge_ratio: float) -> None:
        """Follow ``path`` from now on. gauge_ratio: the estimated k of the tracks."""
        config = self._config
        limits = np.array(
            [
                config.max_speed_mps,
                config.max_yaw_rate_radps,
                config.max_lateral_accel_mps2,
                config.creep_mps,
                config.open_clearance_m,
                config.max_decel_mps2,
                0.5 * gauge_ratio * self._vehicle.gauge_m,
            ]
        )
        self._path, self._at = path, 0
        self._profile = speed_profile(
            path.arc_m, path.curvature_1pm, path.clearance_m, self._safe, limits
        )

    def hold(self) -> None:
        """Forget the path and stand still."""
        self._path = None

    def velocity(self, estimate: Estimate) -> tuple[float, float, str]:
        """Speed, yaw rate and mode to ask for now, acceleration limits kept."""
        x, y, yaw = estimate.pose.tolist()
        if math.dist((x, y), self._goal) <= self._arrive_m:
            self.arrived = True
        if self.arrived or self._path is None:
            return *self._slew(0.0, 0.0), "arrived" if self.arrived else "stop"
        path = self._path
        self._at = nearest_sample(path.xy_m, path.arc_m, x, y, self._at)
        ahead = min(self._at + 1, len(path.arc_m) - 1)
        off_heading = wrap_angle(yaw - path.yaw_rad[ahead])
        self.turning = abs(off_heading) > (
            self._config.end_turn_rad if self.turning else self._config.turn_on_spot_rad
        )
        if self.turning:
            rate = -self._config.turn_gain_1ps * off_heading
            return *self._slew(0.0, rate), "turn"
        speed, rate = self._along(path, x, y, off_heading)
        return *self._slew(speed, rate), "follow"

    def _along(
        self, path: SmoothPath, x: float, y: float, off_heading: float
    ) -> tuple[float, float]:
        config, i = self._config, self._at
        cos, sin = math.cos(path.yaw_rad[i]), math.sin(path.yaw_rad[i])
        aside = -sin * (x - path.xy_m[i, 0]) + cos * (y - path.xy_m[i, 1])
        past_end = cos * (x - path.xy_m[i, 0]) + sin * (y - path.xy_m[i, 1])
        speed = self._profile[i]
        if i + 1 < len(self._profile):  # the profile a control period ahead, and no dead start
            speed = max(min(speed, self._profile[i + 1]), 0.05)
        elif past_end > 0.0:
            return 0.0, 0.0
        else:
            speed = 0.05
        sinc = math.sin(off_heading) / off_heading if abs(off_heading) > 1e-6 else 1.0
        rate = speed * path.curvature_1pm[i]
        rate -= speed * (
            config.lateral_gain_1pm2 * aside * sinc + config.heading_gain_1pm * off_heading
        )
        return speed * max(0.0, math.cos(off_heading)), rate

    def _slew(self, speed: float, rate: float) -> tuple[float, float]:
        """Limit the asked velocity's values and its changes over one control period."""
        config, dt = self._config, self._period_s
        rate = min(max(rate, -config.max_yaw_rate_radps), config.max_yaw_rate_radps)
        up = config.max_accel_mps2 * dt
        down = 2.0 * config.max_decel_mps2 * dt  # twice what is planned with: room for correction
        speeding_up = abs(speed) > abs(self._speed)
        step = up if speeding_up else down
        turn = config.max_yaw_accel_radps2 * dt
        self._speed += min(max(speed - self._speed, -step), step)
        self._rate += min(max(rate - self._rate, -turn), turn)
        return self._speed, self._rate

    def overrule(self, speed: float, rate: float) -> None:
        """Tell that another velocity was asked for in the end: the limits go on from there."""
        self._speed, self._rate = speed, rate


def sprocket_speeds(
    speed: float, yaw_rate: float, gauge_ratio: float, vehicle: VehicleConfig, most_mps: float
) -> FloatArray:
    """(2,) left, right sprocket speeds, rad/s, that give a body velocity in spite of slip.

    Where a track would be faster than ``most_mps``, both are scaled: the path's curvature is kept.
    """
    half = 0.5 * gauge_ratio * vehicle.gauge_m * yaw_rate
    tracks = np.array([speed - half, speed + half])
    fastest = np.abs(tracks).max()
    if fastest > most_mps:
        tracks *= most_mps / fastest
    return tracks / vehicle.sprocket_radius_m


def make_command(
    t_ns: int,
    velocity: tuple[float, float, str],
    estimate: Estimate,
    encoders: EncoderReading,
    loop: MotorLoop,
    vehicle: VehicleConfig,
    most_mps: float,
) -> TrackCommand:
    """The motors' voltages for a body velocity."""
    speed, rate, mode = velocity
    gauge_ratio = float(np.clip(estimate.state[GAUGE], 1.0, 2.0))
    asked = sprocket_speeds(speed, rate, gauge_ratio, vehicle, most_mps)
    return TrackCommand(t_ns, speed, rate, asked, loop.voltages(asked, encoders), mode)
