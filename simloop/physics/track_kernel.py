"""The compiled step of the tracks: from contacts to patches, to shear, to sprocket torques.

`track_model` describes the model and the arrays, `track_contacts` the patches, and `brush` the
shear of one cell. docs/tracks.md holds the derivation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.brush import advance_cell, cell_force
from simloop.physics.track_contacts import forget_and_rank, gather
from simloop.physics.track_model import (
    PATCHES,
    BodyArrays,
    ContactArrays,
    FrictionMap,
    Geoms,
    Record,
    TrackParameters,
    friction_at,
    motor_current,
)


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
    """Write the tracks' forces and torques of the next physics step into MuJoCo's inputs.

    The normal loads are those of the last step's contacts: the shear is explicit in time.

    Args:
        contacts: MuJoCo's contacts of the last step.
        geoms: kind of each geom.
        zones: the ground's friction, see `friction_map`.
        voltage: (2,) motor voltages, left and right, V.
        braked: whether the holding brakes are on.
        body: views into MuJoCo's state; ``wrench``, ``joint_force`` and ``joint_friction`` are
            written.
        block: (1,) of `STATE_BLOCK`; updated.
        constants: (1,) the `TrackParameters`, see `as_block`.
    """
    state, p = block[0], constants[0]
    spin = _spin(body)
    # Count the last step's work first, because its forces are overwritten below.
    _account(spin, geoms, body, state, p)
    # Contacts become patches with a load, a centre of pressure and a normal.
    body.wrench[:] = 0.0
    state.load[:] = 0.0
    state.touching[0] = 0
    touched = state.touched
    touched[: state.wheels] = 0.0
    gather(contacts, geoms, body, state, touched)
    forget_and_rank(state, touched)
    # The patches' shear acts on the chassis and the ground. Its sum acts on the sprocket.
    for side in range(2):
        track_load = _shear_belt(side, spin, zones, touched, geoms, body, state, p)
        _drive(side, track_load, voltage[side], braked, geoms, body, state, p)


@njit(cache=True, error_model="numpy")
def settle_account(
    geoms: Geoms, body: BodyArrays, block: NDArray[np.void], constants: NDArray[np.void]
) -> None:
    """Add the work of the last step, which `apply_tracks` would add in the next step.

    Apply it to a copy of the block, to balance the energy between two steps.

    Args:
        geoms: kind of each geom.
        body: views into MuJoCo's state.
        block: (1,) of `STATE_BLOCK`; ``work`` and ``last`` are updated.
        constants: (1,) the `TrackParameters`.
    """
    _account(_spin(body), geoms, body, block[0], constants[0])


@njit(cache=True, error_model="numpy", forceinline=True)
def _cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Any:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, error_model="numpy")
def _spin(body: BodyArrays) -> Any:
    """Compute the angular velocity of base_link in the world, rad/s."""
    rot, vel = body.rotation, body.velocity
    return (
        rot[0] * vel[3] + rot[1] * vel[4] + rot[2] * vel[5],
        rot[3] * vel[3] + rot[4] * vel[4] + rot[5] * vel[5],
        rot[6] * vel[3] + rot[7] * vel[4] + rot[8] * vel[5],
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _velocity(body: BodyArrays, number: int, x: float, y: float, z: float) -> Any:
    """Compute the velocity of a body's point in the world, m/s, as of the last step."""
    # MuJoCo's cvel is (angular, linear), the linear part at the tree's centre of mass.
    v, about = body.cvel[number], body.subtree_com[body.root[number]]
    ux, uy, uz = _cross(v[0], v[1], v[2], x - about[0], y - about[1], z - about[2])
    return v[3] + ux, v[4] + uy, v[5] + uz


