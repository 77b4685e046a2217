"""The compiled step of the tracks: contacts to patches, patches to shear, shear to sprockets.

See ``tracks`` for the model and for what the arrays hold, ``brush`` for the shear of one cell.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.brush import advance_cell, cell_force
from simloop.physics.track_model import (
    HULL,
    OBSTACLE,
    PATCHES,
    WHEEL,
    BodyArrays,
    ContactArrays,
    FrictionMap,
    Geoms,
    Record,
    TrackParameters,
    friction_at,
    motor_current,
)

_SAME_SURFACE = 0.9  # cosine between a patch's normals in two steps
_ON_ITS_SIDE = 0.7  # part of the normal along the axle beyond which no belt touches


@njit(cache=True, error_model="numpy")
def _cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Any:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, error_model="numpy")
def _patch_of(
    state: Record, touched: FloatArray, wheel: int, body: int, nx: float, ny: float, nz: float
) -> int:
    """The patch of a wheel for a contact with this body and normal (in base_link)."""
    best, free, likest = -1, -1, -2.0
    for s in range(PATCHES):
        normal = state.normal[wheel, s]
        cosine = normal[0] * nx + normal[1] * ny + normal[2] * nz
        known = cosine != 0.0 and state.body[wheel, s] == body
        if known and cosine > likest:
            best, likest = s, cosine
        if touched[wheel, s, 0] == 0.0 and (free < 0 or not np.any(normal)):
            free = s
    if likest < _SAME_SURFACE and free >= 0:
        best = free
        state.mean[wheel, best] = 0.0
        state.outlet[wheel, best] = 0.0
    best = max(best, 0)
    if touched[wheel, best, 0] == 0.0:
        state.body[wheel, best] = body
        state.normal[wheel, best, 0] = nx
        state.normal[wheel, best, 1] = ny
        state.normal[wheel, best, 2] = nz
    return best


@njit(cache=True, error_model="numpy")
def _gather(
    contacts: ContactArrays, geoms: Geoms, body: BodyArrays, state: Record, touched: FloatArray
) -> None:
    """Sum the contacts into patches: touched (wheels, patches, 7) load, and p and n times it."""
    rot = body.rotation
    for c in range(contacts.geom.shape[0]):
        one, two = contacts.geom[c, 0], contacts.geom[c, 1]
        first, second = geoms.kind[one], geoms.kind[two]
        mine, other = max(first, second), min(first, second)
        if mine >= HULL and other == OBSTACLE:
            state.touching[0] += 1
        if mine < WHEEL or other >= HULL or contacts.row[c] < 0:
            continue
        load = contacts.force[contacts.row[c]]
        if load <= 0.0:
            continue
        sign = 1.0 if second >= WHEEL else -1.0  # MuJoCo's normal points from first to second
        n = contacts.frame[c]
        nx, ny, nz = sign * n[0], sign * n[1], sign * n[2]
        bx = rot[0] * nx + rot[3] * ny + rot[6] * nz
        by = rot[1] * nx + rot[4] * ny + rot[7] * nz
        bz = rot[2] * nx + rot[5] * ny + rot[8] * nz
        wheel = mine - WHEEL
        state.load[wheel] += load
        if abs(by) > _ON_ITS_SIDE:
            continue
        on = geoms.body[one] if second >= WHEEL else geoms.body[two]
        patch = _patch_of(state, touched, wheel, on, bx, by, bz)
        row = touched[wheel, patch]
        row[0] += load
        for k in range(3):
            row[1 + k] += load * contacts.pos[c, k]
        row[4] += load * nx
        row[5] += load * ny
        row[6] += load * nz


@njit(cache=True, error_model="numpy")
def _forget_and_rank(state: Record, touched: FloatArray) -> None:
    """Belt that touches nothing is unstrained; of a wheel's patches the most loaded leads on."""
    for wheel in range(state.wheels):
        state.main[wheel] = -1
        most = 0.0
        for s in range(PATCHES):
            load = touched[wheel, s, 0]
            if load == 0.0:
                state.mean[wheel, s] = 0.0
                state.outlet[wheel, s] = 0.0
                state.normal[wheel, s] = 0.0
            elif load > most:
                most = load
                state.main[wheel] = s


@njit(cache=True, error_model="numpy")
def _push(body: BodyArrays, number: int, point: Any, force: Any, sign: float) -> None:
    px, py, pz = point
    fx, fy, fz = sign * force[0], sign * force[1], sign * force[2]
    com, wrench = body.com[number], body.wrench[number]
    mx, my, mz = _cross(px - com[0], py - com[1], pz - com[2], fx, fy, fz)
    wrench[0] += fx
    wrench[1] += fy
    wrench[2] += fz
    wrench[3] += mx
    wrench[4] += my
    wrench[5] += mz


