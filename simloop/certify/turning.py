"""Turning: on the spot, steadily, over friction, speed, step, wheels, proportions and payload."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simloop import track_theory as theory
from simloop.certify.checks import Check, absolute, relative
from simloop.certify.rig import RADIUS_M, Bench, Rig

MODULUS_M = 0.001


def _spun(rig: Rig, sprocket_radps: float = 4.0) -> Bench:
    """A rig that has turned on the spot until nothing changes any more."""
    bench = rig.build()
    belt = sprocket_radps * RADIUS_M
    bench.run_belts(-belt, belt)
    bench.drive((0.0, 0.0), max(1.0, 0.4 / sprocket_radps * 4.0))
    return bench


def spin() -> Iterator[Check]:
    """chi against B F = 2 m (form 2), 0.5 % for our vehicle and 1 % for the others."""
    ours = theory.spin_ratio(0.415, 0.39)
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
        yield relative("spin", f"L/B {ratio}", chi, theory.spin_ratio(length, 0.39), 0.01)


def steady() -> Iterator[Check]:
    """Yaw rate and speed of steady turns against two force balances and one of moments (form 3)."""
    for inner in (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 0.9):
        bench = Rig().build()
        belts = (inner * 0.12, 0.12)
        bench.run_belts(*belts)
        bench.drive((0.0, 0.0), 4.0)
        v_x, _, yaw_rate = theory.steady_turn(belts, bench.cells(), 0.6, MODULUS_M)
        got_x, _, got_rate = bench.motion()
        name = f"inner/outer {inner:g}"
        yield relative("steady turn", f"{name}: yaw rate", got_rate, yaw_rate, 0.02, "rad/s")
        yield absolute("steady turn", f"{name}: speed", got_x, v_x, 0.02 * 0.12, "m/s")


def payload() -> Iterator[Check]:
    """A payload shifts the road wheels' loads (beam statics) and the centres of rotation."""
    for place in ((0.1, 0.0, 0.1), (-0.12, 0.05, 0.1), (0.05, -0.12, 0.1)):
        rig = Rig(payload_kg=4.0, payload_m=place)
        bench = rig.build()
        name = f"4 kg at ({place[0]:g}, {place[1]:g})"
        centre, loads = bench.centre_m, bench.plant.tracks.load.copy()
        x = rig.support_x()
        places = np.array([(at, side * 0.195) for side in (1, -1) for at in x])
        expected = theory.support_loads(places, bench.weight_n, (centre[0], centre[1]))
        worst = float(np.abs(loads - expected).max() / expected.mean())
        yield absolute("payload", f"{name}: wheel loads, worst", worst, 0.0, 0.02)
        yield relative("payload", f"{name}: total load", loads.sum(), bench.weight_n, 0.001, "N")
        cells = bench.cells()
        bench.run_belts(0.02, 0.12)
        bench.drive((0.0, 0.0), 3.0)
        motion = theory.steady_turn(
            (0.02, 0.12), cells, rig.friction, MODULUS_M, centre_x_m=float(centre[0])
        )
        want = theory.icr_positions(motion[:2], motion[2], (0.02, 0.12))
        v_x, v_y, rate = bench.motion()
        got = theory.icr_positions((v_x, v_y), rate, bench.belts_mps())
        for label, one, other in zip(("y left", "y right", "x"), got, want, strict=True):
            yield absolute("payload", f"{name}: ICR {label}", one, other, 0.02 * 0.415, "m")
