"""Track-ground forces with slip, the belt's reaction on its sprocket, and the motor's law.

MuJoCo solves the frictionless support contacts of the road wheels; the shear forces are
ours. Each road wheel carries a brush: a shear displacement z in its contact plane that
follows the slip of the belt over the ground and saturates at the shear modulus K
(bilinear form of Janosi & Hanamoto 1961):

    z <- z + v_slip dt,  |z| <= K
    F = -(mu N / K) (z + c v_slip),  |F| <= mu N

with N the support force of the last step, and v_slip the velocity of the belt's surface
over the ground. What the belt gives the ground, the sprocket pays: the torque on its joint
is -r sum(F . t), t the belt's direction at the contact, r the sprocket's radius.

The motor (EMG49) is a voltage source behind a resistance and a back electromotive force,
its current clipped by the driver; gear friction is the joint's ``frictionloss``, to which
the rolling resistance of the loaded track is added.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import MotorConfig, TracksConfig, VehicleConfig
from simloop.messages import FloatArray

WHEELS_A_SIDE = 6
# What a geom is, as the kernel sees it; road wheel i is WHEEL + i.
GROUND, OBSTACLE, HULL, WHEEL = 0, 1, 2, 3


class TrackParameters(NamedTuple):
    """Constants of the kernel; units as in the configuration, dt in s."""

    friction: float
    shear_modulus: float
    shear_damping: float
    rolling_resistance: float
    radius: float
    resistance: float
    torque_per_a: float
    back_emf: float
    current_limit: float
    gear_friction: float
    dt: float


class TrackState(NamedTuple):
    """What the kernel keeps and tells, all preallocated.

    shear: (2 * wheels, 3) brush displacement of each wheel, m: row 2 i on the ground, row
    2 i + 1 on anything else. load: (wheels,) N. current: (2,) A. track_force: (2,) N along the
    belt. drawn: (2,) J of electrical energy and of shear work. touching: (1,) contacts of the
    vehicle with anything but the ground.
    """

    shear: FloatArray
    load: FloatArray
    current: FloatArray
    track_force: FloatArray
    work: FloatArray
    touching: NDArray[np.int64]

    @classmethod
    def zeros(cls) -> TrackState:
        wheels = 2 * WHEELS_A_SIDE
        return cls(
            np.zeros((2 * wheels, 3)),
            np.zeros(wheels),
            np.zeros(2),
            np.zeros(2),
            np.zeros(2),
            np.zeros(1, np.int64),
        )


class BodyArrays(NamedTuple):
    """Views into MuJoCo's state that stay where they are: read, then written.

    position, rotation: (3,), (9,) of base_link; com: (3,); velocity: (nv,) qvel, whose first six
    are base_link's linear velocity (world) and angular velocity (base_link);
    wrench: (6,) external force and torque at com; joint_force, joint_friction: (nv,).
    """

    position: FloatArray
    rotation: FloatArray
    com: FloatArray
    velocity: FloatArray
    wrench: FloatArray
    joint_force: FloatArray
    joint_friction: FloatArray


def track_parameters(
    tracks: TracksConfig, motor: MotorConfig, vehicle: VehicleConfig, dt_s: float
) -> TrackParameters:
    """The kernel's constants from the configuration."""
    return TrackParameters(
        friction=tracks.friction,
        shear_modulus=tracks.shear_modulus_m,
        shear_damping=tracks.shear_damping_s,
        rolling_resistance=tracks.rolling_resistance,
        radius=vehicle.sprocket_radius_m,
        resistance=motor.resistance_ohm,
        torque_per_a=motor.torque_nm_per_a,
        back_emf=motor.back_emf_v_per_radps,
        current_limit=motor.current_limit_a,
        gear_friction=motor.no_load_current_a * motor.torque_nm_per_a,
        dt=dt_s,
    )


@njit(cache=True)
def _cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Any:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True)
def motor_current(voltage: float, speed: float, p: TrackParameters) -> float:
    """Armature current, A, at terminal voltage and output speed, rad/s, clipped by the driver."""
    current = (voltage - p.back_emf * speed) / p.resistance
    return min(max(current, -p.current_limit), p.current_limit)


@njit(cache=True)
def brush_force(z: FloatArray, slip: FloatArray, load: float, p: TrackParameters) -> Any:
    """Advance one brush in place and return its force (3 floats, N) on the vehicle.

    z: (3,) shear displacement, m, in the contact plane; slip: (3,) m/s, in the same plane.
    """
    for k in range(3):
        z[k] += slip[k] * p.dt
    size = math.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
    if size > p.shear_modulus:
        for k in range(3):
            z[k] *= p.shear_modulus / size
    scale = -p.friction * load / p.shear_modulus
    fx = scale * (z[0] + p.shear_damping * slip[0])
    fy = scale * (z[1] + p.shear_damping * slip[1])
    fz = scale * (z[2] + p.shear_damping * slip[2])
    force, most = math.sqrt(fx * fx + fy * fy + fz * fz), p.friction * load
    if force > most:
        fx, fy, fz = fx * most / force, fy * most / force, fz * most / force
    return fx, fy, fz