@njit(cache=True, error_model="numpy")
def _velocity(body: BodyArrays, number: int, x: float, y: float, z: float) -> Any:
    """Velocity, m/s, of a body's point, in the world, as of the last step."""
    v, about = body.cvel[number], body.subtree_com[body.root[number]]
    ux, uy, uz = _cross(v[0], v[1], v[2], x - about[0], y - about[1], z - about[2])
    return v[3] + ux, v[4] + uy, v[5] + uz


@njit(cache=True, error_model="numpy")
def _shear_patch(
    row: FloatArray,
    wheel: int,
    s: int,
    spin: Any,
    friction: float,
    entering: FloatArray,
    belt: float,
    body: BodyArrays,
    state: Record,
    p: TrackParameters,
) -> Any:
    """Advance a patch's two cells and apply their shear; thrust, N, and slip along it, m/s."""
    pos, rot, vel = body.position, body.rotation, body.velocity
    load = row[0]
    size = math.sqrt(row[4] * row[4] + row[5] * row[5] + row[6] * row[6])
    nx, ny, nz = row[4] / size, row[5] / size, row[6] / size
    # The belt runs along t = (body's y axis) x normal; across it, s = n x t.
    tx, ty, tz = _cross(rot[1], rot[4], rot[7], nx, ny, nz)
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx / size, ty / size, tz / size
    sx, sy, sz = _cross(nx, ny, nz, tx, ty, tz)
    number = state.body[wheel, s]
    slip, rate = state.sliding, state.rate
    thrust, slipping = 0.0, 0.0
    for step in range(2):
        half = step if belt >= 0.0 else 1 - step  # along the belt's own way over the ground
        ahead = (0.5 - half) * p.cell
        x, y = row[1] / load + ahead * tx, row[2] / load + ahead * ty
        z = row[3] / load + ahead * tz
        ux, uy, uz = _cross(spin[0], spin[1], spin[2], x - pos[0], y - pos[1], z - pos[2])
        ux, uy, uz = vel[0] + ux, vel[1] + uy, vel[2] + uz
        if body.moves[number]:
            ox, oy, oz = _velocity(body, number, x, y, z)
            ux, uy, uz = ux - ox, uy - oy, uz - oz
        slip[0] = ux * tx + uy * ty + uz * tz - belt
        slip[1] = ux * sx + uy * sy + uz * sz
        mean, outlet = state.mean[wheel, s, half], state.outlet[wheel, s, half]
        advance_cell(mean, outlet, rate, entering, slip, belt, p.cell, p.shear_modulus, p.dt)
        most = 0.5 * friction * min(load, p.most_load)
        along, across = cell_force(mean, rate, p.shear_modulus, p.shear_damping, most)
        entering[0], entering[1] = outlet[0], outlet[1]
        force = (along * tx + across * sx, along * ty + across * sy, along * tz + across * sz)
        _push(body, body.base, (x, y, z), force, 1.0)
        if body.moves[number]:
            _push(body, number, (x, y, z), force, -1.0)
        thrust += along
        slipping += 0.5 * slip[0]
    return thrust, slipping


@njit(cache=True, error_model="numpy")
def _spin(body: BodyArrays) -> Any:
    """Angular velocity of base_link, rad/s, in the world."""
    rot, vel = body.rotation, body.velocity
    return (
        rot[0] * vel[3] + rot[1] * vel[4] + rot[2] * vel[5],
        rot[3] * vel[3] + rot[4] * vel[4] + rot[5] * vel[5],
        rot[6] * vel[3] + rot[7] * vel[4] + rot[8] * vel[5],
    )


