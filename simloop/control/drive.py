"""The drive: from a body velocity to the voltages of both motors.

Body velocities become track speeds with the estimated gauge ratio, so that slip is made good before
it happens; each motor gets what its law asks for and a correction from its encoder.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.config import DriveConfig, EncoderConfig, MotorConfig, VehicleConfig
from simloop.messages import EncoderReading, Estimate, FloatArray, Mode, TrackCommand, Velocity

_LONG_AGO = 1.5e9  # ns for each s of a period: counts that took longer tell of no one period


class DriveLaw(NamedTuple):
    """Constants of the motor loops and of the tracks that they turn.

    Attributes:
        gauge: Distance between the tracks, m.
        radius: Radius of the sprockets, m.
        most_mps: Largest belt speed, m/s.
        period: Control period, s.
        rad_a_count: Angle of one encoder count, rad.
        gain: Voltage per angle error, V/rad.
        error_limit: Largest angle error, rad.
        back_emf: Voltage per speed, V s/rad.
        friction_v: Voltage that overcomes the gears' friction, V.
        supply_v: Voltage of the supply, V.
    """

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
def sprocket_speeds(
    speed: float, yaw_rate: float, gauge_m: float, most_mps: float, radius_m: float
) -> tuple[float, float]:
    """Compute the sprocket speeds that give a body velocity in spite of slip.

    Args:
        speed: Forward speed, m/s.
        yaw_rate: Yaw rate, rad/s.
        gauge_m: The effective gauge, slip included, m (Martinez & Mandow 2005).
        most_mps: Largest belt speed, m/s. Where a track would be faster, both are scaled, and the
            path's curvature is kept.
        radius_m: Radius of the sprockets, m.

    Returns:
        Left and right sprocket speed, rad/s.
    """
    half = 0.5 * gauge_m * yaw_rate
    left, right = speed - half, speed + half
    scale = min(1.0, most_mps / max(abs(left), abs(right), 1e-9)) / radius_m
    return left * scale, right * scale


@njit(cache=True)
def motor_voltage(asked: float, come: int, side: int, law: DriveLaw, errors: FloatArray) -> float:
    """Compute the voltage that makes a sprocket turn as asked.

    The error is kept as an angle: what was asked for less the counts that came. That is an
    integral of the speed error which quantisation cannot disturb.

    Args:
        asked: Sprocket speed, rad/s.
        come: Counts since the last period.
        side: 0 left, 1 right.
        law: Constants.
        errors: (2,) angle errors of both sides, rad; changed in place.

    Returns:
        The voltage, V.
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
    """Compute sprocket speeds and motor voltages for a body velocity.

    Args:
        speed: Forward speed, m/s.
        yaw_rate: Yaw rate, rad/s.
        gauge_ratio: How much wider than its gauge the robot turns; kept within 1 to 2.
        left_come: Counts of the left encoder since the last period.
        right_come: Counts of the right encoder since the last period.
        law: Constants.
        errors: (2,) angle errors of both sides, rad; changed in place.

    Returns:
        (2,) sprocket speeds, rad/s, and (2,) voltages, V, left before right.
    """
    gauge_m = min(max(gauge_ratio, 1.0), 2.0) * law.gauge
    left, right = sprocket_speeds(speed, yaw_rate, gauge_m, law.most_mps, law.radius)
    speeds, volts = np.empty(2), np.empty(2)
    speeds[0], speeds[1] = left, right
    volts[0] = motor_voltage(left, left_come, 0, law, errors)
    volts[1] = motor_voltage(right, right_come, 1, law, errors)
    return speeds, volts


class Drive:
    """Turns a body velocity into both motors' voltages, with the slip that the filter learnt."""

    def __init__(
        self,
        config: DriveConfig,
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
        velocity: Velocity,
        mode: Mode,
        estimate: Estimate,
        encoders: EncoderReading,
        heard: tuple[bool, bool] = (True, True),
    ) -> TrackCommand:
        """Compute the command of one period.

        A loop whose encoder is not believed is left open: its motor gets what its law says. So is
        one whose counts have not come, which it would take for a belt that stands.

        Args:
            velocity: The body velocity.
            mode: What the robot does with it.
            estimate: The belief now, for the gauge ratio.
            encoders: The latest counts.
            heard: Whether the left and the right encoder are believed.

        Returns:
            Sprocket speeds and voltages.
        """
        speed, rate = velocity
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
            speed, rate, estimate.gauge_ratio, come[0], come[1], self._law, self._errors
        )
        self._asked = speeds.tolist()
        return TrackCommand(estimate.t_ns, speed, rate, speeds, volts, mode)
