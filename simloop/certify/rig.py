"""Test rigs: the vehicle stretched, loaded, towed, on planes, slopes and steps.

A rig takes models/tracked_ugv.xml and the plant that the simulation loop uses. It changes lengths,
masses, wheels and ground only. Nothing depends on the clock or on chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from simloop.certify.rig_parts import RADIUS_M, Block, add_block, add_rough, add_wheels
from simloop.common.data_files import models_dir
from simloop.config import (
    Config,
    FrictionZone,
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
# Added to a joint so that it keeps its speed whatever resists.
_HEAVY_KGM2, _HEAVY_KG = 1e4, 1e3


@dataclass(frozen=True, slots=True)
class Rig:
    """A vehicle and its ground. Slopes are made by tilting gravity.

    Attributes:
        length_m: contact length.
        gauge_m: between the tracks' centre lines.
        wheels: road wheels a side.
        payload_kg: load on the chassis.
        payload_m: (3,) its place in base_link.
        friction: of the ground.
        step_s: physics step.
        pitch_rad: slope; above 0 +x leads uphill.
        roll_rad: side slope; above 0 the left side is higher.
        rolling_resistance: drag over load.
        shear_modulus_m: of the brush.
        zones: ground with a friction of its own.
        blocks: boxes on or in the ground.
        floor: whether there is a plane to stand on.
        rough_m: height of a random height field in place of the plane; 0: none.
        rough_seed: of the height field.
        native_belts_mps: speeds, left and right, of surfaces with MuJoCo's own friction.
        braked: holding brakes on from the beginning.
        open_circuit: motors that give no torque.
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
    shear_modulus_m: float = 0.001
    zones: tuple[FrictionZone, ...] = ()
    blocks: tuple[Block, ...] = ()
    floor: bool = True
    rough_m: float = 0.0
    rough_seed: int = 0
    native_belts_mps: tuple[float, float] | None = None
    braked: bool = False
    open_circuit: bool = False

    def config(self, friction: float) -> Config:
        """Settings of this rig's plant.

        Args:
            friction: of the tracks.

        Returns:
            The settings; all that the rig does not name is the default.
        """
        motor = MotorConfig(resistance_ohm=1e6) if self.open_circuit else MotorConfig()
        return Config(
            motor=motor,
            rates=RatesConfig(physics_s=self.step_s),
            tracks=TracksConfig(
                friction=friction,
                zones=self.zones,
                shear_modulus_m=self.shear_modulus_m,
                rolling_resistance=self.rolling_resistance,
            ),
        )

    def build(self, own_friction: float | None = None, settle_s: float = 0.5) -> Bench:
        """Build the rig and let it settle.

        Args:
            own_friction: of the tracks, if it is not the rig's.
            settle_s: how long it settles, s.

        Returns:
            The rig at rest.
        """
        friction = self.friction if own_friction is None else own_friction
        return Bench(self, friction, settle_s)

    def support_x(self) -> FloatArray:
        """Places of the road wheels: the middles of equal pieces of the contact length.

        Returns:
            (wheels,) x of one side, front to rear, m.
        """
        cell = self.length_m / self.wheels
        return 0.5 * self.length_m - cell * (np.arange(self.wheels, dtype=np.float64) + 0.5)

    def gravity(self) -> FloatArray:
        """Gravity as the slopes tilt it.

        Returns:
            (3,) m/s^2.
        """
        cos = math.cos(self.pitch_rad)
        across, down = math.sin(self.roll_rad) * cos, math.cos(self.roll_rad) * cos
        return -GRAVITY_MPS2 * np.array([math.sin(self.pitch_rad), across, down])