@njit(cache=True, error_model="numpy", forceinline=True)
def _push(body: BodyArrays, number: int, point: Any, force: Any, sign: float) -> None:
    """Add a force, N, at a point to a body's wrench about its centre of mass."""
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
def _shear_belt(
    side: int,
    spin: Any,
    zones: FrictionMap,
    touched: FloatArray,
    geoms: Geoms,
    body: BodyArrays,
    state: Record,
    p: TrackParameters,
) -> float:
    """Shear all patches of one belt in the order of its motion; returns the belt's load, N."""
    a_side = state.wheels // 2
    entering = state.entering
    belt = p.radius * body.velocity[geoms.sprocket_dof[side]]
    thrust, slipping, track_load = 0.0, 0.0, 0.0
    for step in range(a_side):
        # A belt that drives forward meets the ground under the front wheel, and carries its shear
        # from there to the rear.
        i = step if belt >= 0.0 else a_side - 1 - step
        wheel = side * a_side + i
        upstream = wheel - 1 if belt >= 0.0 else wheel + 1
        track_load += state.load[wheel]
        for s in range(PATCHES):
            row = touched[wheel, s]
            if row[0] == 0.0:
                continue
            # Transport: the upstream wheel passes its shear on, unless it is in the air. The
            # belt's first wheel gets unstrained rubber.
            entering[:] = 0.0
            if step > 0 and state.main[upstream] >= 0:
                half = 1 if belt >= 0.0 else 0
                entering[:] = state.outlet[upstream, state.main[upstream], half]
            # Zones belong to the ground. Movable bodies have the tracks' own friction.
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
    return track_load


@njit(cache=True, error_model="numpy", forceinline=True)
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
    """Advance a patch's two cells and apply their shear; returns thrust, N, and slip, m/s."""
    load = row[0]
    size = math.sqrt(row[4] * row[4] + row[5] * row[5] + row[6] * row[6])
    normal = (row[4] / size, row[5] / size, row[6] / size)
    tangent, across = _belt_axes(body, normal)
    tx, ty, tz = tangent
    sx, sy, sz = across
    number = state.body[wheel, s]
    slip, rate = state.sliding, state.rate
    thrust, slipping = 0.0, 0.0
    for step in range(2):
        # The upstream cell first. Half 0 is the front cell, half a cell ahead of the centre.
        half = step if belt >= 0.0 else 1 - step
        ahead = (0.5 - half) * p.cell
        x, y = row[1] / load + ahead * tx, row[2] / load + ahead * ty
        z = row[3] / load + ahead * tz
        # Slip v: the velocity of the belt's surface relative to the surface under it.
        ux, uy, uz = _relative_velocity(body, number, spin, x, y, z)
        slip[0] = ux * tx + uy * ty + uz * tz - belt
        slip[1] = ux * sx + uy * sy + uz * sz
        # The state of the brush (see `brush`), and its force within the cell's share of mu N.
        mean, outlet = state.mean[wheel, s, half], state.outlet[wheel, s, half]
        advance_cell(mean, outlet, rate, entering, slip, belt, p.cell, p.shear_modulus, p.dt)
        most = 0.5 * friction * min(load, p.most_load)
        push, aside = cell_force(mean, rate, p.shear_modulus, p.shear_damping, most)
        entering[0], entering[1] = outlet[0], outlet[1]
        # The force acts on the vehicle, and its opposite on the body under it.
        force = (push * tx + aside * sx, push * ty + aside * sy, push * tz + aside * sz)
        _push(body, body.base, (x, y, z), force, 1.0)
        if body.moves[number]:
            _push(body, number, (x, y, z), force, -1.0)
        thrust += push
        slipping += 0.5 * slip[0]
    return thrust, slipping


@njit(cache=True, error_model="numpy", forceinline=True)
def _belt_axes(body: BodyArrays, normal: Any) -> Any:
    """Compute the unit vectors along the belt, t = (base_link's y) x n, and across, s = n x t."""
    rot = body.rotation
    nx, ny, nz = normal
    tx, ty, tz = _cross(rot[1], rot[4], rot[7], nx, ny, nz)
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx / size, ty / size, tz / size
    return (tx, ty, tz), _cross(nx, ny, nz, tx, ty, tz)


