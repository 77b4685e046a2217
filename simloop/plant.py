"""The plant: MuJoCo's rigid bodies, the tracks' forces on them, and rays cast among them.

The only room of the loop where the truth lives. It advances by one control period at a
time, takes motor voltages, and gives truth and ranges to the sensors.
"""

from __future__ import annotations

import copy
import hashlib
import math

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.arena import SEEN_GROUPS, is_free
from simloop.config import Config
from simloop.messages import FloatArray, LooseTruth, TrackTruth, Truth
from simloop.track_kernel import apply_tracks, settle_account
from simloop.tracks import (
    GROUND,
    HULL,
    OBSTACLE,
    WHEEL,
    BodyArrays,
    ContactArrays,
    Geoms,
    TrackState,
    as_block,
    friction_map,
    state_block,
    track_parameters,
)

_GRAVITY_MPS2 = 9.81
_GRAZING = 0.15  # cosine between a ray and the surface's normal below which it grazes
_FAR_M = 0.01
_ABOVE_M = 10.0
_TURNING_RADPS = 0.02


def geom_kinds(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) what each geom is to the tracks: ground, obstacle, hull or road wheel i.

    Ground is ``floor`` and whatever is named ``ground_*`` or ``loose_*`` (things that may be
    pushed about); the vehicle is the tree under base_link.
    """
    root = model.body("base_link").id
    kinds = np.full(model.ngeom, OBSTACLE, np.int64)
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if model.body_rootid[model.geom_bodyid[geom]] == root:
            kinds[geom] = HULL
        elif name == "floor" or name.startswith(("ground_", "loose_")):
            kinds[geom] = GROUND
    for number, geom in enumerate(road_wheels(model)):
        kinds[geom] = WHEEL + number
    return kinds


def road_wheels(model: mujoco.MjModel) -> list[int]:
    """The road wheels' geoms, ``road_left_0`` (the foremost), ``road_left_1``, ..., then the right.

    Raises ValueError where the sides differ in number or there are fewer than two.
    """
    sides = []
    for label in ("left", "right"):
        count = 0
        while mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"road_{label}_{count}") >= 0:
            count += 1
        sides.append([model.geom(f"road_{label}_{i}").id for i in range(count)])
    if len(sides[0]) != len(sides[1]) or len(sides[0]) < 2:
        raise ValueError("each side of the vehicle needs as many road wheels, two or more")
    return sides[0] + sides[1]


@njit(cache=True)
def carry_ranges(
    ranges: FloatArray,
    normals: FloatArray,
    directions: FloatArray,
    origins: FloatArray,
    middle: FloatArray,
    cutoff: float,
) -> NDArray[np.int64]:
    """Carry ranges (n,) in place from ``middle`` (3,) to ``origins`` (n, 3), surfaces being planes.

    r' = r - (d . n) / (u . n) with n the surface's normal, d the offset, u the ray; -1 beyond
    ``cutoff``. Returns the indices of rays that meet their surface at too flat an angle for that.
    """
    flat = np.empty(ranges.shape[0], np.int64)
    count = 0
    for i in range(ranges.shape[0]):
        if ranges[i] < 0.0:
            continue
        along, off = 0.0, 0.0
        for k in range(3):
            along += directions[i, k] * normals[i, k]
            off += (origins[i, k] - middle[k]) * normals[i, k]
        if abs(along) < _GRAZING or abs(off) > _FAR_M:
            flat[count] = i
            count += 1
        else:
            ranges[i] -= off / along
            if ranges[i] > cutoff:
                ranges[i] = -1.0
    return flat[:count]


@njit(cache=True)
def body_motion(
    qpos: FloatArray,
    qvel: FloatArray,
    rotation: FloatArray,
    before: FloatArray,
    period_s: float,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> None:
    """Write the planar pose (3,), velocity in base_link (6,), mean proper acceleration there (3,).

    The arguments before are those of ``motion_now``.
    """
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    pose[0], pose[1] = qpos[0], qpos[1]
    pose[2] = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    for i in range(3):
        velocity[i], acceleration[i] = 0.0, rotation[6 + i] * _GRAVITY_MPS2
        velocity[3 + i] = qvel[3 + i]
        for k in range(3):
            velocity[i] += rotation[3 * k + i] * qvel[k]
            acceleration[i] += rotation[3 * k + i] * (qvel[k] - before[k]) / period_s


# Where each array of a Truth stands in the one block that the kernel fills.
_POSE, _VELOCITY, _ACCELERATION = slice(0, 3), slice(3, 9), slice(9, 12)
_POSITION, _QUATERNION = slice(12, 15), slice(15, 19)
_ANGLE, _TURNING = slice(19, 21), slice(21, 23)
_CURRENT, _VOLTAGE = slice(23, 25), slice(25, 27)


@njit(cache=True)
def motion_now(
    qpos: FloatArray,
    qvel: FloatArray,
    sprocket_qpos: NDArray[np.int64],
    sprocket_dof: NDArray[np.int64],
    current: FloatArray,
    voltage: FloatArray,
    rotation: FloatArray,
    before: FloatArray,
    period_s: float,
) -> FloatArray:
    """(27,) all arrays of a Truth in one block, see the slices above.

    qpos, qvel: MuJoCo's, the vehicle's free joint first; sprocket_*: (2,) where the sprockets
    are in them; rotation: (9,) world_from_base; before: (3,) world velocity one period ago.
    """
    block = np.empty(27)
    body_motion(qpos, qvel, rotation, before, period_s, block[:3], block[3:9], block[9:12])
    block[12:19] = qpos[:7]
    for side in range(2):
        block[19 + side] = qpos[sprocket_qpos[side]]
        block[21 + side] = qvel[sprocket_dof[side]]
        block[23 + side], block[25 + side] = current[side], voltage[side]
    return block


def _of_its_own(model: mujoco.MjModel, config: Config) -> mujoco.MjModel:
    """The model with this configuration's step and rotors: a copy, unless it has them already.

    One world may serve several plants at once.
    """
    step_s, inertia = config.rates.physics_s, config.motor.rotor_inertia_kgm2
    dofs = [model.joint(f"sprocket_{side}_joint").dofadr[0] for side in ("left", "right")]
    if model.opt.timestep != step_s or np.any(model.dof_armature[dofs] != inertia):
        model = copy.copy(model)
        model.opt.timestep = step_s
        model.dof_armature[dofs] = inertia
    return model


class Plant:
    """A vehicle in its arena, stepped with a fixed period.

    model: an arena with the vehicle attached (see ``arena.build``).
    """

    def __init__(self, model: mujoco.MjModel, config: Config) -> None:
        self.model = model = _of_its_own(model, config)
        self.data = mujoco.MjData(model)
        self.substeps = round(config.rates.control_s / config.rates.physics_s)
        self._dt_ns = round(config.rates.physics_s * 1e9)
        wheels = road_wheels(model)
        x = model.geom_pos[wheels, 0]
        self._parameters = as_block(
            track_parameters(
                config.tracks,
                config.motor,
                config.vehicle,
                config.rates.physics_s,
                0.5 * float(x[0] - x[len(x) // 2 - 1]) / (len(x) // 2 - 1),
                _GRAVITY_MPS2 * float(model.body_subtreemass[model.body("base_link").id]),
            )
        )
        self._radius_m = config.vehicle.sprocket_radius_m
        self._zones = friction_map(config.tracks.zones, config.tracks.friction_image)
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
        self._loose = [i for i in range(1, model.nbody) if i != self._base and is_free(model, i)]
        self._loose_names = tuple(model.body(i).name for i in self._loose)
        self._terrain = [i for i in range(model.ngeom) if model.geom(i).name.startswith("ground_")]
        self._ray_groups = np.isin(np.arange(6), SEEN_GROUPS).astype(np.uint8)
        self.t_ns = 0
        self._contacts = 0
        self._touching = False

    @property
    def tracks(self) -> TrackState:
        """The tracks' inner state: brush displacements, wheel loads, currents, forces."""
        return self._state

    @property
    def base_from_laser(self) -> FloatArray:
        """(3,) position of the laser in base_link, m; its axes are base_link's."""
        return self.model.site("lidar").pos.copy()

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Distances (n,) from ``origins_m`` (n, 3) along unit ``directions`` (n, 3).

        -1 where nothing is met within ``cutoff_m``. Rays see the arena and not the vehicle. The
        origins are those of one control period, millimetres apart: all rays are cast from the
        middle one in one call, and each range is then carried over to its own origin along the
        surface that was hit; a ray that grazes its surface is cast again on its own.
        """
        n, model, data = len(origins_m), self.model, self.data
        normals, ranges, geoms = np.empty((n, 3)), np.empty(n), np.empty(n, np.int32)
        middle = origins_m[n // 2]
        mujoco.mj_multiRay(
            model,
            data,
            middle,
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
        for i in carry_ranges(ranges, normals, directions, origins_m, middle, cutoff_m):
            there = mujoco.mj_ray(
                model, data, origins_m[i], directions[i], self._ray_groups, 1, self._base, geoms[:1]
            )
            ranges[i] = there if there <= cutoff_m else -1.0
        return ranges

    def reset(self, pose: FloatArray, settle_s: float = 0.5, braked: bool = False) -> Truth:
        """Put the vehicle at ``pose`` (3,) x, y, yaw, let it settle, and start the clock at 0.

        braked: whether the holding brakes are on from the beginning.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._qpos[:3] = pose[0], pose[1], 0.001 + self._ground_height(pose)
        self._qpos[3:7] = np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2)
        for array in self._state:
            array[...] = 0
        self._voltage[:] = 0.0
        self._braked = braked
        mujoco.mj_forward(self.model, self.data)
        for _ in range(round(settle_s / self.model.opt.timestep)):
            self._step()
        self._state.work[:] = 0.0
        self.data.time = 0.0
        self.t_ns, self._contacts, self._touching = 0, 0, False
        return self.truth(self._qvel[:3].copy())

    def _ground_height(self, pose: FloatArray) -> float:
        """How high the ground reaches under the road wheels at a pose (3,), m."""
        if not self._terrain:
            return 0.0
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        down, normal, highest = np.array([0.0, 0.0, -1.0]), np.zeros(3), 0.0
        for wheel in road_wheels(model):
            x, y = model.geom_pos[wheel, :2]
            above = np.array([pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y, _ABOVE_M])
            for geom in self._terrain:
                if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_HFIELD:
                    far = mujoco.mj_rayHfield(model, data, geom, above, down, normal)
                elif model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                    far = mujoco.mj_rayMesh(model, data, geom, above, down, normal)
                else:
                    far = mujoco.mju_rayGeom(
                        data.geom_xpos[geom],
                        data.geom_xmat[geom],
                        model.geom_size[geom],
                        above,
                        down,
                        int(model.geom_type[geom]),
                        normal,
                    )
                highest = max(highest, _ABOVE_M - far if far >= 0.0 else 0.0)
        return highest

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
        before = self._qvel[:3].copy()
        for _ in range(self.substeps):
            self._step()
        self.t_ns += self.substeps * self._dt_ns
        return self.truth(before)

    def brake(self, on: bool) -> None:
        """Put the holding brakes of both sprockets on or off; the voltages stay as they are."""
        self._braked = on

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
        self._contacts += touching and not self._touching
        self._touching = touching

    def truth(self, velocity_before: FloatArray) -> Truth:
        """The truth now. velocity_before: (3,) world velocity one control period ago.

        The proper acceleration is the mean over that period, as an averaging sensor has it.
        """
        block = motion_now(
            self._qpos,
            self._qvel,
            self._sprocket_qpos,
            self._sprocket_dof,
            self._state.current,
            self._voltage,
            self._body.rotation,
            velocity_before,
            self._period_s,
        )
        return Truth(
            t_ns=self.t_ns,
            pose_xyyaw=block[_POSE],
            position_m=block[_POSITION],
            quaternion_wxyz=block[_QUATERNION],
            velocity_body=block[_VELOCITY],
            acceleration_mps2=block[_ACCELERATION],
            sprocket_rad=block[_ANGLE],
            sprocket_radps=block[_TURNING],
            motor_current_a=block[_CURRENT],
            motor_voltage_v=block[_VOLTAGE],
            energy_j=float(self._state.work[0]),
            contact_count=self._contacts,
            in_contact=self._touching,
        )

    def track_truth(self) -> TrackTruth:
        """What the tracks do now. Their centres of rotation: Martinez et al. 2005."""
        velocity = self.truth(self._qvel[:3]).velocity_body
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
        for array in (self.data.qpos, self.data.qvel, self.data.act, *self._state):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(self.t_ns.to_bytes(8, "little"))
        return digest.hexdigest()[:16]
