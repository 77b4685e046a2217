"""The plant: MuJoCo's rigid bodies, the tracks' forces on them, and ray casting.

It advances by one control period at a time. Its input is the motor voltages. It gives the ground
truth and ranges to the sensors. Only the plant holds the physical state.
"""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np

from simloop.config import Config
from simloop.messages import FloatArray
from simloop.physics.arena_rays import ArenaRays
from simloop.physics.engine import find_engine, warnings_heard
from simloop.physics.plant_setup import body_arrays, instability, own_copy, track_constants
from simloop.physics.substeps import CONTACTS, HITS, TOUCHING, advance, advance_plainly
from simloop.physics.track_kernel import settle_account
from simloop.physics.track_model import (
    Geoms,
    TrackState,
    as_block,
    friction_map,
    state_block,
)
from simloop.physics.truth_kernels import (
    ACCELERATION,
    ANGLE,
    CURRENT,
    POSE,
    POSITION,
    QUATERNION,
    TURNING,
    VELOCITY,
    VOLTAGE,
    motion_now,
    point_velocity,
)
from simloop.physics.vehicle_geoms import (
    geom_kinds,
    ground_height,
    is_free,
    road_wheels,
    site_in_base,
    sprocket_radius,
)
from simloop.truth import LooseTruth, TrackTruth, Truth

_TURNING_RADPS = 0.02  # yaw rate below which the centre of rotation is badly defined
_WHEEL_M = 0.06  # half side of the square of ice under a road wheel; smaller than the wheel
_NO_WAY = np.empty((0, 2))
_DROP_M = 0.001  # a reset places the vehicle this high over the ground, then lets it settle


