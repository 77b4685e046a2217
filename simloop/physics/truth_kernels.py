"""The compiled kernel that fills a `Truth`: pose, velocity and acceleration at the IMU."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray


@njit(cache=True)
def rotation_of(qpos: FloatArray) -> FloatArray:
    """Compute the rotation matrix of the vehicle's attitude.

    MuJoCo's own ``xmat`` is not used: after a step it is still that of the start of the step.

    Args:
        qpos: (7 or more,) MuJoCo's positions, the vehicle's free joint first; w, x, y, z at 3 to 6.

    Returns:
        (3, 3) world_from_base.
    """
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = (
        1.0 - s * (y * y + z * z),
        s * (x * y - w * z),
        s * (x * z + w * y),
    )
    turn[1, 0], turn[1, 1], turn[1, 2] = (
        s * (x * y + w * z),
        1.0 - s * (x * x + z * z),
        s * (y * z - w * x),
    )
    turn[2, 0], turn[2, 1], turn[2, 2] = (
        s * (x * z - w * y),
        s * (y * z + w * x),
        1.0 - s * (x * x + y * y),
    )
    return turn


@njit(cache=True)
def point_velocity(qpos: FloatArray, qvel: FloatArray, point: FloatArray) -> FloatArray:
    """Compute the velocity of a point that is fixed to the vehicle: v + R (omega x r).

    Args:
        qpos: as in `rotation_of`.
        qvel: (6 or more,) linear velocity in the world, m/s, then angular in base_link, rad/s.
        point: (3,) r, the point in base_link, m.

    Returns:
        (3,) in the world, m/s.
    """
    turn = rotation_of(qpos)
    ux = qvel[4] * point[2] - qvel[5] * point[1]
    uy = qvel[5] * point[0] - qvel[3] * point[2]
    uz = qvel[3] * point[1] - qvel[4] * point[0]
    velocity = np.empty(3)
    for k in range(3):
        velocity[k] = qvel[k] + turn[k, 0] * ux + turn[k, 1] * uy + turn[k, 2] * uz
    return velocity


# Where each array of a Truth is in the block that the kernel fills.
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
    imu: FloatArray,
    imu_before: FloatArray,
    gravity: FloatArray,
    period_s: float,
) -> FloatArray:
    """Compute all arrays of a Truth in one block, see the slices above.

    The proper acceleration at the IMU is R^T (dv / T - g). Here v is the velocity of the IMU's own
    point, so its difference includes the lever arm's terms alpha x r and omega x (omega x r).

    Args:
        qpos: MuJoCo's positions, the vehicle's free joint first.
        qvel: MuJoCo's velocities, the same joint first; angular velocity in base_link.
        sprocket_qpos: (2,) indices of the sprockets' angles in ``qpos``.
        sprocket_dof: (2,) indices of the sprockets' rates in ``qvel``.
        current: (2,) motor currents, A.
        voltage: (2,) motor voltages, V.
        imu: (3,) position of the IMU in base_link, m.
        imu_before: (3,) its velocity in the world one period ago, m/s.
        gravity: (3,) in the world, m/s^2.
        period_s: control period T, s.

    Returns:
        (27,) the block.
    """
    block = np.empty(27)
    # The pose: yaw of the ZYX Euler angles.
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    block[0], block[1] = qpos[0], qpos[1]
    block[2] = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    # Velocity and specific force, rotated from the world into base_link. The angular velocity of a
    # free joint is already in base_link.
    turn, imu_now = rotation_of(qpos), point_velocity(qpos, qvel, imu)
    for i in range(3):
        block[3 + i], block[9 + i] = 0.0, 0.0
        block[6 + i] = qvel[3 + i]
        for k in range(3):
            block[3 + i] += turn[k, i] * qvel[k]
            block[9 + i] += turn[k, i] * ((imu_now[k] - imu_before[k]) / period_s - gravity[k])
    # The rest of the state is copied.
    block[12:19] = qpos[:7]
    for side in range(2):
        block[19 + side] = qpos[sprocket_qpos[side]]
        block[21 + side] = qvel[sprocket_dof[side]]
        block[23 + side], block[25 + side] = current[side], voltage[side]
    return block
