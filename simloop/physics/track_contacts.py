"""Sort MuJoCo's contacts of the road wheels into patches that persist from step to step.

A road wheel may touch several surfaces at once, for example the ground and the edge of a step. Each
surface is a patch with its own shear. In the next step, a patch is recognised by the body under it
and by its normal.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.physics.track_model import (
    HULL,
    OBSTACLE,
    PATCHES,
    WHEEL,
    BodyArrays,
    ContactArrays,
    Geoms,
    Record,
)

_SAME_SURFACE = 0.9  # least cosine between the normals of one patch in two steps
_ON_ITS_SIDE = 0.7  # if more of the normal points along the axle, no belt touches the surface


@njit(cache=True, error_model="numpy", forceinline=True)
def patch_of(
    state: Record, touched: FloatArray, wheel: int, body: int, nx: float, ny: float, nz: float
) -> int:
    """Find or start the patch that a contact of a wheel belongs to.

    Args:
        state: a row of `STATE_BLOCK`; the patch's body and normal are updated.
        touched: (wheels, PATCHES, 7) this step's sums, see `gather`.
        wheel: the wheel's number.
        body: number of the touched body.
        nx: x of the contact's normal in base_link, towards the vehicle.
        ny: y of the normal.
        nz: z of the normal.

    Returns:
        The patch's index, 0 to PATCHES - 1.
    """
    # Find the patch on the same body with the most similar normal, and a free place for a new
    # patch. A place is free if nothing touches it in this step; best is one without shear.
    best, free, likest = -1, -1, -2.0
    for s in range(PATCHES):
        normal = state.normal[wheel, s]
        cosine = normal[0] * nx + normal[1] * ny + normal[2] * nz
        known = cosine != 0.0 and state.body[wheel, s] == body
        if known and cosine > likest:
            best, likest = s, cosine
        if touched[wheel, s, 0] == 0.0 and (free < 0 or not np.any(normal)):
            free = s
    # A new surface starts without shear. If no place is free, it joins the most similar patch.
    if likest < _SAME_SURFACE and free >= 0:
        best = free
        state.mean[wheel, best] = 0.0
        state.outlet[wheel, best] = 0.0
    best = max(best, 0)
    # The step's first contact defines the patch for the next step.
    if touched[wheel, best, 0] == 0.0:
        state.body[wheel, best] = body
        state.normal[wheel, best, 0] = nx
        state.normal[wheel, best, 1] = ny
        state.normal[wheel, best, 2] = nz
    return best


@njit(cache=True, error_model="numpy")
def gather(
    contacts: ContactArrays, geoms: Geoms, body: BodyArrays, state: Record, touched: FloatArray
) -> None:
    """Sum the contacts into patches and wheel loads, and count the contacts with obstacles.

    Args:
        contacts: MuJoCo's contacts of the last step.
        geoms: kind of each geom.
        body: MuJoCo's bodies; the rotation of base_link is read.
        state: a row of `STATE_BLOCK`; ``load`` and ``touching`` are increased, patches updated.
        touched: (wheels, PATCHES, 7) zeros on entry. The sums are added to it: load, N; load times
            position in the world, N m; load times normal in the world, N.
    """
    rot = body.rotation
    for c in range(contacts.geom.shape[0]):
        # Find which of the two geoms is the vehicle's. Vehicle kinds are the larger numbers.
        one, two = contacts.geom[c, 0], contacts.geom[c, 1]
        first, second = geoms.kind[one], geoms.kind[two]
        mine, other = max(first, second), min(first, second)
        if mine >= HULL and other == OBSTACLE:
            state.touching[0] += 1
        # Only a loaded contact of a road wheel carries shear. The row is negative where MuJoCo
        # left the contact out of its constraints.
        if mine < WHEEL or other >= HULL or contacts.row[c] < 0:
            continue
        load = contacts.force[contacts.row[c]]
        if load <= 0.0:
            continue
        # The normal towards the vehicle, in the world and in base_link. MuJoCo's normal points
        # from the first geom to the second.
        sign = 1.0 if second >= WHEEL else -1.0
        n = contacts.frame[c]
        nx, ny, nz = sign * n[0], sign * n[1], sign * n[2]
        bx = rot[0] * nx + rot[3] * ny + rot[6] * nz
        by = rot[1] * nx + rot[4] * ny + rot[7] * nz
        bz = rot[2] * nx + rot[5] * ny + rot[8] * nz
        wheel = mine - WHEEL
        state.load[wheel] += load
        # There is no belt on the side of a wheel.
        if abs(by) > _ON_ITS_SIDE:
            continue
        on = geoms.body[one] if second >= WHEEL else geoms.body[two]
        patch = patch_of(state, touched, wheel, on, bx, by, bz)
        # Weighted by load: divided by the load, the sums are the centre of pressure and the normal.
        row = touched[wheel, patch]
        row[0] += load
        for k in range(3):
            row[1 + k] += load * contacts.pos[c, k]
        row[4] += load * nx
        row[5] += load * ny
        row[6] += load * nz


@njit(cache=True, error_model="numpy")
def forget_and_rank(state: Record, touched: FloatArray) -> None:
    """Clear the patches that touch nothing, and find each wheel's most loaded patch.

    A belt in the air is not strained. The next wheel downstream takes over the shear of the most
    loaded patch.

    Args:
        state: a row of `STATE_BLOCK`; ``mean``, ``outlet``, ``normal`` and ``main`` are written.
        touched: (wheels, PATCHES, 7) the step's sums, see `gather`.
    """
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
