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
    """Voltage that makes one sprocket turn as asked: the motor's law ahead, counts fed back.

    The error is kept as an angle (what was asked for less the counts that came), which is an
    integral of the speed error that quantisation cannot disturb.
    """

    def __init__(
        self, config: TrackerConfig, motor: MotorConfig, encoder: EncoderConfig, period_s: float
    ) -> None:
        self._gain, self._limit = config.angle_gain_v_per_rad, config.angle_error_limit_rad
        self._motor, self._period_s = motor, period_s
        self._rad_a_count = 2.0 * math.pi / encoder.counts_per_turn
        self._error = 0.0
        self._counts: int | None = None

    def voltage(self, asked_radps: float, counts: int) -> float:
        """V for the sprocket speed asked, rad/s, given the encoder's count."""
        motor, come = self._motor, counts - (counts if self._counts is None else self._counts)
        self._counts = counts
        if asked_radps == 0.0:
            self._error = 0.0
            return 0.0
        error = self._error + asked_radps * self._period_s - come * self._rad_a_count
        self._error = min(max(error, -self._limit), self._limit)
        # Gear friction needs its current whenever the sprocket turns.
        friction_v = math.copysign(motor.resistance_ohm * motor.no_load_current_a, asked_radps)
        volts = motor.back_emf_v_per_radps * asked_radps + friction_v + self._gain * self._error
        return min(max(volts, -motor.supply_v), motor.supply_v)


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
) -> tuple[float, float]:
    """Left and right sprocket speeds, rad/s, that give a body velocity in spite of slip.

    Where a track would be faster than ``most_mps``, both are scaled: the path's curvature is kept.
    """
    half = 0.5 * gauge_ratio * vehicle.gauge_m * yaw_rate
    left, right = speed - half, speed + half
    scale = min(1.0, most_mps / max(abs(left), abs(right), 1e-9)) / vehicle.sprocket_radius_m
    return left * scale, right * scale


class Drive:
    """From a body velocity to both motors' voltages, with the slip that the filter has learnt."""

    def __init__(
        self,
        config: TrackerConfig,
        motor: MotorConfig,
        encoder: EncoderConfig,
        vehicle: VehicleConfig,
        period_s: float,
    ) -> None:
        self._vehicle, self._most_mps = vehicle, config.max_track_speed_mps
        self._left = MotorLoop(config, motor, encoder, period_s)
        self._right = MotorLoop(config, motor, encoder, period_s)

    def command(
        self, velocity: tuple[float, float, str], estimate: Estimate, encoders: EncoderReading
    ) -> TrackCommand:
        """The command for a speed, m/s, a yaw rate, rad/s, and the mode they came from."""
        speed, rate, mode = velocity
        gauge_ratio = min(max(float(estimate.state[GAUGE]), 1.0), 2.0)
        left, right = sprocket_speeds(speed, rate, gauge_ratio, self._vehicle, self._most_mps)
        volts = (
            self._left.voltage(left, encoders.left_counts),
            self._right.voltage(right, encoders.right_counts),
        )
        return TrackCommand(
            estimate.t_ns, speed, rate, np.array((left, right)), np.array(volts), mode
        )