@njit(cache=True)
def apply_tracks(
    contact_geom: NDArray[np.int32],
    contact_pos: FloatArray,
    contact_frame: FloatArray,
    contact_row: NDArray[np.int32],
    row_force: FloatArray,
    kind: NDArray[np.int64],
    sprocket_dof: NDArray[np.int64],
    voltage: FloatArray,
    body: BodyArrays,
    state: TrackState,
    p: TrackParameters,
) -> None:
    """Write one step's shear forces, sprocket reactions and motor torques into ``body``.

    contact_*: MuJoCo's contacts, (n, 2), (n, 3), (n, 9), (n,); row_force: (nefc,) its
    constraint forces. kind: (ngeom,) what each geom is. voltage: (2,) left, right.
    """
    pos, rot, com, vel = body.position, body.rotation, body.com, body.velocity
    # Angular velocity to the world; the belt runs along t = (body's y axis) x (contact normal).
    wx = rot[0] * vel[3] + rot[1] * vel[4] + rot[2] * vel[5]
    wy = rot[3] * vel[3] + rot[4] * vel[4] + rot[5] * vel[5]
    wz = rot[6] * vel[3] + rot[7] * vel[4] + rot[8] * vel[5]
    body.wrench[:] = 0.0
    state.load[:] = 0.0
    state.track_force[:] = 0.0
    state.touching[0] = 0
    used = np.zeros(state.shear.shape[0], np.bool_)
    slip = np.empty(3)
    for c in range(contact_geom.shape[0]):
        first, second = kind[contact_geom[c, 0]], kind[contact_geom[c, 1]]
        mine, other = max(first, second), min(first, second)
        if mine >= HULL and other == OBSTACLE:
            state.touching[0] += 1
        if mine < WHEEL or contact_row[c] < 0:
            continue
        load = row_force[contact_row[c]]
        if load <= 0.0:
            continue
        sign = 1.0 if second >= WHEEL else -1.0  # MuJoCo's normal points from first to second
        nx, ny = sign * contact_frame[c, 0], sign * contact_frame[c, 1]
        nz = sign * contact_frame[c, 2]
        tx, ty, tz = _cross(rot[1], rot[4], rot[7], nx, ny, nz)
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        if size < 1e-9:  # the wheel is touched on its side: no belt there
            continue
        tx, ty, tz = tx / size, ty / size, tz / size
        wheel = mine - WHEEL
        side = wheel // WHEELS_A_SIDE
        belt = p.radius * vel[sprocket_dof[side]]
        ox, oy, oz = contact_pos[c, 0], contact_pos[c, 1], contact_pos[c, 2]
        ux, uy, uz = _cross(wx, wy, wz, ox - pos[0], oy - pos[1], oz - pos[2])
        slip[0] = vel[0] + ux - belt * tx
        slip[1] = vel[1] + uy - belt * ty
        slip[2] = vel[2] + uz - belt * tz
        slot = 2 * wheel + (1 if other == OBSTACLE else 0)
        z = state.shear[slot]
        away = slip[0] * nx + slip[1] * ny + slip[2] * nz
        off = z[0] * nx + z[1] * ny + z[2] * nz
        for k, n in enumerate((nx, ny, nz)):
            slip[k] -= away * n
            z[k] -= off * n
        fx, fy, fz = brush_force(z, slip, load, p)
        used[slot] = True
        state.load[wheel] += load
        state.track_force[side] += fx * tx + fy * ty + fz * tz
        state.work[1] -= (fx * slip[0] + fy * slip[1] + fz * slip[2]) * p.dt
        mx, my, mz = _cross(ox - com[0], oy - com[1], oz - com[2], fx, fy, fz)
        for k, value in enumerate((fx, fy, fz, mx, my, mz)):
            body.wrench[k] += value
    for slot in range(used.shape[0]):
        if not used[slot]:
            state.shear[slot, :] = 0.0
    for side in range(2):
        dof = sprocket_dof[side]
        current = motor_current(voltage[side], vel[dof], p)
        state.current[side] = current
        state.work[0] += voltage[side] * current * p.dt
        body.joint_force[dof] = p.torque_per_a * current - p.radius * state.track_force[side]
        load = 0.0
        for i in range(WHEELS_A_SIDE):
            load += state.load[side * WHEELS_A_SIDE + i]
        body.joint_friction[dof] = p.gear_friction + p.rolling_resistance * load * p.radius
