"""Test rigs: the vehicle of models/tracked_ugv.xml, stretched, loaded, towed, on planes and steps.

Every rig is the very file and the very plant that the loop drives; only lengths, masses, wheels
and ground are set. No clock, no chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.config import (
    Config,
    MotorConfig,
    PayloadConfig,
    RatesConfig,
    TracksConfig,
)
from simloop.messages import FloatArray
from simloop.physics import turning_theory
from simloop.physics.plant import Plant
from simloop.truth import Truth
from simloop.worlds.arena import add_payload

GRAVITY_MPS2 = 9.81
CONTROL_S = 0.01
RADIUS_M = 0.037
"""Of the sprockets of models/tracked_ugv.xml."""
_HEAVY_KGM2, _HEAVY_KG = 1e4, 1e3
_ROUGH_CELLS = 201


@dataclass(frozen=True, slots=True)
class Block:
    """A box on or in the ground: centre, half sizes, m; pitch, rad; mass_kg > 0 makes it loose,
    a rail lets it move along x alone, a pivot turn about z alone."""

    centre_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    pitch_rad: float = 0.0
    mass_kg: float = 0.0
    friction: float = 0.5
    bearing: Literal["none", "rail", "pivot"] = "none"
    name: str = "ground_block"


@dataclass(frozen=True, slots=True)
class Rig:
    """What is built. Tilts turn gravity: pitch > 0 leads uphill along +x, roll > 0 lifts the left.

    rough_m: height of a random height field of 8 m x 8 m in place of the plane.
    native_belts_mps: MuJoCo's own friction under surfaces that move so. open_circuit: motors that
    give no torque. braked: holding brakes on from the beginning.
    """

    length_m: float = 0.415
    gauge_m: float = 0.39
    wheels: int = 6
    payload_kg: float = 0.0
    payload_m: tuple[float, float, float] = (0.0, 0.0, 0.1)
    friction: float = 0.6
    step_s: float = 0.002
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    rolling_resistance: float = 0.02
    blocks: tuple[Block, ...] = ()
    floor: bool = True
    rough_m: float = 0.0
    rough_seed: int = 0
    native_belts_mps: tuple[float, float] | None = None
    braked: bool = False
    open_circuit: bool = False
    tracks: dict[str, object] = field(default_factory=dict)

    def config(self, friction: float) -> Config:
        """The settings of this rig's plant."""
        motor = MotorConfig(resistance_ohm=1e6) if self.open_circuit else MotorConfig()
        return Config(
            motor=motor,
            rates=RatesConfig(physics_s=self.step_s),
            tracks=TracksConfig(
                friction=friction,
                rolling_resistance=self.rolling_resistance,
                **self.tracks,  # type: ignore[arg-type]
            ),
        )

    def build(self, own_friction: float | None = None, settle_s: float = 0.5) -> Bench:
        """The rig at rest, settled. own_friction: of the tracks, where it is not the rig's."""
        friction = self.friction if own_friction is None else own_friction
        return Bench(self, friction, settle_s)

    def support_x(self) -> FloatArray:
        """(n,) of the road wheels of a side, front to rear, m: the middles of n equal pieces."""
        cell = self.length_m / self.wheels
        return 0.5 * self.length_m - cell * (np.arange(self.wheels, dtype=np.float64) + 0.5)

    def gravity(self) -> FloatArray:
        """(3,) m/s^2, as the tilts turn it."""
        cos = math.cos(self.pitch_rad)
        across, down = math.sin(self.roll_rad) * cos, math.cos(self.roll_rad) * cos
        return -GRAVITY_MPS2 * np.array([math.sin(self.pitch_rad), across, down])


