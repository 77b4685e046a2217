"""The plant: MuJoCo's rigid bodies, the tracks' forces on them, and rays cast among them.

The only room of the loop where the truth lives. It advances by one control period at a
time, takes motor voltages, and gives truth and ranges to the sensors.
"""

from __future__ import annotations

import copy
import hashlib

import mujoco
import numpy as np

from simloop.config import Config
from simloop.messages import FloatArray
from simloop.physics.track_kernel import apply_tracks, settle_account
from simloop.physics.track_model import (
    BodyArrays,
    ContactArrays,
    Geoms,
    TrackState,
    as_block,
    friction_map,
    state_block,
    track_parameters,
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
    carry_ranges,
    motion_now,
    point_velocity,
)
from simloop.physics.vehicle_geoms import (
    SEEN_GROUPS,
    geom_kinds,
    ground_height,
    is_free,
    road_wheels,
    site_in_base,
    sprocket_radius,
)
from simloop.truth import LooseTruth, TrackTruth, Truth

_GRAVITY_MPS2 = 9.81
_TURNING_RADPS = 0.02
_STILL_MPS = 0.01  # of the belts: what stands
_WHEEL_M = 0.06  # about a road wheel, what is under it; well within its own side


def _own_copy(model: mujoco.MjModel, config: Config) -> mujoco.MjModel:
    """A copy with this configuration's step and rotors.

    One world may serve several plants, and each step writes the joints' friction into the model.
    """
    model = copy.copy(model)
    model.opt.timestep = config.rates.physics_s
    dofs = [model.joint(f"sprocket_{side}_joint").dofadr[0] for side in ("left", "right")]
    model.dof_armature[dofs] = config.motor.rotor_inertia_kgm2
    return model


