"""The tracker: velocity control along a path, slip-compensated track speeds, motor loops.

It follows a ``SmoothPath`` with the curvature of the path fed forward and a lateral and a
heading error fed back (Samson's form: w = v kappa - k1 v e sinc(a) - k2 |v| a), at the speed
that curvature, clearance, the motors and the braking distance allow; turns on the spot where
the path asks for it; goes rear first where it is told to; and stands still in the goal's
tolerance. Body velocities become track speeds with the estimated gauge ratio, so that slip is
made good before it happens.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.config import EncoderConfig, MotorConfig, TrackerConfig, VehicleConfig
from simloop.ekf import GAUGE
from simloop.geometry.se2 import about_face, wrap_angle
from simloop.messages import EncoderReading, Estimate, FloatArray, SmoothPath, TrackCommand

_SEARCH_M = 0.5  # how far along the path the nearest point may have moved since last time
_LEAST_MPS = 0.05  # while a path is followed: no dead start
_LONG_AGO = 1.5e9  # ns for each s of a period: counts that took longer tell of no one period
YAW, CURVATURE, ARC, SPEED = range(2, 6)  # columns of a path in the kernels, after x and y


class TrackingLaw(NamedTuple):
    """Constants of the control law: limits, gains, and the most that a period may change."""

    max_rate: float
    speed_up: float
    slow_down: float
    turn: float
    lateral_gain: float
    heading_gain: float
    turn_gain: float
    turn_on_spot: float
    end_turn: float


class DriveLaw(NamedTuple):
    """Constants of the motor loops and of the tracks that they turn; SI units throughout."""

    gauge: float
    radius: float
    most_mps: float
    period: float
    rad_a_count: float
    gain: float
    error_limit: float
    back_emf: float
    friction_v: float
    supply_v: float


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
def nearest_sample(path: FloatArray, x: float, y: float, start: int) -> int:
    """Index of the sample of a path (k, 6) nearest to (x, y), from ``start`` ``_SEARCH_M`` on."""
    best, found = 1e18, start
    for i in range(start, path.shape[0]):
        if path[i, ARC] - path[start, ARC] > _SEARCH_M:
            break
        d = (path[i, 0] - x) ** 2 + (path[i, 1] - y) ** 2
        if d < best:
            best, found = d, i
    return found


@njit(cache=True)
def slew(speed: float, rate: float, law: TrackingLaw, asked: FloatArray) -> None:
    """Move ``asked`` (2,), m/s and rad/s, towards a velocity as far as one period may bring it."""
    rate = min(max(rate, -law.max_rate), law.max_rate)
    step = law.speed_up if abs(speed) > abs(asked[0]) else law.slow_down
    asked[0] += min(max(speed - asked[0], -step), step)
    asked[1] += min(max(rate - asked[1], -law.turn), law.turn)


@njit(cache=True)
def along(
    path: FloatArray, i: int, x: float, y: float, off_heading: float, law: TrackingLaw
) -> tuple[float, float]:
    """Speed and yaw rate that lead from (x, y) onto a path (k, 6) and along it; i: nearest sample.

    off_heading: the robot's heading less the path's, rad.
    """
    cos, sin = math.cos(path[i, YAW]), math.sin(path[i, YAW])
    aside = -sin * (x - path[i, 0]) + cos * (y - path[i, 1])
    past_end = cos * (x - path[i, 0]) + sin * (y - path[i, 1])
    if i + 1 < path.shape[0]:  # the profile a control period ahead, and no dead start
        speed = max(min(path[i, SPEED], path[i + 1, SPEED]), _LEAST_MPS)
    elif past_end > 0.0:
        return 0.0, 0.0
    else:
        speed = _LEAST_MPS
    sinc = math.sin(off_heading) / off_heading if abs(off_heading) > 1e-6 else 1.0
    rate = speed * path[i, CURVATURE]
    rate -= speed * (law.lateral_gain * aside * sinc + law.heading_gain * off_heading)
    return speed * max(0.0, math.cos(off_heading)), rate


@njit(cache=True)
def track(
    pose: FloatArray, path: FloatArray, at: int, turning: bool, law: TrackingLaw, asked: FloatArray
) -> tuple[float, float, int, bool]:
    """One period along a path: speed and yaw rate to ask for, nearest sample, whether it turns.

    pose: x, y, yaw first; path: (k, 6), see ``Tracker.follow``; at, turning: those of a period
    ago. asked: (2,) the velocity asked for then, which becomes the one asked for now.
    """
    x, y = pose[0], pose[1]
    at = nearest_sample(path, x, y, at)
    ahead = min(at + 1, path.shape[0] - 1)
    off_heading = wrap_angle(pose[2] - path[ahead, YAW])
    turning = abs(off_heading) > (law.end_turn if turning else law.turn_on_spot)
    if turning:
        slew(0.0, -law.turn_gain * off_heading, law, asked)
    else:
        speed, rate = along(path, at, x, y, off_heading, law)
        slew(speed, rate, law, asked)
    return asked[0], asked[1], at, turning


@njit(cache=True)
def sprocket_speeds(
    speed: float, yaw_rate: float, gauge_m: float, most_mps: float, radius_m: float
) -> tuple[float, float]:
    """Left and right sprocket speeds, rad/s, that give a body velocity in spite of slip.

    gauge_m: the effective one, slip included. Where a track would be faster than ``most_mps``,
    both are scaled: the path's curvature is kept.
    """
    half = 0.5 * gauge_m * yaw_rate
    left, right = speed - half, speed + half
    scale = min(1.0, most_mps / max(abs(left), abs(right), 1e-9)) / radius_m
    return left * scale, right * scale


@njit(cache=True)
def motor_voltage(asked: float, come: int, side: int, law: DriveLaw, errors: FloatArray) -> float:
    """V that make a sprocket turn as asked, rad/s: the motor's law ahead, counts fed back.

    come: the counts since a period ago. errors: (2,) of both sides, rad. An error is kept as an
    angle (what was asked for less the counts that came), which is an integral of the speed error
    that quantisation cannot disturb.
    """
    if asked == 0.0:
        errors[side] = 0.0
        return 0.0
    error = errors[side] + asked * law.period - come * law.rad_a_count
    errors[side] = error = min(max(error, -law.error_limit), law.error_limit)
    # Gear friction needs its current whenever the sprocket turns.
    volts = law.back_emf * asked + math.copysign(law.friction_v, asked) + law.gain * error
    return min(max(volts, -law.supply_v), law.supply_v)


@njit(cache=True)
def drive(
    speed: float,
    yaw_rate: float,
    gauge_ratio: float,
    left_come: int,
    right_come: int,
    law: DriveLaw,
    errors: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Sprocket speeds, rad/s, and motor voltages, (2,) each, that bring a body velocity.

    left_come, right_come: the encoders' counts since a period ago; errors: (2,) the loops' own.
    """
    gauge_m = min(max(gauge_ratio, 1.0), 2.0) * law.gauge
    left, right = sprocket_speeds(speed, yaw_rate, gauge_m, law.most_mps, law.radius)
    speeds, volts = np.empty(2), np.empty(2)
    speeds[0], speeds[1] = left, right
    volts[0] = motor_voltage(left, left_come, 0, law, errors)
    volts[1] = motor_voltage(right, right_come, 1, law, errors)
    return speeds, volts


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
        self._goal = (float(goal[0]), float(goal[1]))
        self._tolerance_m = goal_tolerance_m
        self._arrive_m = max(0.5 * goal_tolerance_m, goal_tolerance_m - config.goal_margin_m)
        self._law = TrackingLaw(
            max_rate=config.max_yaw_rate_radps,
            speed_up=config.max_accel_mps2 * period_s,
            # Twice what is planned with: room for correction.
            slow_down=2.0 * config.max_decel_mps2 * period_s,
            turn=config.max_yaw_accel_radps2 * period_s,
            lateral_gain=config.lateral_gain_1pm2,
            heading_gain=config.heading_gain_1pm,
            turn_gain=config.turn_gain_1ps,
            turn_on_spot=config.turn_on_spot_rad,
            end_turn=config.end_turn_rad,
        )
        self._path: SmoothPath | None = None
        self._samples = np.empty((0, 6))
        self._at = 0
        self._asked = np.zeros(2)
        self.arrived = False
        self.turning = self.reverses = False

    def aim_at(self, goal: FloatArray) -> None:
        """The goal (2,) is there now; it moves, so that to be near is not to stay near."""
        self._arrive_m = 0.5 * self._tolerance_m
        self._goal = (float(goal[0]), float(goal[1]))

    @property
    def path(self) -> SmoothPath | None:
        """The path that is being followed."""
        return self._path

    @property
    def ahead(self) -> slice:
        """The samples of the path that are still to come."""
        return slice(self._at, None)

    @property
    def path_yaw(self) -> float:
        """rad, in map: where the path leads from here. There must be a path."""
        return float(self._samples[min(self._at + 1, len(self._samples) - 1), YAW])

    def follow(self, path: SmoothPath, gauge_ratio: float, reverses: bool = False) -> None:
        """Follow ``path`` from now on. gauge_ratio: the estimated k of the tracks.

        reverses: rear first; ``reverses`` may be changed on the way.
        """
        self.reverses = reverses
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
        profile = speed_profile(
            path.arc_m, path.curvature_1pm, path.clearance_m, self._safe, limits
        )
        self._path, self._at = path, 0
        self._samples = np.column_stack(
            (path.xy_m, path.yaw_rad, path.curvature_1pm, path.arc_m, profile)
        )

    def hold(self) -> None:
        """Forget the path and stand still."""
        self._path = None

    def velocity(self, estimate: Estimate) -> tuple[float, float, str]:
        """Speed, yaw rate and mode to ask for now, acceleration limits kept."""
        state, asked = estimate.state, self._asked
        if math.dist((state[0], state[1]), self._goal) <= self._arrive_m:
            self.arrived = True
        if self.arrived or self._path is None:
            slew(0.0, 0.0, self._law, asked)
            return float(asked[0]), float(asked[1]), "arrived" if self.arrived else "stop"
        ahead = about_face(state) if self.reverses else state
        asked[0] *= -1.0 if self.reverses else 1.0
        _, rate, self._at, self.turning = track(
            ahead, self._samples, self._at, self.turning, self._law, asked
        )
        asked[0] *= -1.0 if self.reverses else 1.0
        return float(asked[0]), rate, "turn" if self.turning else "follow"

    def overrule(self, speed: float, rate: float) -> None:
        """Tell that another velocity was asked for in the end: the limits go on from there."""
        self._asked[:] = speed, rate


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
        self._law = DriveLaw(
            gauge=vehicle.gauge_m,
            radius=vehicle.sprocket_radius_m,
            most_mps=config.max_track_speed_mps,
            period=period_s,
            rad_a_count=2.0 * math.pi / encoder.counts_per_turn,
            gain=config.angle_gain_v_per_rad,
            error_limit=config.angle_error_limit_rad,
            back_emf=motor.back_emf_v_per_radps,
            friction_v=motor.resistance_ohm * motor.no_load_current_a,
            supply_v=motor.supply_v,
        )
        self._errors = np.zeros(2)
        self._last: EncoderReading | None = None
        self._asked: list[float] = [0.0, 0.0]

    def command(
        self,
        velocity: tuple[float, float, str],
        estimate: Estimate,
        encoders: EncoderReading,
        heard: tuple[bool, bool] = (True, True),
    ) -> TrackCommand:
        """The command for a speed, m/s, a yaw rate, rad/s, and the mode they came from.

        heard: whether the left and the right encoder are to be believed; a loop whose encoder is
        not is left open, and its motor gets what its law says. So is one whose counts have not
        come: it would take them for a belt that stands, and drive it too fast.
        """
        speed, rate, mode = velocity
        first, last, self._last = self._last is None, self._last or encoders, encoders
        come = [
            encoders.left_counts - last.left_counts,
            encoders.right_counts - last.right_counts,
        ]
        came = first or 0 < encoders.t_ns - last.t_ns < _LONG_AGO * self._law.period
        for side in range(2):
            if not (heard[side] and came):
                self._errors[side] = 0.0
                come[side] = round(self._asked[side] * self._law.period / self._law.rad_a_count)
        speeds, volts = drive(
            speed, rate, estimate.state[GAUGE], come[0], come[1], self._law, self._errors
        )
        self._asked = speeds.tolist()
        return TrackCommand(estimate.t_ns, speed, rate, speeds, volts, mode)