class Bench:
    """A rig's plant with the hands to drive, tow and measure it."""

    def __init__(self, rig: Rig, friction: float, settle_s: float) -> None:
        self.rig = rig
        self.plant = Plant(_model(rig), rig.config(friction))
        self._belts_mps: tuple[float, float] | None = None
        joints = [self.plant.model.joint(f"sprocket_{side}_joint") for side in ("left", "right")]
        self._sprockets = [int(joint.dofadr[0]) for joint in joints]
        self.mass_kg = float(self.plant.model.body_subtreemass[self._base_id()])
        self.weight_n = self.mass_kg * GRAVITY_MPS2
        self.truth: Truth = self.plant.reset(np.zeros(3), settle_s, rig.braked)
        # (3,) centre of gravity in base_link, which has not moved yet.
        self.centre_m: FloatArray = self.plant.data.subtree_com[self._base_id()].copy()

    def _base_id(self) -> int:
        return int(self.plant.model.body("base_link").id)

    def drive(
        self,
        volts: tuple[float, float],
        seconds: float,
        each: Callable[[Bench], None] | None = None,
    ) -> Truth:
        """Constant voltages for a while; ``each`` is called before every control period."""
        for _ in range(round(seconds / CONTROL_S)):
            if each is not None:
                each(self)
            self._keep_belts()
            self.truth = self.plant.step(np.array(volts, dtype=np.float64))
        return self.truth

    def run_belts(self, left_mps: float, right_mps: float) -> None:
        """Make the sprockets so heavy that the belts keep these speeds whatever resists; what a
        control period takes from them all the same is given back before the next."""
        self._belts_mps = (left_mps, right_mps)
        self.plant.model.dof_armature[self._sprockets] = _HEAVY_KGM2
        self._keep_belts()

    def _keep_belts(self) -> None:
        if self._belts_mps is not None:
            self.plant.data.qvel[self._sprockets] = np.array(self._belts_mps) / RADIUS_M

    def sprocket_inertia_kgm2(self) -> float:
        """Of one sprocket about its axle, with its motor's rotor."""
        model = self.plant.model
        joint = model.joint("sprocket_left_joint")
        own = float(model.body_inertia[joint.bodyid[0]].max())
        return own + float(model.dof_armature[joint.dofadr[0]])

    def push_off(self, speed_mps: float) -> None:
        """The vehicle and its belts at one speed along x."""
        self.plant.data.qvel[0] = speed_mps
        self.plant.data.qvel[self._sprockets] = speed_mps / RADIUS_M

    def lock_belts(self) -> None:
        """Belts that cannot move."""
        self.run_belts(0.0, 0.0)

    def tow(self, force_n: float) -> None:
        """A force along x, at ground level, from now on."""
        self.plant.data.qfrc_applied[0] = force_n

    def hold(self, speed_mps: float, seconds: float, volts: float = 0.0) -> None:
        """A winch that keeps the vehicle at this speed along x, and from turning.

        It is made heavy, and towed with what the tracks pushed last; still heavier, and the
        supports' solver would lose its digits.
        """
        self.plant.model.dof_armature[[0, 1, 5]] = _HEAVY_KG
        self.plant.data.qvel[0] = speed_mps

        def pull(it: Bench) -> None:
            it.tow(-float(it.plant.tracks.track_force.sum()))

        self.drive((volts, volts), seconds, pull)

    def swing(self, yaw_rate: float, seconds: float) -> float:
        """Turn the vehicle by hand, with belts that keep pace: the tracks' moment, N m, about z."""
        pace = 0.5 * self.rig.gauge_m * yaw_rate
        self.run_belts(-pace, pace)
        self.plant.model.dof_armature[5] = _HEAVY_KG

        def turn(it: Bench) -> None:
            it.plant.data.qvel[5] = yaw_rate

        self.drive((0.0, 0.0), seconds, turn)
        return float(self.plant.data.xfrc_applied[self._base_id(), 5])

    def drive_without_yaw(self, seconds: float) -> None:
        """Let the belts run on while something keeps the vehicle from turning."""
        self.plant.model.dof_armature[5] = _HEAVY_KG

        def straight(it: Bench) -> None:
            it.plant.data.qvel[5] = 0.0

        self.drive((0.0, 0.0), seconds, straight)

    def motion(self) -> tuple[float, float, float]:
        """v_x, v_y, yaw rate in base_link."""
        v = self.truth.velocity_body
        return float(v[0]), float(v[1]), float(v[5])

    def belts_mps(self) -> tuple[float, float]:
        """Belt speeds, left, right."""
        left, right = RADIUS_M * self.truth.sprocket_radps
        return float(left), float(right)

    def spin_ratio(self) -> float:
        """chi: yaw rate over what the belts would give without slip."""
        left, right = self.belts_mps()
        return float(self.truth.velocity_body[5]) * self.rig.gauge_m / (right - left)

    def cells(self, fine: int = 50) -> turning_theory.Cells:
        """The belts as theory has them, with the loads of beam statics spread about each wheel.

        On a slope the weight bears where its line through the centre of gravity meets the ground.
        """
        x, rig = self.rig.support_x(), self.rig
        down = rig.gravity() / GRAVITY_MPS2
        centre = self.centre_m - down * self.centre_m[2] / down[2]
        places = [(at, side * 0.5 * rig.gauge_m) for side in (1, -1) for at in x]
        weight = -down[2] * self.weight_n
        loads = turning_theory.support_loads(np.array(places), weight, (centre[0], centre[1]))
        cell = rig.length_m / (rig.wheels * fine)
        places_x = np.arange(rig.wheels * fine, dtype=np.float64)
        fine_x = 0.5 * rig.length_m - cell * (places_x + 0.5)
        spread = np.repeat(loads.reshape(2, -1), fine, axis=1) / fine
        return turning_theory.Cells(fine_x, spread, rig.gauge_m, cell)


