"""Test rigs: the vehicle in other sizes, with loads, under tow, on planes, slopes and steps.

A rig uses models/tracked_ugv.xml and the plant of the simulation loop. It changes only lengths,
masses, wheels and ground. Nothing depends on the clock or on chance.
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
# Added to the inertia of a joint, which then keeps its speed against any resistance.
_HEAVY_KGM2, _HEAVY_KG = 1e4, 1e3


@dataclass(frozen=True, slots=True)
class Rig:
    """A vehicle and its ground. Tilted gravity makes the slopes.

    Attributes:
        length_m: contact length.
        gauge_m: distance between the tracks' centre lines.
        wheels: number of road wheels on each side.
        payload_kg: load on the chassis.
        payload_m: (3,) position of the load in base_link.
        friction: coefficient of friction of the ground.
        step_s: physics step.
        pitch_rad: slope; above 0: +x leads uphill.
        roll_rad: side slope; above 0: the left side is higher.
        rolling_resistance: drag over load.
        shear_modulus_m: shear modulus of the brush.
        zones: ground with its own friction.
        blocks: boxes on or in the ground.
        floor: whether there is a plane to stand on.
        rough_m: height of a random height field instead of the plane; 0: none.
        rough_seed: seed of the height field.
        native_belts_mps: speeds, left and right, of surfaces with MuJoCo's own friction.
        braked: whether the holding brakes are on from the start.
        open_circuit: whether the motors give no torque.
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
        """Make the settings of this rig's plant.

        Args:
            friction: coefficient of friction of the tracks.

        Returns:
            The settings. Those that the rig does not name have their defaults.
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
            own_friction: friction of the tracks, if it differs from the rig's.
            settle_s: time to settle, s.

        Returns:
            The rig at rest.
        """
        friction = self.friction if own_friction is None else own_friction
        return Bench(self, friction, settle_s)

    def support_x(self) -> FloatArray:
        """Compute the positions of the road wheels: middles of equal parts of the contact length.

        Returns:
            (wheels,) x of one side, front to rear, m.
        """
        cell = self.length_m / self.wheels
        return 0.5 * self.length_m - cell * (np.arange(self.wheels, dtype=np.float64) + 0.5)

    def gravity(self) -> FloatArray:
        """Compute gravity, tilted as the slopes.

        Returns:
            (3,) m/s^2.
        """
        cos = math.cos(self.pitch_rad)
        across, down = math.sin(self.roll_rad) * cos, math.cos(self.roll_rad) * cos
        return -GRAVITY_MPS2 * np.array([math.sin(self.pitch_rad), across, down])


class Bench:
    """A rig's plant, with methods to drive, tow and measure it."""

    def __init__(self, rig: Rig, friction: float, settle_s: float) -> None:
        """Build the plant and let it settle.

        Args:
            rig: the rig to build.
            friction: coefficient of friction of the tracks.
            settle_s: time to settle, s.
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
        """Apply constant voltages for some time.

        Args:
            volts: left and right, V.
            seconds: duration, s.
            each: called before each control period.

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
        """Make the belts run at constant speeds from now on, against any resistance.

        The sprockets become very heavy. Before each control period their speed is set again, to
        correct the small loss of the last period.

        Args:
            left_mps: speed of the left belt, m/s.
            right_mps: speed of the right belt, m/s.
        """
        self._belts_mps = (left_mps, right_mps)
        self.plant.model.dof_armature[self._sprockets] = _HEAVY_KGM2
        self._keep_belts()

    def _keep_belts(self) -> None:
        if self._belts_mps is not None:
            self.plant.data.qvel[self._sprockets] = np.array(self._belts_mps) / RADIUS_M

    def sprocket_inertia_kgm2(self) -> float:
        """Compute the inertia of one sprocket about its axle, with its motor's rotor.

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
        """Tow at ground level from now on.

        Args:
            force_n: along x, N.
        """
        self.plant.data.qfrc_applied[0] = force_n

    def hold(self, speed_mps: float, seconds: float, volts: float = 0.0) -> None:
        """Keep the vehicle at one speed without turning, as a winch does.

        The vehicle becomes heavy, and is towed with the last thrust of the tracks. With a still
        larger mass, the contact solver would lose digits.

        Args:
            speed_mps: along x, m/s.
            seconds: duration, s.
            volts: voltage of both motors, V.
        """
        self.plant.model.dof_armature[[0, 1, 5]] = _HEAVY_KG
        self.plant.data.qvel[0] = speed_mps

        def pull(it: Bench) -> None:
            it.tow(-float(it.plant.tracks.track_force.sum()))

        self.drive((volts, volts), seconds, pull)

    def swing(self, yaw_rate: float, seconds: float) -> float:
        """Turn the vehicle at a set rate, with belts that have no slip along themselves.

        Args:
            yaw_rate: rad/s.
            seconds: duration, s.

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
        """Let the belts run on while the vehicle cannot turn.

        Args:
            seconds: duration, s.
        """
        self.plant.model.dof_armature[5] = _HEAVY_KG

        def straight(it: Bench) -> None:
            it.plant.data.qvel[5] = 0.0

        self.drive((0.0, 0.0), seconds, straight)

    def motion(self) -> tuple[float, float, float]:
        """Read the vehicle's planar motion.

        Returns:
            v_x, v_y in base_link, m/s, and yaw rate, rad/s.
        """
        v = self.truth.velocity_body
        return float(v[0]), float(v[1]), float(v[5])

    def belts_mps(self) -> tuple[float, float]:
        """Read the belts' speeds.

        Returns:
            Left and right, m/s.
        """
        left, right = RADIUS_M * self.truth.sprocket_radps
        return float(left), float(right)

    def spin_ratio(self) -> float:
        """Compute the yaw rate over the yaw rate of belts without slip.

        Returns:
            chi.
        """
        left, right = self.belts_mps()
        return float(self.truth.velocity_body[5]) * self.rig.gauge_m / (right - left)

    def cells(self, fine: int = 50) -> turning_theory.Cells:
        """Make the belts of the theory: loads of beam statics, spread around each wheel.

        On a slope, the weight acts where its line through the centre of gravity meets the ground.

        Args:
            fine: number of cells for each road wheel.

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
    """Compile the vehicle's model without its visual parts, on the rig's ground."""
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
        # MuJoCo's own friction, with surfaces that move over the wheels as belts do.
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        for i, geom in enumerate(wheels):
            geom.condim, geom.friction = 3, [rig.friction, 0.005, 0.0001]
            belt = rig.native_belts_mps[i // rig.wheels]
            geom.surfacevel = [-belt, 0.0, 0.0, 0.0, 0.0, 0.0]
    return spec.compile()
