"""Check turning on the spot, steady turns, the turning moment, and payloads."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simloop.certify.checks import Check, absolute, relative
from simloop.certify.rig import Bench, Rig
from simloop.certify.rig_parts import RADIUS_M
from simloop.physics import turning_theory

MODULUS_M = 0.001
_CORNERS = (
    (0.7, 10, 0.2, 12.0, 0.005),
    (0.7, 4, 1.0, 0.5, 0.001),
    (2.5, 10, 1.0, 12.0, 0.001),
    (2.5, 5, 0.2, 0.5, 0.005),
)
"""L/B, wheels a side, friction, sprocket speed, rad/s, and step, s: several limits at once."""


def _spun(rig: Rig, sprocket_radps: float = 4.0) -> Bench:
    """Turn a rig on the spot until its motion is steady."""
    bench = rig.build()
    belt = sprocket_radps * RADIUS_M
    bench.run_belts(-belt, belt)
    bench.drive((0.0, 0.0), max(1.0, 1.6 / abs(sprocket_radps)))
    return bench


def spin() -> Iterator[Check]:
    """Check that chi on the spot follows from B F = 2 m (form 2).

    Yields:
        Checks of chi, within 0.5 % for the shipped vehicle and 1 % for others.
    """
    ours = turning_theory.spin_ratio(0.415, 0.39)
    for friction in (0.2, 0.4, 0.6, 0.8, 1.0):
        chi = _spun(Rig(friction=friction)).spin_ratio()
        yield relative("spin", f"mu {friction}", chi, ours, 0.005)
    for speed in (0.5, 1.0, 2.0, 6.0, 12.0):
        chi = _spun(Rig(), speed).spin_ratio()
        yield relative("spin", f"sprockets {speed} rad/s", chi, ours, 0.005)
    for step in (0.001, 0.0025, 0.005):
        chi = _spun(Rig(step_s=step)).spin_ratio()
        yield relative("spin", f"step {step * 1e3:g} ms", chi, ours, 0.005)
    for wheels in (4, 5, 7, 8, 10):
        chi = _spun(Rig(wheels=wheels)).spin_ratio()
        yield relative("spin", f"{wheels} road wheels a side", chi, ours, 0.01)
    for ratio in (0.7, 1.0, 1.25, 1.5, 1.7, 2.0, 2.5):
        length = ratio * 0.39
        chi = _spun(Rig(length_m=length)).spin_ratio()
        yield relative("spin", f"L/B {ratio}", chi, turning_theory.spin_ratio(length, 0.39), 0.01)
    yield relative("spin", "clockwise", _spun(Rig(), -4.0).spin_ratio(), ours, 0.005)
    for ratio, wheels, friction, speed, step in _CORNERS:
        length = ratio * 0.39
        rig = Rig(length_m=length, wheels=wheels, friction=friction, step_s=step)
        name = f"{wheels} wheels, L/B {ratio}, mu {friction}, {speed:g} rad/s, {step * 1e3:g} ms"
        chi = _spun(rig, speed).spin_ratio()
        yield relative("spin", name, chi, turning_theory.spin_ratio(length, 0.39), 0.01)


def _turns() -> Iterator[tuple[str, Rig, tuple[float, float]]]:
    """List steady turns: name, rig and belt speeds, m/s. Most have the same ratio of belts."""
    for inner in (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 0.9):
        yield f"inner/outer {inner:g}", Rig(), (inner * 0.12, 0.12)
    belts = (0.03, 0.12)
    yield "to the right", Rig(), belts[::-1]
    yield "backwards", Rig(), (-belts[0], -belts[1])
    yield "backwards, to the right", Rig(), (-belts[1], -belts[0])
    for friction in (0.2, 0.4, 0.8, 1.0):
        yield f"mu {friction}", Rig(friction=friction), belts
    for sprocket in (0.5, 12.0):
        yield f"outer sprocket {sprocket:g} rad/s", Rig(), (0.009 * sprocket, 0.037 * sprocket)
    for step in (0.001, 0.005):
        yield f"step {step * 1e3:g} ms", Rig(step_s=step), belts
    for wheels in (4, 10):
        yield f"{wheels} road wheels a side", Rig(wheels=wheels), belts
    for ratio in (0.7, 1.7, 2.5):
        yield f"L/B {ratio}", Rig(length_m=ratio * 0.39), belts


def steady() -> Iterator[Check]:
    """Check that steady turns follow from two balances of forces and one of moments (form 3).

    Yields:
        Checks of yaw rate and speed.
    """
    for name, rig, belts in _turns():
        bench, outer = rig.build(), max(map(abs, belts))
        bench.run_belts(*belts)
        bench.drive((0.0, 0.0), max(2.0, 0.3 / outer))
        v_x, _, yaw_rate = turning_theory.steady_turn(belts, bench.cells(), rig.friction, MODULUS_M)
        got_x, _, got_rate = bench.motion()
        yield relative("steady turn", f"{name}: yaw rate", got_rate, yaw_rate, 0.02, "rad/s")
        yield absolute("steady turn", f"{name}: speed", got_x, v_x, 0.02 * outer, "m/s")


def sideways() -> Iterator[Check]:
    """Check that belts with sideways slip only resist a turn with mu W L/4 (form 4).

    The form uses Coulomb's law, so the shear modulus is a fifth of the usual one. Otherwise the
    shear that builds up over the first millimetres would change the moment.

    Yields:
        Checks of the moment.
    """
    stiff = 0.2 * MODULUS_M
    for ratio, wheels, friction in ((0.7, 6, 0.6), (1.06, 4, 0.2), (1.06, 10, 1.0), (2.5, 6, 0.6)):
        rig = Rig(length_m=ratio * 0.39, wheels=wheels, friction=friction, shear_modulus_m=stiff)
        bench = rig.build()
        for rate in (0.5, -0.5):
            moment = bench.swing(rate, 1.0)
            most = turning_theory.sideways_moment(friction, bench.weight_n, rig.length_m)
            name = f"L/B {ratio}, {wheels} wheels, mu {friction}, {rate:g} rad/s"
            expected = -most if rate > 0.0 else most
            yield relative("turning moment", name, moment, expected, 0.02, "N m")


def payload() -> Iterator[Check]:
    """Check that a payload shifts the wheel loads and the centres of rotation (form 3).

    Yields:
        Checks of loads against beam statics, and of the centres.
    """
    for place in ((0.1, 0.0, 0.1), (-0.12, 0.05, 0.1), (0.05, -0.12, 0.1)):
        rig = Rig(payload_kg=4.0, payload_m=place)
        bench = rig.build()
        name = f"4 kg at ({place[0]:g}, {place[1]:g})"
        centre, loads = bench.centre_m, bench.plant.tracks.load.copy()
        x = rig.support_x()
        places = np.array([(at, side * 0.195) for side in (1, -1) for at in x])
        expected = turning_theory.support_loads(places, bench.weight_n, (centre[0], centre[1]))
        worst = float(np.abs(loads - expected).max() / expected.mean())
        yield absolute("payload", f"{name}: wheel loads, worst", worst, 0.0, 0.02)
        yield relative("payload", f"{name}: total load", loads.sum(), bench.weight_n, 0.001, "N")
        cells = bench.cells()
        bench.run_belts(0.02, 0.12)
        bench.drive((0.0, 0.0), 3.0)
        motion = turning_theory.steady_turn(
            (0.02, 0.12), cells, rig.friction, MODULUS_M, centre_x_m=float(centre[0])
        )
        want = turning_theory.icr_positions(motion[:2], motion[2], (0.02, 0.12))
        v_x, v_y, rate = bench.motion()
        got = turning_theory.icr_positions((v_x, v_y), rate, bench.belts_mps())
        for label, one, other in zip(("y left", "y right", "x"), got, want, strict=True):
            yield absolute("payload", f"{name}: ICR {label}", one, other, 0.02 * 0.415, "m")
