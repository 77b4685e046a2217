"""Measure the robot's stopping distance, and compare it with what the collision monitor assumes.

    python scripts/measure_stopping.py

The robot stops from a steady motion in the simulated plant, with the motor control of a run. The
exit code is 0 if it never goes farther than the monitor assumes.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.cli.edge import run_script
from simloop.control.drive import Drive
from simloop.ekf import GAUGE
from simloop.messages import EncoderReading, Estimate, FloatArray, Mode, Velocity
from simloop.physics.plant import Plant
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.sensors import Encoders

_STEADY_S, _STOP_S = 2.0, 3.0
_GAUGE_RATIO = 1.23
CASES = {
    "straight, 0.47 m/s": (0.47, 0.0),
    "a bend, 0.35 m/s and 0.6 rad/s": (0.35, 0.6),
    "on the spot, 1.6 rad/s": (0.0, 1.6),
    "backwards, 0.12 m/s": (-0.12, 0.0),
}
FRICTIONS = (0.9, 0.6, 0.3, 0.1)


def stop(speed: float, rate: float, friction: float, silent: bool = False) -> FloatArray:
    """Stop the robot once.

    Args:
        speed: steady speed before the stop, m/s.
        rate: steady yaw rate before the stop, rad/s.
        friction: coefficient of friction of the ground.
        silent: whether the encoders give no counts in the last 0.3 s before the stop.

    Returns:
        (4,) speed, m/s, and yaw rate, rad/s, at the stop command; then distance, m, and turn, rad.
    """
    scenario = load("open", [f"tracks.friction={friction}"])
    config = scenario.config
    plant = Plant(build_world(scenario).model, config)
    truth, period = plant.reset(np.array([0.0, 0.0, 0.0])), config.rates.control_s
    drive = Drive(config.drive, config.motor, config.encoder, config.vehicle, period)
    # The filter is left out: the motor control gets the gauge ratio that it would learn.
    encoders, state = Encoders(config.encoder), np.zeros(9)
    state[GAUGE] = _GAUGE_RATIO
    heard: EncoderReading = encoders.read(truth)
    ticks, at = round(_STEADY_S / period), None
    way = turn = 0.0
    for tick in range(ticks + round(_STOP_S / period)):
        # First a soft start, then the command to stop.
        part = min(1.0, 4.0 * tick / ticks) if tick < ticks else 0.0
        fresh = encoders.read(truth)
        heard = heard if silent and ticks - 0.3 / period < tick else fresh
        asked = Velocity(part * speed, part * rate)
        sent = drive.command(asked, Mode.FOLLOW, Estimate(truth.t_ns, state, np.eye(9)), heard)
        if tick == ticks:
            at = truth
        truth = plant.step(sent.voltage_v)
        if at is not None:
            way += period * math.hypot(*truth.velocity_body[:2].tolist())
            turn += period * abs(float(truth.velocity_body[5]))
    assert at is not None
    return np.array([at.velocity_body[0], at.velocity_body[5], way, turn])


def assumed(speed: float, rate: float) -> tuple[float, float]:
    """Compute the stop that the collision monitor assumes.

    Args:
        speed: speed before the stop, m/s.
        rate: yaw rate before the stop, rad/s.

    Returns:
        Distance, m, and turn, rad.
    """
    config = load("open").config
    drive, reaction_s = config.drive, config.monitor.reaction_s
    braking = max(abs(speed) / drive.max_decel_mps2, abs(rate) / drive.max_yaw_accel_radps2)
    lasts = reaction_s + 0.5 * braking
    return abs(speed) * lasts, abs(rate) * lasts


def main() -> int:
    """Measure all cases and print them.

    Returns:
        The exit code.
    """
    good = True
    for name, (speed, rate) in CASES.items():
        most = assumed(speed, rate)
        print(f"{name}: assumed {1e3 * most[0]:.0f} mm, {math.degrees(most[1]):.1f} deg")
        for friction in FRICTIONS:
            for silent in (False, True) if rate == 0.0 else (False,):
                was, turning, way, turn = stop(speed, rate, friction, silent)
                good &= bool(way <= most[0] + 0.004 and turn <= most[1] + 0.01)
                print(
                    f"  friction {friction}{', no counts' if silent else ''}: "
                    f"from {was:.2f} m/s, {turning:.2f} rad/s "
                    f"{1e3 * way:.0f} mm, {math.degrees(turn):.1f} deg"
                )
    return 0 if good else 1


if __name__ == "__main__":
    run_script(main)
