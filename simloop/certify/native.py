"""Compare with the same vehicle under MuJoCo's own friction on moving surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from simloop.certify.checks import Check, absolute, relative
from simloop.certify.rig import Rig
from simloop.certify.rig_parts import RADIUS_M
from simloop.physics import turning_theory


def native() -> Iterator[Check]:
    """Show that a vehicle with ``surfacevel`` on its road wheels turns too slowly, and hops.

    Yields:
        Informative checks of spin ratio and vertical speed.
    """
    expected = turning_theory.spin_ratio(0.415, 0.39)
    for friction in (0.4, 0.7):
        for sprocket in (1.0, 4.0, 10.0):
            belt = sprocket * RADIUS_M
            # A friction of almost 0 switches off the tracks' own shear.
            rig = Rig(friction=friction, native_belts_mps=(-belt, belt))
            bench = rig.build(own_friction=1e-9)
            bench.lock_belts()
            bench.drive((0.0, 0.0), 1.0)
            rates, rises = [], []
            for _ in range(200):
                bench.drive((0.0, 0.0), 0.01)
                rates.append(bench.motion()[2])
                rises.append(float(bench.truth.velocity_body[2]))
            chi = float(np.mean(rates)) * 0.39 / (2.0 * belt)
            name = f"mu {friction}, {sprocket:g} rad/s"
            one = relative("MuJoCo's own friction", f"{name}: spin ratio", chi, expected, 0.005)
            hop = float(np.std(rises))
            two = absolute("MuJoCo's own friction", f"{name}: vertical speed", hop, 0, 1e-3, "m/s")
            for check in (one, two):
                yield replace(check, informative=True)
