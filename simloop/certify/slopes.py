"""Check slopes up, down and across, braking, and tipping over."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from simloop.certify.checks import Check, absolute, at_most, relative, verdict
from simloop.certify.rig import CONTROL_S, GRAVITY_MPS2, Bench, Rig
from simloop.certify.rig_parts import RADIUS_M
from simloop.config import MotorConfig
from simloop.physics import track_theory as theory
from simloop.physics import turning_theory

CREEP_MPS = 1e-3
MODULUS_M = 0.001
_REARED_RAD = 0.02
_TILT_RADPS = 0.005


def _crept(bench: Bench, seconds: float = 1.0) -> float:
    """Measure the mean speed, m/s, after two seconds in which the rubber takes up the load."""
    bench.drive((0.0, 0.0), 2.0)
    start = bench.truth.position_m.copy()
    bench.drive((0.0, 0.0), seconds)
    return float(np.linalg.norm(bench.truth.position_m - start)) / seconds


def braked() -> Iterator[Check]:
    """Check that brakes hold the vehicle on slopes up to atan(mu) and not beyond (form 6).

    Yields:
        Checks of creep and of acceleration.
    """
    group = "brakes on"
    for friction in (0.2, 0.4, 0.6, 0.8, 1.0):
        limit = theory.holding_angle(friction)
        for share in (0.5, 0.9, 0.98):
            for label, rig in _tilted(friction, share * limit):
                bench = rig.build()
                name = f"mu {friction}, {label}, {share:g} atan(mu): creep"
                yield at_most(group, name, _crept(bench), CREEP_MPS, "m/s")
        for label, rig in _tilted(friction, 1.05 * limit):
            bench = rig.build()
            bench.drive((0.0, 0.0), 0.5)
            before = np.linalg.norm(bench.truth.velocity_body[:3])
            bench.drive((0.0, 0.0), 0.5)
            gain = float(np.linalg.norm(bench.truth.velocity_body[:3]) - before) / 0.5
            expected = theory.sliding_acceleration(friction, 1.05 * limit)
            name = f"mu {friction}, {label}, 1.05 atan(mu): acceleration"
            yield absolute(group, name, gain, expected, 0.02 * friction * GRAVITY_MPS2, "m/s2")


def _tilted(friction: float, angle: float) -> Iterator[tuple[str, Rig]]:
    """Make rigs with brakes on, on one slope in three directions."""
    yield "nose up", Rig(friction=friction, pitch_rad=angle, braked=True)
    yield "nose down", Rig(friction=friction, pitch_rad=-angle, braked=True)
    yield "sideways", Rig(friction=friction, roll_rad=angle, braked=True)


def unpowered() -> Iterator[Check]:
    """Check that the gears alone hold up to W r sin t = 2 T + f W r cos t (form 6).

    Yields:
        Checks below and above that slope.
    """
    motor = MotorConfig()
    gear = motor.no_load_current_a * motor.torque_nm_per_a
    weight = Rig().build().weight_n
    limit = theory.climbing_angle(2.0 * gear / RADIUS_M, weight, -0.02, 1.0)
    for share, holds in ((0.95, True), (1.08, False)):
        speed = _crept(Rig(pitch_rad=share * limit).build())
        yield verdict("motors shorted", f"holds {share:g} of its limit", speed < CREEP_MPS, holds)


def climbing() -> Iterator[Check]:
    """Check that at full current the limit of climbing is that of thrust and grip (form 6).

    Yields:
        Checks below and above the limit.
    """
    motor = MotorConfig()
    for friction in (0.3, 0.6, 0.9):
        weight = 98.1
        gear = motor.no_load_current_a * motor.torque_nm_per_a
        thrust = 2.0 * (motor.torque_nm_per_a * motor.current_limit_a - gear) / RADIUS_M
        limit = theory.climbing_angle(thrust, weight, 0.02, friction)
        for share, climbs in ((0.97, True), (1.03, False)):
            bench = Rig(friction=friction, pitch_rad=share * limit).build()
            bench.drive((24.0, 24.0), 1.0)
            name = f"mu {friction}, {share} of the limit"
            yield verdict("climbing", name, bench.motion()[0] > 0.0, climbs)
    # With a heavy load the limit is the driver's current, not the grip.
    heavy = Rig(friction=1.0, payload_kg=20.0, payload_m=(0.0, 0.0, 0.02))
    weight = heavy.build().weight_n
    thrust = 2.0 * (motor.torque_nm_per_a * (5.0 - motor.no_load_current_a)) / RADIUS_M
    limit = theory.climbing_angle(thrust, weight, 0.02, 1.0)
    for share, climbs in ((0.97, True), (1.03, False)):
        bench = Rig(
            friction=1.0, payload_kg=20.0, payload_m=(0.0, 0.0, 0.02), pitch_rad=share * limit
        ).build()
        bench.drive((24.0, 24.0), 1.5)
        name = f"30 kg, current's limit, {share:g} of it"
        yield verdict("climbing", name, bench.motion()[0] > 0.0, climbs)


def driven() -> Iterator[Check]:
    """Check the shear on slopes: the tracks slip just enough to carry the weight (forms 5, 6).

    The closed form gives the force of the shear for the measured slip and drift.

    Yields:
        Checks of that force along and across the slope.
    """
    for friction in (0.2, 0.6, 1.0):
        for share in (0.5, 0.9):
            for label, rig in _tilted(friction, share * theory.holding_angle(friction)):
                bench = rig.build()
                bench.plant.brake(False)
                bench.run_belts(0.2, 0.2)
                bench.drive_without_yaw(3.0)
                cells, weight = bench.cells(), bench.mass_kg * rig.gravity()[:2]
                motion = np.array(bench.motion())
                belts = bench.belts_mps()
                force = turning_theory.track_forces(motion, belts, cells, friction, MODULUS_M)
                steep = float(np.hypot(*weight))
                name = f"mu {friction}, {label}, {share:g} atan(mu)"
                along = -float(force[:2] @ weight) / steep
                yield relative("driven on slopes", f"{name}: shear", along, steep, 0.02, "N")
                across = float(force[0] * weight[1] - force[1] * weight[0]) / steep**2
                yield absolute("driven on slopes", f"{name}: across it", across, 0.0, 0.02)


def braking() -> Iterator[Check]:
    """Check that locked belts slow the vehicle down by mu g cos t - g sin t (form 6).

    Yields:
        Checks of the deceleration, forwards and backwards, by belts and by brakes.
    """
    for friction in (0.2, 0.5, 0.8, 1.0):
        for pitch in (-0.1, 0.0, 0.1):
            for way, brakes in ((1.0, False), (-1.0, False), (1.0, True), (-1.0, True)):
                bench = Rig(friction=friction, pitch_rad=pitch).build()
                bench.push_off(2.0 * way)
                if brakes:
                    bench.plant.brake(True)
                else:
                    bench.lock_belts()
                bench.drive((0.0, 0.0), 0.05)
                before = bench.motion()[0]
                bench.drive((0.0, 0.0), 0.1)
                got = way * (before - bench.motion()[0]) / 0.1
                expected = -theory.sliding_acceleration(friction, -pitch * way)
                name = f"mu {friction}, slope {pitch:g} rad, {'on' if way > 0.0 else 'back'}wards"
                name += ", brakes put on" if brakes else ", belts locked"
                yield relative("braking", name, got, expected, 0.02, "m/s2")


def tipping() -> Iterator[Check]:
    """Check on a growing slope that tipping over the outer wheels is at tan t = x/h (form 6).

    Yields:
        Checks of that angle over all four sides.
    """
    for label, way in (
        ("nose up", (-1.0, 0.0)),
        ("nose down", (1.0, 0.0)),
        ("left up", (0.0, -1.0)),
        ("right up", (0.0, 1.0)),
    ):
        rig = Rig(friction=1.5, payload_kg=10.0, payload_m=(0.03, 0.02, 0.35), braked=True)
        bench = rig.build()
        centre = bench.centre_m
        edge = np.array([rig.support_x()[0], 0.5 * rig.gauge_m])
        distance = float((edge - np.array(way) * centre[:2]) @ np.abs(way))
        limit = theory.tipping_angle(distance, float(centre[2]))
        angle, reared = 0.9 * limit, False
        while angle < 1.1 * limit and not reared:
            angle += _TILT_RADPS * CONTROL_S
            along = math.sin(angle) * np.array(way)
            gravity = GRAVITY_MPS2 * np.array([*along, -math.cos(angle)])
            bench.plant.model.opt.gravity[:] = gravity
            bench.drive((0.0, 0.0), CONTROL_S)
            reared = np.abs(bench.truth.quaternion_wxyz[1:3]).max() > 0.5 * _REARED_RAD
        yield relative("tipping", f"{label}: angle at which it rears", angle, limit, 0.02, "rad")