@njit(cache=True, error_model="numpy")
def _account(spin: Any, geoms: Geoms, body: BodyArrays, state: Record, p: TrackParameters) -> None:
    """Add the last step's work, J: its forces times the mean of the velocities before and after.

    So the kinetic energy that a force gives in a step is what it is said to have given, exactly.
    """
    vel, pos = body.velocity, body.position
    com, wrench, last = body.com[body.base], body.wrench[body.base], state.last
    arm = (com[0] - pos[0], com[1] - pos[1], com[2] - pos[2])
    ux, uy, uz = _cross(spin[0], spin[1], spin[2], arm[0], arm[1], arm[2])
    twist = (vel[0] + ux, vel[1] + uy, vel[2] + uz, spin[0], spin[1], spin[2])
    shear = 0.0
    for k in range(6):
        shear -= wrench[k] * 0.5 * (last[k] + twist[k])
        last[k] = twist[k]
    for number in range(1, body.moves.shape[0]):
        if number != body.base and body.moves[number] and np.any(body.wrench[number]):
            at, force = body.com[number], body.wrench[number]
            vx, vy, vz = _velocity(body, number, at[0], at[1], at[2])
            v = body.cvel[number]
            shear -= force[0] * vx + force[1] * vy + force[2] * vz
            shear -= force[3] * v[0] + force[4] * v[1] + force[5] * v[2]
    for side in range(2):
        dof = geoms.sprocket_dof[side]
        speed = 0.5 * (last[6 + side] + vel[dof])
        last[6 + side] = vel[dof]
        shear += p.radius * state.track_force[side] * speed
        state.work[2] -= body.joint_constraint[dof] * speed * p.dt
        state.work[3] += p.torque_per_a * state.current[side] * speed * p.dt
    state.work[1] += shear * p.dt


@njit(cache=True, error_model="numpy")
def settle_account(
    geoms: Geoms, body: BodyArrays, block: NDArray[np.void], constants: NDArray[np.void]
) -> None:
    """Add the work of the step just done to ``block``, which `apply_tracks` would do in the next:
    for a copy of it, where the balance of energy is asked for between two steps.
    """
    _account(_spin(body), geoms, body, block[0], constants[0])


@njit(cache=True, error_model="numpy")
def _drive(
    side: int,
    track_load: float,
    voltage: float,
    braked: bool,
    geoms: Geoms,
    body: BodyArrays,
    state: Record,
    p: TrackParameters,
) -> None:
    """The motor's torque, the belt's reaction and the friction on one sprocket's joint."""
    dof = geoms.sprocket_dof[side]
    current = motor_current(voltage, body.velocity[dof], p)
    state.current[side] = current
    # Where the driver clips the current it lowers the terminal's voltage to what drives just that.
    terminal = p.resistance * current + p.back_emf * body.velocity[dof]
    state.work[0] += terminal * current * p.dt
    body.joint_force[dof] = p.torque_per_a * current - p.radius * state.track_force[side]
    friction = p.gear_friction + p.rolling_resistance * track_load * p.radius
    body.joint_friction[dof] = friction + (p.brake_torque if braked else 0.0)


@njit(cache=True, error_model="numpy")
def apply_tracks(
    contacts: ContactArrays,
    geoms: Geoms,
    zones: FrictionMap,
    voltage: FloatArray,
    braked: bool,
    body: BodyArrays,
    block: NDArray[np.void],
    constants: NDArray[np.void],
) -> None:
    """Write one step's shear forces, sprocket reactions and motor torques into ``body``.

    zones: see ``friction_map``. voltage: (2,) left, right. block: (1,) a `TrackState` and more;
    constants: (1,) the `TrackParameters`.
    """
    state, p = block[0], constants[0]
    vel, spin = body.velocity, _spin(body)
    wheels = state.wheels
    a_side = wheels // 2
    _account(spin, geoms, body, state, p)
    body.wrench[:] = 0.0
    state.load[:] = 0.0
    state.touching[0] = 0
    touched = state.touched
    touched[:wheels] = 0.0
    _gather(contacts, geoms, body, state, touched)
    _forget_and_rank(state, touched)
    entering = state.entering
    for side in range(2):
        belt = p.radius * vel[geoms.sprocket_dof[side]]
        thrust, slipping, track_load = 0.0, 0.0, 0.0
        for step in range(a_side):
            i = step if belt >= 0.0 else a_side - 1 - step
            wheel = side * a_side + i
            upstream = wheel - 1 if belt >= 0.0 else wheel + 1
            track_load += state.load[wheel]
            for s in range(PATCHES):
                row = touched[wheel, s]
                if row[0] == 0.0:
                    continue
                entering[:] = 0.0
                if step > 0 and state.main[upstream] >= 0:
                    half = 1 if belt >= 0.0 else 0
                    entering[:] = state.outlet[upstream, state.main[upstream], half]
                friction = p.friction
                if not body.moves[state.body[wheel, s]]:
                    friction = friction_at(row[1] / row[0], row[2] / row[0], zones, p.friction)
                force, slip = _shear_patch(
                    row, wheel, s, spin, friction, entering, belt, body, state, p
                )
                thrust += force
                slipping += slip * row[0]
        state.track_force[side] = thrust
        state.slip[side] = slipping / track_load if track_load > 0.0 else 0.0
        _drive(side, track_load, voltage[side], braked, geoms, body, state, p)
