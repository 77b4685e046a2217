"""Compute with plane poses: (x, y, yaw) is the transform ``a_from_b`` of SE(2), m, m, rad.

The ``*_xyt`` kernels take and return scalars, so that compiled kernels can call them without
creating arrays. The functions without the suffix take (3,) arrays.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

TWO_PI = 2.0 * math.pi


@njit(cache=True)
def wrap_angle(angle: float) -> float:
    """Wrap an angle to (-pi, pi].

    The result is exact, because fmod is exact.

    Args:
        angle: Any angle, rad.

    Returns:
        The same angle in (-pi, pi], rad; NaN for NaN and for infinity.
    """
    wrapped: float = np.fmod(angle, TWO_PI)
    if wrapped > math.pi:
        wrapped -= TWO_PI
    elif wrapped <= -math.pi:
        wrapped += TWO_PI
    return wrapped


def wrap_angles(angles: FloatArray) -> FloatArray:
    """Wrap every element of an array to (-pi, pi].

    Args:
        angles: Angles of any shape, rad.

    Returns:
        A new array of the same shape, rad.
    """
    wrapped = np.fmod(angles, TWO_PI)
    wrapped = np.where(wrapped > math.pi, wrapped - TWO_PI, wrapped)
    return np.where(wrapped <= -math.pi, wrapped + TWO_PI, wrapped)


@njit(cache=True)
def compose_xyt(
    ax: float, ay: float, at: float, bx: float, by: float, bt: float
) -> tuple[float, float, float]:
    """Compose two poses: a_from_c = a_from_b * b_from_c.

    Args:
        ax: x of a_from_b, m.
        ay: y of a_from_b, m.
        at: Yaw of a_from_b, rad.
        bx: x of b_from_c, m.
        by: y of b_from_c, m.
        bt: Yaw of b_from_c, rad.

    Returns:
        x, y, yaw of a_from_c, m, m, rad; yaw wrapped.
    """
    cos, sin = math.cos(at), math.sin(at)
    return ax + cos * bx - sin * by, ay + sin * bx + cos * by, wrap_angle(at + bt)


@njit(cache=True)
def inverse_xyt(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """Invert a pose: compute b_from_a from a_from_b.

    Args:
        x: x of a_from_b, m.
        y: y of a_from_b, m.
        yaw: Yaw of a_from_b, rad.

    Returns:
        x, y, yaw of b_from_a, m, m, rad; yaw wrapped.
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    return -cos * x - sin * y, sin * x - cos * y, wrap_angle(-yaw)


@njit(cache=True)
def interpolate_xyt(
    ax: float, ay: float, at: float, bx: float, by: float, bt: float, fraction: float
) -> tuple[float, float, float]:
    """Interpolate between two poses, linearly in x and y and over the shorter turn in yaw.

    Args:
        ax: x of the first pose, m.
        ay: y of the first pose, m.
        at: Yaw of the first pose, rad.
        bx: x of the second pose, m.
        by: y of the second pose, m.
        bt: Yaw of the second pose, rad.
        fraction: 0 gives the first pose, 1 the second.

    Returns:
        x, y, yaw of the interpolated pose, m, m, rad; yaw wrapped.
    """
    return (
        ax + fraction * (bx - ax),
        ay + fraction * (by - ay),
        wrap_angle(at + fraction * wrap_angle(bt - at)),
    )


def compose(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """Compose two poses.

    Args:
        a_from_b: (3,) x, y, yaw, m, m, rad.
        b_from_c: (3,) x, y, yaw, m, m, rad.

    Returns:
        (3,) a_from_c, yaw wrapped.
    """
    return np.array(compose_xyt(*a_from_b.tolist(), *b_from_c.tolist()))


def inverse(a_from_b: FloatArray) -> FloatArray:
    """Invert a pose.

    Args:
        a_from_b: (3,) x, y, yaw, m, m, rad.

    Returns:
        (3,) b_from_a, yaw wrapped.
    """
    return np.array(inverse_xyt(*a_from_b.tolist()))


def between(w_from_a: FloatArray, w_from_b: FloatArray) -> FloatArray:
    """Compute the pose of b in the frame of a.

    Args:
        w_from_a: (3,) pose of a in a common frame w, m, m, rad.
        w_from_b: (3,) pose of b in the same frame.

    Returns:
        (3,) a_from_b, yaw wrapped.
    """
    return compose(inverse(w_from_a), w_from_b)


def transform_points(a_from_b: FloatArray, points: FloatArray) -> FloatArray:
    """Transform points from frame b to frame a.

    Args:
        a_from_b: (3,) x, y, yaw, m, m, rad.
        points: (..., 2) x, y in frame b, m.

    Returns:
        (..., 2) the same points in frame a, a new array, m.
    """
    x, y, yaw = a_from_b
    cos, sin = math.cos(yaw), math.sin(yaw)
    px, py = points[..., 0], points[..., 1]
    return np.stack((x + cos * px - sin * py, y + sin * px + cos * py), axis=-1)


def about_face(pose: FloatArray) -> FloatArray:
    """Turn a pose by half a turn, so that the robot's rear becomes its front.

    Args:
        pose: (3,) or longer: x, y, yaw, m, m, rad.

    Returns:
        (3,) the same position with yaw turned by pi and wrapped.
    """
    return np.array([pose[0], pose[1], wrap_angle(pose[2] + math.pi)])


def compose_all(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """Compose many poses at once.

    Args:
        a_from_b: (N, 3) or (3,) x, y, yaw, m, m, rad.
        b_from_c: (N, 3) or (3,) x, y, yaw.

    Returns:
        (N, 3) a_from_c, yaw wrapped.
    """
    cos, sin = np.cos(a_from_b[..., 2]), np.sin(a_from_b[..., 2])
    x, y = b_from_c[..., 0], b_from_c[..., 1]
    yaw = wrap_angles(a_from_b[..., 2] + b_from_c[..., 2])
    return np.stack(
        [a_from_b[..., 0] + cos * x - sin * y, a_from_b[..., 1] + sin * x + cos * y, yaw], axis=-1
    )


def between_all(w_from_a: FloatArray, w_from_b: FloatArray) -> FloatArray:
    """Compute many poses in the frames of others at once.

    Args:
        w_from_a: (N, 3) or (3,) x, y, yaw, m, m, rad.
        w_from_b: (N, 3) or (3,) poses in the same frame w.

    Returns:
        (N, 3) a_from_b, yaw wrapped.
    """
    cos, sin = np.cos(w_from_a[..., 2]), np.sin(w_from_a[..., 2])
    dx, dy = w_from_b[..., 0] - w_from_a[..., 0], w_from_b[..., 1] - w_from_a[..., 1]
    yaw = wrap_angles(w_from_b[..., 2] - w_from_a[..., 2])
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, yaw], axis=-1)
