"""The plant's compiled kernels: the motion that a truth tells of, and ranges carried along.

Their plain twins stand in the tests.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_GRAVITY_MPS2 = 9.81
_GRAZING = 0.15  # cosine between a ray and the surface's normal below which it grazes
_FAR_M = 0.01


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
POSE, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 9), slice(9, 12)
POSITION, QUATERNION = slice(12, 15), slice(15, 19)
ANGLE, TURNING = slice(19, 21), slice(21, 23)
CURRENT, VOLTAGE = slice(23, 25), slice(25, 27)


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