class Plant:
    """A vehicle in its arena, stepped with a fixed period."""

    def __init__(
        self, model: mujoco.MjModel, config: Config, through_bindings: bool = False
    ) -> None:
        """Make the plant. It is not at rest yet: call `reset` before the first step.

        Args:
            model: an arena with the vehicle attached (see `arena.build`). The plant works on a copy
                with the configuration's time step and rotors.
            config: the settings. ``config.vehicle`` is not read: it is what the robot believes.
            through_bindings: whether to step MuJoCo through its bindings, which takes twice the
                time and gives the same bits; they are used anyway where its addresses are unknown.

        Raises:
            ValueError: the model lacks what the tracks need.
        """
        self.model = model = own_copy(model, config)
        self.data = data = mujoco.MjData(model)
        self.substeps = round(config.rates.control_s / config.rates.physics_s)
        self.t_ns = 0
        self._dt_ns = round(config.rates.physics_s * 1e9)
        self._period_s = config.rates.control_s
        self._rays = ArenaRays(model, data)
        self._engine = None if through_bindings else find_engine(model, data)
        self._imu = site_in_base(model, "imu")
        self._joint_friction = model.dof_frictionloss.copy()
        # The arena's movable bodies may come first. The kernels' views begin at the vehicle.
        root = model.joint("root")
        at, dof = int(root.qposadr[0]), int(root.dofadr[0])
        joints = [model.joint(f"sprocket_{side}_joint") for side in ("left", "right")]
        self._sprocket_dof = np.array([j.dofadr[0] - dof for j in joints], np.int64)
        self._sprocket_qpos = np.array([j.qposadr[0] - at for j in joints], np.int64)
        self._qpos, self._qvel = data.qpos[at:], data.qvel[dof:]  # views, valid for good
        self._body = body_arrays(model, data, dof)
        self._geoms = Geoms(geom_kinds(model), model.geom_bodyid, self._sprocket_dof)
        # The tracks: their constants, their state, and the ground's friction with and without ice.
        self._wheel_geoms, self._radius_m = road_wheels(model), sprocket_radius(model)
        self._parameters = as_block(track_constants(model, config))
        self._block = state_block(len(self._wheel_geoms))
        self._state = TrackState.within(self._block)
        self._ground = friction_map(config.tracks.zones, config.tracks.friction_image)
        self._zones = self._ground
        self._voltage, self._braked = np.zeros(2), False
        self._counts = np.zeros(3, np.int64)  # see `advance`
        self._unstable = ""
        self._way = _NO_WAY  # displacement of the movers in one physics step, m
        others = [i for i in range(1, model.nbody) if i != self._body.base]
        self._loose = [i for i in others if is_free(model, i) or model.body_mocapid[i] >= 0]
        self._loose_names = tuple(model.body(i).name for i in self._loose)
        self._terrain = [i for i in range(model.ngeom) if model.geom(i).name.startswith("ground_")]

    @property
    def tracks(self) -> TrackState:
        """The tracks' internal state: brush displacements, wheel loads, currents, forces."""
        return self._state

    @property
    def sprocket_radius_m(self) -> float:
        """The sprockets' true radius, m. The robot may believe another value."""
        return self._radius_m

    @property
    def base_from_laser(self) -> FloatArray:
        """(3,) position of the laser in base_link, m; its axes are base_link's."""
        return self.model.site("lidar").pos.copy()

    @property
    def base_from_camera(self) -> FloatArray:
        """(3,) position of the depth camera in base_link, m; it looks along x, level."""
        return self.model.site("camera").pos.copy()

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Cast the LiDAR's rays of one control period, see `ArenaRays.cast`.

        Args:
            origins_m: (n, 3) in the world, millimetres apart, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        return self._rays.cast(origins_m, directions, cutoff_m)

    def look(self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Cast a camera's rays, all from one origin.

        Args:
            origin_m: (3,) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        return self._rays.look(origin_m, directions, cutoff_m)

    def reset(self, pose: FloatArray, settle_s: float = 0.5, braked: bool = False) -> Truth:
        """Put the vehicle at a pose, let it settle, and start the clock at 0.

        The plant is as new afterwards: ice, pushes and the movers' displacements are gone.

        Args:
            pose: (3,) x, y, m, and yaw, rad, in the world.
            settle_s: time to settle, s.
            braked: whether the holding brakes are on from the start.

        Returns:
            The truth at time 0.
        """
        mujoco.mj_resetData(self.model, self.data)
        self.model.dof_frictionloss[:] = self._joint_friction
        self._zones, self._way = self._ground, _NO_WAY
        self._voltage[:] = 0.0
        self._unstable = ""
        self._braked = braked
        self._block[:] = state_block(len(self._wheel_geoms))
        self._qpos[2] = _DROP_M + self._under(pose)
        self._stand(pose)
        self._refresh()
        self._advance(round(settle_s / self.model.opt.timestep))
        # Work and contacts of the settling time do not count.
        self._state.work[:] = 0.0
        self.data.time = 0.0
        self.t_ns, self._counts[:] = 0, 0
        return self.truth(self._imu_velocity())

    def step(self, voltage_v: FloatArray) -> Truth:
        """Advance by one control period.

        Args:
            voltage_v: (2,) motor voltages, left and right, V.

        Returns:
            The truth at the end of the period.
        """
        self._voltage[:] = voltage_v
        before = self._imu_velocity()
        self._advance(self.substeps)
        self.t_ns += self.substeps * self._dt_ns
        return self.truth(before)

    def brake(self, on: bool) -> None:
        """Put the holding brakes of both sprockets on or off; the voltages stay as they are.

        Args:
            on: whether the brakes hold from now on.
        """
        self._braked = on

    def ice(self, frictions: tuple[float | None, float | None]) -> None:
        """Change the ground's friction under the tracks at their present place.

        Args:
            frictions: coefficients under the left and the right track; None: the ground's own.
        """
        places = self.data.geom_xpos[self._wheel_geoms].reshape(2, -1, 3)
        rows = [
            (x - _WHEEL_M, y - _WHEEL_M, x + _WHEEL_M, y + _WHEEL_M, friction)
            for friction, side in zip(frictions, places, strict=True)
            if friction is not None
            for x, y, _ in side
        ]
        zones = self._ground.zones
        self._zones = self._ground._replace(zones=np.concatenate((zones, rows)) if rows else zones)

    def push(self, force_n: FloatArray) -> None:
        """Push the chassis from now on.

        Args:
            force_n: (2,) force at base_link's origin, in the world, N.
        """
        self._body.joint_force[:2] = force_n

    def move(self, places_m: FloatArray) -> None:
        """Move the movers evenly over the next control period.

        Args:
            places_m: (n, 2) positions at its end, in the world, m, in the model's order.
        """
        self._way = (places_m - self.data.mocap_pos[:, :2]) / self.substeps

    def put_down(self, pose: FloatArray) -> None:
        """Put the vehicle down somewhere else, at rest; the sprockets keep their angles.

        Args:
            pose: (3,) x, y, m, and yaw, rad, in the world.
        """
        self._stand(pose)
        self._qvel[:] = 0.0
        self._refresh()

    def truth(self, imu_before: FloatArray) -> Truth:
        """Read the truth of this instant.

        The proper acceleration is the mean over the last control period, as an averaging sensor
        measures it. Its axes are those of the period's end.

        Args:
            imu_before: (3,) the IMU's velocity in the world one control period ago, m/s.

        Returns:
            The truth. Its arrays are copies.
        """
        block = motion_now(
            self._qpos,
            self._qvel,
            self._sprocket_qpos,
            self._sprocket_dof,
            self._state.current,
            self._voltage,
            self._imu,
            imu_before,
            self.model.opt.gravity,
            self._period_s,
        )
        return Truth(
            t_ns=self.t_ns,
            pose_xyyaw=block[POSE],
            position_m=block[POSITION],
            quaternion_wxyz=block[QUATERNION],
            velocity_body=block[VELOCITY],
            acceleration_mps2=block[ACCELERATION],
            sprocket_rad=block[ANGLE],
            sprocket_radps=block[TURNING],
            motor_current_a=block[CURRENT],
            motor_voltage_v=block[VOLTAGE],
            energy_j=float(self._state.work[0]),
            contact_count=int(self._counts[CONTACTS]),
            in_contact=bool(self._counts[TOUCHING]),
            hit_count=int(self._counts[HITS]),
            unstable=self._unstable,
        )

    def track_truth(self) -> TrackTruth:
        """Read the state of the tracks now. Centres of rotation as in Martinez et al. 2005.

        Returns:
            Slip, centres of rotation, wheel loads and shear work.
        """
        velocity = self.truth(self._imu_velocity()).velocity_body
        belts = self._radius_m * self._qvel[self._sprocket_dof]
        icr = np.full(3, np.nan)
        if abs(velocity[5]) > _TURNING_RADPS:
            icr[:2] = (velocity[0] - belts) / velocity[5]
            icr[2] = -velocity[1] / velocity[5]
        state = self._state
        return TrackTruth(
            self.t_ns, state.slip.copy(), icr, state.load.copy(), float(state.work[1])
        )

    def loose_truth(self) -> LooseTruth | None:
        """Read the present poses of the movable bodies and the movers.

        Returns:
            Their poses; None if there are none.
        """
        if not self._loose:
            return None
        data = self.data
        return LooseTruth(
            self.t_ns, self._loose_names, data.xpos[self._loose], data.xquat[self._loose]
        )

    def work_j(self) -> FloatArray:
        """Compute the work since the reset, up to now. ``tracks.work`` lacks the last step's.

        Returns:
            (4,) J: electrical, shear, joint friction, motor shafts.
        """
        block = self._block.copy()
        settle_account(self._geoms, self._body, block, self._parameters)
        return np.array(block["work"][0], np.float64)

    def state_hash(self) -> str:
        """Compute a digest of the whole physical state.

        Returns:
            16 hexadecimal digits. They are equal only if every bit of the state is equal.
        """
        digest = hashlib.sha256()
        data = self.data
        for array in (data.qpos, data.qvel, data.act, data.mocap_pos, *self._state):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(self.t_ns.to_bytes(8, "little"))
        return digest.hexdigest()[:16]

    def _advance(self, steps: int) -> None:
        """Do physics steps."""
        tracks = (
            self._way,
            self._geoms,
            self._zones,
            self._voltage,
            self._braked,
            self._body,
            self._block,
            self._parameters,
            self._counts,
        )
        with warnings_heard() as heard:
            if self._engine is None:
                advance_plainly(steps, self.model, self.data, *tracks)
            else:
                advance(steps, self._engine, self.data.mocap_pos, *tracks)
        self._unstable = self._unstable or instability(self.data, self._qvel, heard)

    def _refresh(self) -> None:
        """Compute all that follows from positions and velocities."""
        with warnings_heard() as heard:
            mujoco.mj_forward(self.model, self.data)
        self._unstable = self._unstable or instability(self.data, self._qvel, heard)

    def _stand(self, pose: FloatArray) -> None:
        """Set position and heading to a pose (3,) on level ground. The height does not change."""
        self._qpos[:2] = pose[:2]
        self._qpos[3:7] = np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2)

    def _under(self, pose: FloatArray) -> float:
        """Compute the highest ground, m, under the road wheels at a pose (3,)."""
        if not self._terrain:
            return 0.0
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        x, y = self.model.geom_pos[self._wheel_geoms, :2].T
        places = np.stack([pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y], axis=1)
        return ground_height(self.model, self.data, self._terrain, places)

    def _imu_velocity(self) -> FloatArray:
        """Compute the IMU's velocity (3,) in the world now, m/s."""
        return point_velocity(self._qpos, self._qvel, self._imu)
