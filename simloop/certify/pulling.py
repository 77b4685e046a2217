"""Check slip curve, bollard pull, stall, current limit, motor speed and coasting."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from simloop.certify.checks import Check, absolute, at_most, relative
from simloop.certify.rig import Bench, Rig
from simloop.certify.rig_parts import RADIUS_M
from simloop.config import MotorConfig
from simloop.physics import track_theory as theory

MODULUS_M = 0.001
_BELT_MPS = 0.2


def straight() -> Iterator[Check]:
    """Check that v = r w on level ground, with almost no slip (form 1).

    Yields:
        Checks of speed and drift.
    """
    for speed in (0.5, 3.0, 12.0):
        bench = Rig().build()
        bench.run_belts(speed * RADIUS_M, speed * RADIUS_M)
        bench.drive((0.0, 0.0), 1.5)
        expected = theory.ground_speed(RADIUS_M, speed, 0.0)
        yield relative("straight", f"{speed} rad/s", bench.motion()[0], expected, 0.001, "m/s")
        yield at_most("straight", f"{speed} rad/s: drift", abs(bench.motion()[1]), 1e-4, "m/s")


def slip_curve() -> Iterator[Check]:
    """Check that pull over slip is the Janosi-Hanamoto curve (form 5).

    Yields:
        Checks of the slip under a towing force, and of the pull on a winch of constant speed.
    """
    for share in (0.2, 0.5, 0.8, 0.95):
        bench = Rig(open_circuit=True).build()
        bench.run_belts(_BELT_MPS, _BELT_MPS)
        bench.tow(-share * 0.6 * bench.weight_n)
        bench.drive((0.0, 0.0), 4.0)
        slip = _slip(bench)
        expected = theory.slip_at_drawbar(share, 0.415, MODULUS_M)
        yield relative("slip curve", f"towed by {share} mu W: slip", slip, expected, 0.02)
    for slip in (0.001, 0.003, 0.01, 0.03, 0.1, 0.5):
        for wheels in (6,) if slip != 0.01 else (4, 6, 10):
            pull, got = _winched(Rig(wheels=wheels, open_circuit=True), slip)
            expected = theory.drawbar_ratio(got, 0.415, MODULUS_M)
            name = f"winch, slip {slip}, {wheels} wheels: pull / mu W"
            yield relative("slip curve", name, pull, expected, 0.02)
    for name, rig, slip, belt in _other_winches():
        pull, got = _winched(rig, slip, belt)
        expected = theory.drawbar_ratio(got, 0.415, MODULUS_M)
        yield relative("slip curve", f"{name}: winch, slip {slip}", pull, expected, 0.02)


def _other_winches() -> Iterator[tuple[str, Rig, float, float]]:
    """List further winch conditions: name, rig, slip and belt speed, m/s."""
    for slip in (-0.003, -0.03, -0.5):
        yield "pushed", Rig(open_circuit=True), slip, _BELT_MPS
    for slip in (0.01, -0.01):
        yield "backwards", Rig(open_circuit=True), slip, -_BELT_MPS
    for friction in (0.2, 1.0):
        yield f"mu {friction}", Rig(friction=friction, open_circuit=True), 0.01, _BELT_MPS
    for sprocket in (1.0, 12.0):
        yield f"{sprocket:g} rad/s", Rig(open_circuit=True), 0.01, sprocket * RADIUS_M
    for step in (0.001, 0.005):
        yield f"step {step * 1e3:g} ms", Rig(step_s=step, open_circuit=True), 0.01, _BELT_MPS


def _winched(rig: Rig, slip: float, belt_mps: float = _BELT_MPS) -> tuple[float, float]:
    """Measure pull over mu W along the belts, and slip, at a constant vehicle speed."""
    bench = rig.build()
    bench.run_belts(belt_mps, belt_mps)
    bench.hold(belt_mps * (1.0 - slip), max(4.0, 0.8 / abs(belt_mps)))
    pull = math.copysign(1.0, belt_mps) * float(bench.plant.tracks.track_force.sum())
    return pull / (rig.friction * bench.weight_n), _slip(bench)


def _slip(bench: Bench) -> float:
    return 1.0 - 2.0 * bench.motion()[0] / sum(bench.belts_mps())


def bollard() -> Iterator[Check]:
    """Check that a tethered vehicle pulls mu W, or what the current limit allows (forms 5, 7).

    Yields:
        Checks of pull, torque and current.
    """
    motor, rolling = MotorConfig(), 0.02
    for friction in (0.2, 0.5, 0.8, 1.0):
        bench = Rig(friction=friction).build()
        bench.drive((24.0, 24.0), 1.0, _rope)
        pull = float(bench.plant.tracks.track_force.sum())
        most = friction * bench.weight_n * theory.drawbar_ratio(1.0, 0.415, MODULUS_M)
        yield relative("bollard", f"mu {friction}: pull", pull, most, 0.02, "N")
        torque = motor.torque_nm_per_a * bench.truth.motor_current_a[0]
        loss = motor.no_load_current_a * motor.torque_nm_per_a
        slips = theory.slipping_torque(friction, 0.5 * bench.weight_n, RADIUS_M)
        needed = slips + loss + rolling * 0.5 * bench.weight_n * RADIUS_M
        yield relative("bollard", f"mu {friction}: sprocket torque", torque, needed, 0.02, "N m")
    for volts, limit in ((2.0, 5.0), (24.0, 5.0)):
        rig = Rig(friction=2.0, payload_kg=10.0, payload_m=(0.0, 0.0, 0.1))
        bench = rig.build()
        # The voltage rises slowly, so the vehicle does not swing back on the rope. If it did, gear
        # friction would push instead of brake.
        for share in np.linspace(0.1, 1.0, 10):
            bench.drive((share * volts, share * volts), 0.3, _rope)
        bench.drive((volts, volts), 3.0, _rope)
        loss = motor.no_load_current_a * motor.torque_nm_per_a
        loss += rolling * 0.5 * bench.weight_n * RADIUS_M
        force = theory.stall_force(
            volts, motor.resistance_ohm, motor.torque_nm_per_a, limit, loss, RADIUS_M
        )
        pull = 0.5 * float(bench.plant.tracks.track_force.sum())
        yield relative("stall", f"{volts:g} V: force a track", pull, force, 0.02, "N")
        current = min(volts / motor.resistance_ohm, limit)
        got = float(bench.truth.motor_current_a[0])
        yield relative("stall", f"{volts:g} V: current", got, current, 0.001, "A")


def _rope(bench: Bench) -> None:
    """Hold base_link with a spring and a damper that are almost rigid."""
    x, v = bench.truth.pose_xyyaw[0], bench.motion()[0]
    bench.tow(-8000.0 * x - 600.0 * v)


def motors() -> Iterator[Check]:
    """Check that motors reach their theoretical speed, and stop when shorted (form 7).

    Yields:
        Checks of speed, current and energy.
    """
    motor = MotorConfig()
    for volts in (6.0, 12.0, 24.0):
        bench = Rig().build()
        bench.drive((volts, volts), 3.0)
        load = motor.no_load_current_a * motor.torque_nm_per_a
        load += 0.02 * 0.5 * bench.weight_n * RADIUS_M
        speed = theory.motor_speed(
            volts, load, motor.resistance_ohm, motor.torque_nm_per_a, motor.back_emf_v_per_radps
        )
        got = float(bench.truth.sprocket_radps.mean())
        yield relative("motor", f"{volts:g} V: sprocket speed", got, speed, 0.005, "rad/s")
    bench.drive((0.0, 0.0), 2.0)
    still = float(np.abs(bench.truth.velocity_body).max())
    yield at_most("motor", "shorted for 2 s: speed", still, 1e-4, "m/s")
    current = float(np.abs(bench.truth.motor_current_a).max())
    yield at_most("at rest", "current", current, 1e-4, "A")
    before = bench.truth.energy_j
    bench.drive((0.0, 0.0), 2.0)
    yield absolute("at rest", "energy drawn in 2 s", bench.truth.energy_j - before, 0.0, 1e-6, "J")


def free_wheels() -> Iterator[Check]:
    """Check J dw/dt = k I - friction in the air, the no-load speed, and coasting (form 7).

    Yields:
        Checks of acceleration, no-load speed and current, and of deceleration without current.
    """
    motor = MotorConfig()
    gear = motor.no_load_current_a * motor.torque_nm_per_a
    for volts in (24.0, -24.0):
        bench = Rig(floor=False).build()
        inertia = bench.sprocket_inertia_kgm2()
        bench.drive((volts, volts), 0.03)
        torque = motor.torque_nm_per_a * motor.current_limit_a - gear
        expected = math.copysign(torque / inertia * 0.03, volts)
        got = float(bench.truth.sprocket_radps[0])
        name = f"{volts:g} V: at the current's limit for 30 ms"
        yield relative("free wheels", name, got, expected, 0.02, "rad/s")
        bench.drive((volts, volts), 1.0)
        speed = theory.motor_speed(
            24.0, gear, motor.resistance_ohm, motor.torque_nm_per_a, motor.back_emf_v_per_radps
        )
        got = abs(float(bench.truth.sprocket_radps[0]))
        yield relative("free wheels", f"{volts:g} V: no-load speed", got, speed, 0.005, "rad/s")
        current = abs(float(bench.truth.motor_current_a[0]))
        expected = motor.no_load_current_a
        yield relative("free wheels", f"{volts:g} V: no-load current", current, expected, 0.01, "A")
    for rolling in (0.0, 0.02, 0.1):
        bench = Rig(open_circuit=True, rolling_resistance=rolling).build()
        inertia = bench.sprocket_inertia_kgm2()
        bench.push_off(0.45)
        bench.drive((0.0, 0.0), 0.1)
        before = bench.motion()[0]
        bench.drive((0.0, 0.0), 0.2)
        drag = 2.0 * gear / RADIUS_M + rolling * bench.weight_n
        expected = drag / (bench.mass_kg + 2.0 * inertia / RADIUS_M**2)
        name = f"coasting, rolling resistance {rolling}"
        got = (before - bench.motion()[0]) / 0.2
        yield relative("free wheels", name, got, expected, 0.02, "m/s2")