class Plant:
    """A vehicle in its arena, stepped with a fixed period.

    model: an arena with the vehicle attached (see ``arena.build``).
    """

    def __init__(self, model: mujoco.MjModel, config: Config) -> None:
        self.model = model = _own_copy(model, config)
        self._joint_friction = model.dof_frictionloss.copy()
        self.data = mujoco.MjData(model)
        self.substeps = round(config.rates.control_s / config.rates.physics_s)
        self._dt_ns = round(config.rates.physics_s * 1e9)
        wheels, self._radius_m = road_wheels(model), sprocket_radius(model)
        x = model.geom_pos[wheels, 0]
        self._parameters = as_block(
            track_parameters(
                config.tracks,
                config.motor,
                self._radius_m,
                config.rates.physics_s,
                0.5 * float(x[0] - x[len(x) // 2 - 1]) / (len(x) // 2 - 1),
                _GRAVITY_MPS2 * float(model.body_subtreemass[model.body("base_link").id]),
            )
        )
        self._ground = friction_map(config.tracks.zones, config.tracks.friction_image)
        self._zones = self._ground
        self._wheel_geoms = wheels
        joints = [model.joint(f"sprocket_{side}_joint") for side in ("left", "right")]
        # Loose things of the arena may come first: all that the kernels see begins at the vehicle.
        root = model.joint("root")
        at, dof = int(root.qposadr[0]), int(root.dofadr[0])
        self._sprocket_dof = np.array([j.dofadr[0] - dof for j in joints], np.int64)
        self._sprocket_qpos = np.array([j.qposadr[0] - at for j in joints], np.int64)
        self._geoms = Geoms(geom_kinds(model), model.geom_bodyid, self._sprocket_dof)
        self._base = model.body("base_link").id
        self._qpos, self._qvel = self.data.qpos[at:], self.data.qvel[dof:]  # views that stay
        self._period_s = config.rates.control_s
        self._imu = site_in_base(model, "imu")
        self._block = state_block(len(wheels))
        self._state = TrackState.within(self._block)
        self._voltage = np.zeros(2)
        self._braked = False
        self._body = BodyArrays(
            self.data.xpos[self._base],
            self.data.xmat[self._base],
            self._qvel,
            self.data.xipos,
            self.data.cvel,
            self.data.subtree_com,
            self.data.xfrc_applied,
            model.body_rootid,
            model.body_weldid != 0,
            self.data.qfrc_applied[dof:],
            self.data.qfrc_constraint[dof:],
            self.model.dof_frictionloss[dof:],
            self._base,
        )
        others = [i for i in range(1, model.nbody) if i != self._base]
        self._loose = [i for i in others if is_free(model, i) or model.body_mocapid[i] >= 0]
        self._loose_names = tuple(model.body(i).name for i in self._loose)
        self._terrain = [i for i in range(model.ngeom) if model.geom(i).name.startswith("ground_")]
        self._ray_groups = np.isin(np.arange(6), SEEN_GROUPS).astype(np.uint8)
        self.t_ns = 0
        self._contacts = self._hits = 0
        self._touching = False
        self._way: FloatArray | None = None

    @property
    def tracks(self) -> TrackState:
        """The tracks' inner state: brush displacements, wheel loads, currents, forces."""
        return self._state

    @property
    def sprocket_radius_m(self) -> float:
        """The sprockets' true radius, m, which the robot may believe to be another."""
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
        """Distances (n,) from ``origins_m`` (n, 3) along unit ``directions`` (n, 3).

        -1 where nothing is met within ``cutoff_m``. Rays see the arena and not the vehicle. The
        origins are those of one control period, millimetres apart: all rays are cast from the
        middle one in one call, and each range is then carried over to its own origin along the
        surface that was hit; a ray that grazes its surface is cast again on its own.
        """
        middle = origins_m[len(origins_m) // 2]
        ranges, normals = self._fan(middle, directions, cutoff_m)
        geom = np.empty(1, np.int32)
        for i in carry_ranges(ranges, normals, directions, origins_m, middle, cutoff_m):
            there = mujoco.mj_ray(
                self.model,
                self.data,
                origins_m[i],
                directions[i],
                self._ray_groups,
                1,
                self._base,
                geom,
            )
            ranges[i] = there if there <= cutoff_m else -1.0
        return ranges

    def look(self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """As ``cast``, with all rays from one origin (3,)."""
        ranges, _ = self._fan(origin_m, directions, cutoff_m)
        ranges[ranges > cutoff_m] = -1.0
        return ranges

    def _fan(
        self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (n,) along directions (n, 3) from one origin (3,), and the normals (n, 3) there;
        beyond the cutoff a range may be given or be -1."""
        n = len(directions)
        normals, ranges, geoms = np.empty((n, 3)), np.empty(n), np.empty(n, np.int32)
        mujoco.mj_multiRay(
            self.model,
            self.data,
            origin_m,
            directions.ravel(),
            self._ray_groups,
            1,
            self._base,
            geoms,
            ranges,
            normals.ravel(),
            n,
            cutoff_m,
        )
        return ranges, normals

    def reset(self, pose: FloatArray, settle_s: float = 0.5, braked: bool = False) -> Truth:
        """Put the vehicle at ``pose`` (3,) x, y, yaw, let it settle, and start the clock at 0.

        braked: whether the holding brakes are on from the beginning.
        """
        mujoco.mj_resetData(self.model, self.data)
        self.model.dof_frictionloss[:] = self._joint_friction
        self._zones, self._way = self._ground, None
        self._qpos[2] = 0.001 + self._under(pose)
        self._stand(pose)
        self._block[:] = state_block(len(self._wheel_geoms))
        self._voltage[:] = 0.0
        self._braked = braked
        mujoco.mj_forward(self.model, self.data)
        for _ in range(round(settle_s / self.model.opt.timestep)):
            self._step()
        self._state.work[:] = 0.0
        self.data.time = 0.0
        self.t_ns, self._contacts, self._hits, self._touching = 0, 0, 0, False
        return self.truth(self._imu_velocity())

    def _stand(self, pose: FloatArray) -> None:
        """Set place and heading to a pose (3,) on level ground; the height stays."""
        self._qpos[:2] = pose[:2]
        self._qpos[3:7] = np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2)

    def _under(self, pose: FloatArray) -> float:
        """How high the ground reaches under the road wheels at a pose (3,), m."""
        if not self._terrain:
            return 0.0
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        x, y = self.model.geom_pos[road_wheels(self.model), :2].T
        places = np.stack([pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y], axis=1)
        return ground_height(self.model, self.data, self._terrain, places)

    def work_j(self) -> FloatArray:
        """(4,) J since the reset: electrical, shear, joints' friction, motors' shafts.

        The last step's is in it, which ``tracks.work`` has only after the next one.
        """
        block = self._block.copy()
        settle_account(self._geoms, self._body, block, self._parameters)
        return np.array(block["work"][0], np.float64)

    def loose_truth(self) -> LooseTruth | None:
        """Where the loose things are now; None where there are none."""
        if not self._loose:
            return None
        data = self.data
        return LooseTruth(
            self.t_ns, self._loose_names, data.xpos[self._loose], data.xquat[self._loose]
        )

    def step(self, voltage_v: FloatArray) -> Truth:
        """Advance one control period under the motor voltages (2,) left, right."""
        self._voltage[:] = voltage_v
        before = self._imu_velocity()
        for _ in range(self.substeps):
            if self._way is not None:
                self.data.mocap_pos[:, :2] += self._way
            self._step()
        self.t_ns += self.substeps * self._dt_ns
        return self.truth(before)

    def brake(self, on: bool) -> None:
        """Put the holding brakes of both sprockets on or off; the voltages stay as they are."""
        self._braked = on

    def ice(self, frictions: tuple[float | None, float | None]) -> None:
        """The ground's friction under the left and the right track from now on; None: its own."""
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
        """A force (2,) on the chassis, in the world, from now on."""
        self._body.joint_force[:2] = force_n

    def move(self, places_m: FloatArray) -> None:
        """Where the movers, (n, 2) in the model's order, shall be after the next control period."""
        self._way = (places_m - self.data.mocap_pos[:, :2]) / self.substeps

    def put_down(self, pose: FloatArray) -> None:
        """Stand at ``pose`` (3,) x, y, yaw, at rest; the sprockets keep their angles."""
        self._stand(pose)
        self._qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def _step(self) -> None:
        contact, force = self.data.contact, self.data.efc_force
        apply_tracks(
            ContactArrays(contact.geom, contact.pos, contact.frame, contact.efc_address, force),
            self._geoms,
            self._zones,
            self._voltage,
            self._braked,
            self._body,
            self._block,
            self._parameters,
        )
        mujoco.mj_step(self.model, self.data)
        touching = bool(self._state.touching[0])
        if touching and not self._touching:
            stood = self._stands()
            self._hits, self._contacts = self._hits + stood, self._contacts + (not stood)
        self._touching = touching

    def _stands(self) -> bool:
        """Whether the robot itself stands still: its motors off, its belts at rest or, once it has
        been hit, no faster than it is pushed."""
        pushed = self._hits > 0
        belts = self._radius_m * np.abs(self._qvel[self._sprocket_dof]).max()
        return not self._voltage.any() and bool(pushed or belts < _STILL_MPS)

    def truth(self, velocity_before: FloatArray) -> Truth:
        """The truth now.

        The proper acceleration is the mean over the last control period, as an averaging sensor
        has it, in the axes of the period's end.

        Args:
            velocity_before: (3,) the IMU's velocity in the world one control period ago, m/s.

        Returns:
            The truth, whose arrays are its own.
        """
        block = motion_now(
            self._qpos,
            self._qvel,
            self._sprocket_qpos,
            self._sprocket_dof,
            self._state.current,
            self._voltage,
            self._imu,
            velocity_before,
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
            contact_count=self._contacts,
            in_contact=self._touching,
            hit_count=self._hits,
        )

    def _imu_velocity(self) -> FloatArray:
        """(3,) m/s, in the world, now."""
        return point_velocity(self._qpos, self._qvel, self._imu)

    def track_truth(self) -> TrackTruth:
        """What the tracks do now. Their centres of rotation: Martinez et al. 2005."""
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

    def state_hash(self) -> str:
        """A digest of the whole physical state: equal only where every bit is."""
        digest = hashlib.sha256()
        data = self.data
        for array in (data.qpos, data.qvel, data.act, data.mocap_pos, *self._state):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(self.t_ns.to_bytes(8, "little"))
        return digest.hexdigest()[:16]