def _model(rig: Rig) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml"))
    for geom in list(spec.geoms):
        if geom.name.startswith(("visual_", "road_")) or geom.name == "ground":
            spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    for key in list(spec.keys):
        spec.delete(key)
    if rig.rough_m > 0.0:
        _add_rough(spec, rig)
    elif rig.floor:
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1], contype=2
        )
    base = spec.body("base_link")
    _add_wheels(spec, base, rig)
    add_payload(spec, PayloadConfig(rig.payload_kg, rig.payload_m))
    for number, block in enumerate(rig.blocks):
        _add_block(spec, block, number)
    spec.option.gravity = rig.gravity().tolist()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    if rig.native_belts_mps is not None:
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    return spec.compile()


def _add_wheels(spec: mujoco.MjSpec, base: mujoco.MjsBody, rig: Rig) -> None:
    style = spec.find_default("road_wheel")
    for label, sign in (("left", 1.0), ("right", -1.0)):
        for i, x in enumerate(rig.support_x()):
            geom = base.add_geom(style, name=f"road_{label}_{i}")
            geom.pos = [x, sign * 0.5 * rig.gauge_m, RADIUS_M]
            if rig.native_belts_mps is not None:
                geom.condim, geom.friction = 3, [rig.friction, 0.005, 0.0001]
                belt = rig.native_belts_mps[0 if sign > 0 else 1]
                geom.surfacevel = [-belt, 0.0, 0.0, 0.0, 0.0, 0.0]


def _add_rough(spec: mujoco.MjSpec, rig: Rig) -> None:
    """Random heights every 16 cm, bilinear between: level on the whole, no cliffs."""
    coarse = np.random.default_rng(rig.rough_seed).random((51, 51))
    rows = np.linspace(0.0, 50.0, _ROUGH_CELLS)
    low = np.minimum(rows.astype(int), 49)
    share = rows - low
    along = coarse[low] * (1 - share)[:, None] + coarse[low + 1] * share[:, None]
    heights = along[:, low] * (1 - share) + along[:, low + 1] * share
    spec.add_hfield(
        name="rough",
        nrow=_ROUGH_CELLS,
        ncol=_ROUGH_CELLS,
        size=[4.0, 4.0, rig.rough_m, 0.2],
        userdata=heights.ravel().tolist(),
    )
    spec.worldbody.add_geom(
        name="ground_rough",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="rough",
        pos=[0.0, 0.0, -rig.rough_m],
        contype=3,
    )


def _add_block(spec: mujoco.MjSpec, block: Block, number: int) -> None:
    half = [math.cos(0.5 * block.pitch_rad), 0.0, -math.sin(0.5 * block.pitch_rad), 0.0]
    loose = block.mass_kg > 0.0
    name = f"{'loose' if loose else block.name}_{number}"
    holder = spec.worldbody
    if loose:
        holder = spec.worldbody.add_body(name=name, pos=list(block.centre_m), quat=half)
        if block.bearing == "rail":
            holder.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
        elif block.bearing == "pivot":
            holder.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
        else:
            holder.add_freejoint()
    geom = holder.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=list(block.half_m), contype=1
    )
    geom.friction = [block.friction, 0.005, 0.0001]
    geom.conaffinity = 3 if loose and block.bearing == "none" else 0
    if loose:
        geom.mass = block.mass_kg
    else:
        geom.pos, geom.quat = list(block.centre_m), half