class Bench:
    """A rig's plant, with the means to drive, tow and measure it."""

    def __init__(self, rig: Rig, friction: float, settle_s: float) -> None:
        """Build the plant and let it settle.

        Args:
            rig: what is built.
            friction: of the tracks.
            settle_s: how long it settles, s.
        """
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
        """Apply constant voltages for a while.

        Args:
            volts: left and right, V.
            seconds: how long, s.
            each: called before every control period.

        Returns:
            The truth at the end.
        """
        for _ in range(round(seconds / CONTROL_S)):
            if each is not None:
                each(self)
            self._keep_belts()
            self.truth = self.plant.step(np.array(volts, dtype=np.float64))
        return self.truth

    def run_belts(self, left_mps: float, right_mps: float) -> None:
        """Make the belts run at constant speeds from now on, whatever resists.

        The sprockets become very heavy. The speed that they lose in a control period all the same
        is given back before the next.

        Args:
            left_mps: m/s.
            right_mps: m/s.
        """
        self._belts_mps = (left_mps, right_mps)
        self.plant.model.dof_armature[self._sprockets] = _HEAVY_KGM2
        self._keep_belts()

    def _keep_belts(self) -> None:
        if self._belts_mps is not None:
            self.plant.data.qvel[self._sprockets] = np.array(self._belts_mps) / RADIUS_M

    def sprocket_inertia_kgm2(self) -> float:
        """Inertia of one sprocket about its axle, with its motor's rotor.

        Returns:
            Inertia, kg m^2.
        """
        model = self.plant.model
        joint = model.joint("sprocket_left_joint")
        own = float(model.body_inertia[joint.bodyid[0]].max())
        return own + float(model.dof_armature[joint.dofadr[0]])

    def push_off(self, speed_mps: float) -> None:
        """Set the vehicle and its belts to one speed.

        Args:
            speed_mps: along x, m/s.
        """
        self.plant.data.qvel[0] = speed_mps
        self.plant.data.qvel[self._sprockets] = speed_mps / RADIUS_M

    def lock_belts(self) -> None:
        """Stop the belts from now on."""
        self.run_belts(0.0, 0.0)

    def tow(self, force_n: float) -> None:
        """Pull at ground level from now on.

        Args:
            force_n: along x, N.
        """
        self.plant.data.qfrc_applied[0] = force_n

    def hold(self, speed_mps: float, seconds: float, volts: float = 0.0) -> None:
        """Keep the vehicle at one speed and from turning, as a winch does.

        The vehicle becomes heavy, and is towed with what the tracks pushed last. If it were still
        heavier, the contact solver would lose digits.

        Args:
            speed_mps: along x, m/s.
            seconds: how long, s.
            volts: of both motors, V.
        """
        self.plant.model.dof_armature[[0, 1, 5]] = _HEAVY_KG
        self.plant.data.qvel[0] = speed_mps

        def pull(it: Bench) -> None:
            it.tow(-float(it.plant.tracks.track_force.sum()))

        self.drive((volts, volts), seconds, pull)

    def swing(self, yaw_rate: float, seconds: float) -> float:
        """Turn the vehicle by hand, with belts that have no slip along themselves.

        Args:
            yaw_rate: rad/s.
            seconds: how long, s.

        Returns:
            The tracks' moment about z, N m.
        """
        pace = 0.5 * self.rig.gauge_m * yaw_rate
        self.run_belts(-pace, pace)
        self.plant.model.dof_armature[5] = _HEAVY_KG

        def turn(it: Bench) -> None:
            it.plant.data.qvel[5] = yaw_rate

        self.drive((0.0, 0.0), seconds, turn)
        return float(self.plant.data.xfrc_applied[self._base_id(), 5])

    def drive_without_yaw(self, seconds: float) -> None:
        """Let the belts run on while the vehicle is kept from turning.

        Args:
            seconds: how long, s.
        """
        self.plant.model.dof_armature[5] = _HEAVY_KG

        def straight(it: Bench) -> None:
            it.plant.data.qvel[5] = 0.0

        self.drive((0.0, 0.0), seconds, straight)

    def motion(self) -> tuple[float, float, float]:
        """The vehicle's planar motion.

        Returns:
            v_x, v_y in base_link, m/s, and yaw rate, rad/s.
        """
        v = self.truth.velocity_body
        return float(v[0]), float(v[1]), float(v[5])

    def belts_mps(self) -> tuple[float, float]:
        """The belts' speeds.

        Returns:
            Left and right, m/s.
        """
        left, right = RADIUS_M * self.truth.sprocket_radps
        return float(left), float(right)

    def spin_ratio(self) -> float:
        """Yaw rate over what the belts would give without slip.

        Returns:
            chi.
        """
        left, right = self.belts_mps()
        return float(self.truth.velocity_body[5]) * self.rig.gauge_m / (right - left)

    def cells(self, fine: int = 50) -> turning_theory.Cells:
        """The belts as theory has them: loads of beam statics, spread about each wheel.

        On a slope the weight bears where its line through the centre of gravity meets the ground.

        Args:
            fine: cells for each road wheel.

        Returns:
            The belts with their loads.
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
    """The vehicle's file, without what is only seen, on the rig's ground."""
    spec = mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml"))
    for geom in list(spec.geoms):
        if geom.name.startswith(("visual_", "road_")) or geom.name == "ground":
            spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    for key in list(spec.keys):
        spec.delete(key)
    if rig.rough_m > 0.0:
        add_rough(spec, rig.rough_m, rig.rough_seed)
    elif rig.floor:
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1], contype=2
        )
    wheels = add_wheels(spec, rig.support_x(), rig.gauge_m)
    add_payload(spec, PayloadConfig(rig.payload_kg, rig.payload_m))
    for number, block in enumerate(rig.blocks):
        add_block(spec, block, number)
    spec.option.gravity = rig.gravity().tolist()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    if rig.native_belts_mps is not None:
        # MuJoCo's own friction, under surfaces that move over the wheels as belts do.
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        for i, geom in enumerate(wheels):
            geom.condim, geom.friction = 3, [rig.friction, 0.005, 0.0001]
            belt = rig.native_belts_mps[i // rig.wheels]
            geom.surfacevel = [-belt, 0.0, 0.0, 0.0, 0.0, 0.0]
    return spec.compile()
