"""Check energy, momentum, steps, ramps, rough ground, friction zones, loose bodies and walls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import mujoco
import numpy as np

from simloop.certify.checks import Check, absolute, at_most, relative, verdict
from simloop.certify.rig import GRAVITY_MPS2, Bench, Rig
from simloop.certify.rig_parts import RADIUS_M, Block
from simloop.config import FrictionZone
from simloop.physics import track_theory as theory
from simloop.physics import turning_theory

_SEED = 20261125
_BEARINGS: tuple[tuple[str, Literal["rail", "pivot"], float], ...] = (
    ("sled", "rail", 5.0),
    ("turntable", "pivot", 0.2),
)
"""Name, bearing and mass, kg, of movable ground. It is too large to drive off."""


def energy() -> Iterator[Check]:
    """Check that shaft work = kinetic + potential + shear + joint friction energy (form 8).

    Yields:
        Checks of the balance over random manoeuvres, at three time steps.
    """
    rng = np.random.default_rng(_SEED)
    for step in (0.001, 0.002, 0.005):
        for number in range(4):
            pitch = float(rng.uniform(-0.2, 0.2))
            rig = Rig(step_s=step, friction=float(rng.uniform(0.3, 0.9)), pitch_rad=pitch)
            yield _balance(f"random manoeuvre {number}, step {step * 1e3:g} ms", rig, rng)
        tilted = Rig(
            step_s=step,
            wheels=int(rng.integers(4, 11)),
            friction=float(rng.uniform(0.2, 1.0)),
            pitch_rad=float(rng.uniform(-0.2, 0.2)),
            roll_rad=float(rng.uniform(-0.2, 0.2)),
            payload_kg=5.0,
            payload_m=(0.05, -0.04, 0.15),
        )
        name = f"with brakes, payload and side slope, step {step * 1e3:g} ms"
        yield _balance(name, tilted, rng, brakes=0.3)
        for label, bearing, mass in _BEARINGS:
            under = Block((0.0, 0.0, -0.05), (6.0, 6.0, 0.05), 0.0, mass, bearing=bearing)
            moving = Rig(step_s=step, blocks=(under,), floor=False)
            yield _balance(f"on a {label}, step {step * 1e3:g} ms", moving, rng)


def _balance(name: str, rig: Rig, rng: np.random.Generator, brakes: float = 0.0) -> Check:
    """Check the balance over twelve random commands; brakes: probability that they are on."""
    bench = rig.build()
    before = _mechanical(bench)
    for _ in range(12):
        left, right = rng.uniform(-24.0, 24.0, 2)
        bench.plant.brake(bool(rng.random() < brakes) if brakes else False)
        bench.drive((left, right), float(rng.uniform(0.1, 0.5)))
    return _balanced("energy", name, bench, before)


def _balanced(group: str, name: str, bench: Bench, before_j: float) -> Check:
    """Check shaft work against the energy it became; ``before_j``: mechanical energy before."""
    work = bench.plant.work_j()
    spent = _mechanical(bench) - before_j + work[1] + work[2]
    return relative(group, name, float(spent), float(work[3]), 0.01, "J")


def _mechanical(bench: Bench) -> float:
    """Compute the kinetic and potential energy, J."""
    model, data = bench.plant.model, bench.plant.data
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy.sum())


def kinetic_and_potential(bench: Bench) -> float:
    """Compute kinetic and potential energy without a forward pass, which would change the state.

    Args:
        bench: the rig; its positions are those of the start of the last step.

    Returns:
        Energy, J.
    """
    model, data = bench.plant.model, bench.plant.data
    momentum = np.empty(model.nv)
    mujoco.mj_mulM(model, data, momentum, data.qvel)
    height = float((model.body_mass[:, None] * data.xipos * model.opt.gravity).sum())
    return 0.5 * float(momentum @ data.qvel) - height


def spent_j(bench: Bench) -> float:
    """Compute the energy lost in tracks and joints, less the work of the motors' shafts.

    Args:
        bench: the rig.

    Returns:
        Energy since the reset, J.
    """
    work = bench.plant.work_j()
    return float(work[1] + work[2] - work[3])


def steps_agree() -> Iterator[Check]:
    """Check that a manoeuvre ends at the same place with steps of 1 ms and of 5 ms.

    Yields:
        Checks of the end's shift over the distance driven, and of the yaw.
    """
    for friction in (0.3, 0.6, 0.9):
        ends, ways = [], []
        for step in (0.001, 0.005):
            bench = Rig(step_s=step, friction=friction).build()
            way = 0.0
            for left, right in ((10.0, 10.0), (4.0, 16.0), (-8.0, 12.0), (15.0, 6.0), (0.0, 0.0)):
                bench.drive((left, right), 0.8)
                way += 0.8 * RADIUS_M * 6.0
            ends.append(bench.truth.pose_xyyaw.copy())
            ways.append(way)
        gap = np.abs(ends[1] - ends[0])
        share = float(np.hypot(gap[0], gap[1])) / ways[0]
        yield absolute("1 to 5 ms", f"mu {friction}: end's shift / way", share, 0.0, 0.01)
        turned = float(gap[2] / np.abs(ends[0][2]))
        yield absolute("1 to 5 ms", f"mu {friction}: yaw", turned, 0.0, 0.01)


def zones() -> Iterator[Check]:
    """Check with one track on ice that each track pulls what its own ground allows.

    Yields:
        Checks of both tracks' pull.
    """
    ice = FrictionZone((-5.0, 0.0), (5.0, 5.0), 0.15)
    bench = Rig(friction=0.7, zones=(ice,)).build()
    bench.hold(0.0, 1.0, volts=20.0)
    for side, (label, friction) in enumerate((("left, on ice", 0.15), ("right", 0.7))):
        pull = float(bench.plant.tracks.track_force[side])
        expected = friction * 0.5 * bench.weight_n * theory.drawbar_ratio(1.0, 0.415, 0.001)
        yield relative("friction zones", f"pull {label}", pull, expected, 0.02, "N")


def loose() -> Iterator[Check]:
    """Check the force that pushes a box, and the thrust on a sled and on a turntable.

    Yields:
        Checks of forces, momenta and energy.
    """
    for mass, friction in ((1.0, 0.5), (3.0, 0.4)):
        box = Block((0.4, 0.0, 0.08), (0.1, 0.15, 0.08), 0.0, mass, friction)
        rig = Rig(blocks=(box,))
        bench = rig.build()
        model = bench.plant.model
        model.geom_friction[model.geom("floor").id, 0] = friction
        for geom in range(model.ngeom):
            # A hull that rubs on the box would carry part of its weight.
            if model.geom(geom).name.startswith("hull_"):
                model.geom_condim[geom] = 1
        bench.drive((8.0, 8.0), 2.0)
        thrusts: list[float] = []
        for _ in range(200):
            bench.drive((8.0, 8.0), 0.01)
            thrusts.append(float(bench.plant.tracks.track_force.sum()))
        # MuJoCo's own friction makes the box hop as it slides, so the mean is compared.
        pull = float(np.mean(thrusts))
        expected = friction * mass * GRAVITY_MPS2
        yield relative("loose box", f"{mass:g} kg: thrust", pull, expected, 0.02, "N")
    yield from _sled()
    yield from _turntable()


def _sled() -> Iterator[Check]:
    """Check that the vehicle gains the momentum that a sled loses. Ice below has no effect."""
    sled = Block((0.0, 0.0, -0.05), (1.0, 0.5, 0.05), 0.0, 5.0, bearing="rail")
    ice = FrictionZone((-9.0, -9.0), (9.0, 9.0), 0.05)
    bench = Rig(blocks=(sled,), floor=False, zones=(ice,)).build()
    before = _mechanical(bench)
    bench.drive((20.0, 20.0), 0.2)
    yield _balanced("loose sled", "shafts' work, while it speeds up", bench, before)
    data, model = bench.plant.data, bench.plant.model
    sled_v = float(data.qvel[model.jnt_dofadr[-1]])
    # The sled's joint comes last. The sprockets' spin has no momentum along x.
    vehicle = bench.mass_kg * float(bench.truth.velocity_body[0])
    name = "sled's momentum to the vehicle's"
    yield relative("loose sled", name, -5.0 * sled_v, vehicle, 0.001, "N s")
    pulled = bool(vehicle > 0.05 * bench.weight_n * 0.2)
    yield verdict("loose sled", "pulls more than the ice below would let it", pulled, True)


def _turntable() -> Iterator[Check]:
    """Check that a turntable takes the angular momentum, and the spin ratio relative to it."""
    table = Block((0.0, 0.0, -0.05), (0.8, 0.8, 0.05), 0.0, 0.5, bearing="pivot")
    bench = Rig(blocks=(table,), floor=False).build()
    before = _mechanical(bench)
    bench.drive((-12.0, 12.0), 0.2)
    yield _balanced("turntable", "shafts' work, while it speeds up", bench, before)
    data, model = bench.plant.data, bench.plant.model
    mujoco.mj_subtreeVel(model, data)
    base = model.body("base_link").id
    at, speed = data.subtree_com[base], data.subtree_linvel[base]
    own = float(data.subtree_angmom[base][2])
    own += bench.mass_kg * float(at[0] * speed[1] - at[1] * speed[0])
    other = float(data.subtree_angmom[model.body("loose_0").id][2])
    name = "its angular momentum to the vehicle's"
    yield relative("turntable", name, -other, own, 0.001, "N m s")
    bench.drive((-12.0, 12.0), 1.0)
    left, right = bench.belts_mps()
    turned = bench.motion()[2] - float(data.qvel[model.jnt_dofadr[-1]])
    chi = turned * bench.rig.gauge_m / (right - left)
    yield relative(
        "turntable", "spin ratio on it", chi, turning_theory.spin_ratio(0.415, 0.39), 0.005
    )


def steps() -> Iterator[Check]:
    """Check that steps are climbed up to the height that plane statics allows (form 6).

    Yields:
        Checks below and above that height, and of a low sill.
    """
    for friction in (0.3, 0.4, 0.5):
        bench = Rig().build()
        x, height = bench.rig.support_x()[0], float(bench.centre_m[2])
        limit = theory.climbable_step(friction, RADIUS_M, float(x), float(x), height)
        for share, climbs in ((0.85, True), (1.15, False)):
            tall = share * limit
            block = Block((1.0 + 0.215, 0.0, 0.5 * tall - 0.5), (1.0, 1.0, 0.5 + 0.5 * tall))
            bench = Rig(friction=friction, blocks=(_top(block, tall),)).build()
            bench.drive((4.0, 4.0), 4.0)
            up = bool(bench.truth.position_m[2] > 0.5 * tall)
            name = f"mu {friction}: {tall * 1e3:.1f} mm, {share} of the limit"
            yield verdict("steps", name, up, climbs)
    sill = Block((0.4, 0.0, 0.0025), (0.02, 1.0, 0.0025))
    bench = Rig(blocks=(sill,)).build()
    bench.drive((8.0, 8.0), 5.0)
    yield verdict("steps", "a sill of 5 mm is crossed", bool(bench.truth.position_m[0] > 0.7), True)


def _top(block: Block, height: float) -> Block:
    """Move a block's upper face to a height, m. The block reaches a metre below that."""
    x, y, _ = block.centre_m
    return Block((x, y, height - 0.5), (block.half_m[0], block.half_m[1], 0.5))