@njit(cache=True, error_model="numpy", forceinline=True)
def _relative_velocity(
    body: BodyArrays, number: int, spin: Any, x: float, y: float, z: float
) -> Any:
    """Compute the chassis's velocity at a point relative to the body under it, world, m/s."""
    pos, vel = body.position, body.velocity
    ux, uy, uz = _cross(spin[0], spin[1], spin[2], x - pos[0], y - pos[1], z - pos[2])
    ux, uy, uz = vel[0] + ux, vel[1] + uy, vel[2] + uz
    if body.moves[number]:
        ox, oy, oz = _velocity(body, number, x, y, z)
        ux, uy, uz = ux - ox, uy - oy, uz - oz
    return ux, uy, uz


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
    """Set one sprocket's joint: J dw/dt = k I - r F - friction (form 7 of docs/tracks.md)."""
    dof = geoms.sprocket_dof[side]
    current = motor_current(voltage, body.velocity[dof], p)
    state.current[side] = current
    # Where the driver limits the current, it lowers the terminal voltage to the value that drives
    # this current. The battery supplies this voltage, not the requested one.
    terminal = p.resistance * current + p.back_emf * body.velocity[dof]
    state.work[0] += terminal * current * p.dt
    # The force of the belt on the ground loads the sprocket: -r F.
    body.joint_force[dof] = p.torque_per_a * current - p.radius * state.track_force[side]
    # MuJoCo's solver applies the dry friction, because it can hold a joint at rest.
    friction = p.gear_friction + p.rolling_resistance * track_load * p.radius
    body.joint_friction[dof] = friction + (p.brake_torque if braked else 0.0)


@njit(cache=True, error_model="numpy")
def _account(spin: Any, geoms: Geoms, body: BodyArrays, state: Record, p: TrackParameters) -> None:
    """Add the last step's work, J: its forces times the mean of the velocities before and after.

    This mean makes the account exact: F dt (v0 + v1) / 2 is the kinetic energy that a constant
    force F gives in a step (form 8 of docs/tracks.md).
    """
    # The chassis: the twist at its centre of mass, where the wrench is applied.
    vel, pos = body.velocity, body.position
    com, wrench, last = body.com[body.base], body.wrench[body.base], state.last
    arm = (com[0] - pos[0], com[1] - pos[1], com[2] - pos[2])
    ux, uy, uz = _cross(spin[0], spin[1], spin[2], arm[0], arm[1], arm[2])
    twist = (vel[0] + ux, vel[1] + uy, vel[2] + uz, spin[0], spin[1], spin[2])
    shear = 0.0
    for k in range(6):
        shear -= wrench[k] * 0.5 * (last[k] + twist[k])
        last[k] = twist[k]
    # Movable bodies under the tracks. Their cvel is that of the start of the step, so this part is
    # exact only to first order in dt.
    for number in range(1, body.moves.shape[0]):
        if number != body.base and body.moves[number] and np.any(body.wrench[number]):
            at, force = body.com[number], body.wrench[number]
            vx, vy, vz = _velocity(body, number, at[0], at[1], at[2])
            v = body.cvel[number]
            shear -= force[0] * vx + force[1] * vy + force[2] * vz
            shear -= force[3] * v[0] + force[4] * v[1] + force[5] * v[2]
    # The belts: sprockets put r F w into the shear, joints lose friction, shafts supply torque.
    for side in range(2):
        dof = geoms.sprocket_dof[side]
        speed = 0.5 * (last[6 + side] + vel[dof])
        last[6 + side] = vel[dof]
        shear += p.radius * state.track_force[side] * speed
        state.work[2] -= body.joint_constraint[dof] * speed * p.dt
        state.work[3] += p.torque_per_a * state.current[side] * speed * p.dt
    state.work[1] += shear * p.dt