def ramps() -> Iterator[Check]:
    """Check that a real ramp is climbed if friction allows it, as with tilted gravity (form 6).

    Yields:
        Checks of whether it is climbed.
    """
    for friction, angle, climbs in ((0.6, 0.25, True), (0.3, 0.25, True), (0.2, 0.25, False)):
        ramp = Block(
            (0.25 + math.cos(angle), 0.0, math.sin(angle) - 0.1 * math.cos(angle)),
            (1.0, 1.0, 0.1),
            angle,
        )
        bench = Rig(friction=friction, blocks=(ramp,)).build()
        bench.drive((12.0, 12.0), 5.0)
        up = bool(bench.truth.position_m[2] > 0.2)
        yield verdict("ramps", f"mu {friction}, {math.degrees(angle):.0f} degrees", up, climbs)


def rough() -> Iterator[Check]:
    """Check on a height field that wheels carry the weight, and only motors supply energy.

    Yields:
        Checks of mean load, energy and progress.
    """
    for number, height in enumerate((0.01, 0.02, 0.04)):
        bench = Rig(rough_m=height, rough_seed=number).build()
        start = kinetic_and_potential(bench) + spent_j(bench)
        loads, gain = [], 0.0
        for _ in range(500):
            bench.drive((12.0, 11.0), 0.01)
            loads.append(float(bench.plant.tracks.load.sum()))
            gain = max(gain, kinetic_and_potential(bench) + spent_j(bench) - start)
        name = f"heights to {height * 1e3:g} mm"
        mean = float(np.mean(loads))
        yield relative("rough", f"{name}: mean load", mean, bench.weight_n, 0.02, "N")
        yield at_most("rough", f"{name}: energy from nowhere", gain, 0.05, "J")
        on = float(np.hypot(*bench.truth.position_m[:2]))
        yield verdict("rough", f"{name}: it gets on", on > 0.8, True)


def walls() -> Iterator[Check]:
    """Check that the vehicle at full voltage against a wall does not climb, stick or gain energy.

    Yields:
        Checks head on and at an angle.
    """
    wall = Block((0.55, 0.0, 0.5), (0.1, 2.0, 0.5), name="wall")
    for name, left, right in (("head on", 24.0, 24.0), ("slanting", 24.0, 18.0)):
        bench = Rig(friction=1.0, blocks=(wall,)).build()
        bench.drive((left, right), 0.3)  # not yet at the wall, and at speed
        start = kinetic_and_potential(bench) + spent_j(bench)
        highest, gain = 0.0, 0.0
        for _ in range(300):
            bench.drive((left, right), 0.01)
            highest = max(highest, float(bench.truth.position_m[2]))
            gain = max(gain, kinetic_and_potential(bench) + spent_j(bench) - start)
        yield at_most("walls", f"{name}: rise", highest, 0.002, "m")
        yield at_most("walls", f"{name}: energy from nowhere", gain, 0.05, "J")
        at = bench.truth.position_m[:2].copy()
        bench.drive((-12.0, -12.0), 2.0)
        away = float(np.hypot(*(bench.truth.position_m[:2] - at)))
        yield verdict("walls", f"{name}: it comes off again", away > 0.2, True)
