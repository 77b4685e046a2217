"""Planar rigid motions: a pose (x, y, yaw) is the transform ``a_from_b`` of SE(2), m, m, rad.

The ``*_xyt`` kernels take and return scalars, so that other compiled kernels can call them
without an array in between; the functions without the suffix take (3,) arrays.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

TWO_PI = 2.0 * math.pi


@njit(cache=True)
def wrap_angle(angle: float) -> float:
    """The same angle in (-pi, pi]; exact, since fmod is. NaN and inf give NaN."""
    wrapped: float = np.fmod(angle, TWO_PI)
    if wrapped > math.pi:
        wrapped -= TWO_PI
    elif wrapped <= -math.pi:
        wrapped += TWO_PI
    return wrapped


def wrap_angles(angles: FloatArray) -> FloatArray:
    """``wrap_angle`` of every element of an array of any shape, as a new array."""
    wrapped = np.fmod(angles, TWO_PI)
    wrapped = np.where(wrapped > math.pi, wrapped - TWO_PI, wrapped)
    return np.where(wrapped <= -math.pi, wrapped + TWO_PI, wrapped)


@njit(cache=True)
def compose_xyt(
    ax: float, ay: float, at: float, bx: float, by: float, bt: float
) -> tuple[float, float, float]:
    """Pose a after pose b: a_from_c = a_from_b * b_from_c, yaw wrapped."""
    cos, sin = math.cos(at), math.sin(at)
    return ax + cos * bx - sin * by, ay + sin * bx + cos * by, wrap_angle(at + bt)


@njit(cache=True)
def inverse_xyt(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """b_from_a of a_from_b."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return -cos * x - sin * y, sin * x - cos * y, wrap_angle(-yaw)


@njit(cache=True)
def interpolate_xyt(
    ax: float, ay: float, at: float, bx: float, by: float, bt: float, fraction: float
) -> tuple[float, float, float]:
    """The pose at ``fraction`` of the way from a to b: straight in x, y; the short way in yaw."""
    return (
        ax + fraction * (bx - ax),
        ay + fraction * (by - ay),
        wrap_angle(at + fraction * wrap_angle(bt - at)),
    )


def compose(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """a_from_c, (3,)."""
    return np.array(compose_xyt(*a_from_b.tolist(), *b_from_c.tolist()))


def inverse(a_from_b: FloatArray) -> FloatArray:
    """b_from_a, (3,)."""
    return np.array(inverse_xyt(*a_from_b.tolist()))


def between(w_from_a: FloatArray, w_from_b: FloatArray) -> FloatArray:
    """a_from_b, (3,): where b stands as seen from a."""
    return compose(inverse(w_from_a), w_from_b)


def transform_points(a_from_b: FloatArray, points: FloatArray) -> FloatArray:
    """points (..., 2) of frame b in frame a, as a new array."""
    x, y, yaw = a_from_b
    cos, sin = math.cos(yaw), math.sin(yaw)
    px, py = points[..., 0], points[..., 1]
    return np.stack((x + cos * px - sin * py, y + sin * px + cos * py), axis=-1)


def about_face(pose: FloatArray) -> FloatArray:
    """The pose (3,) of whoever stands at ``pose`` (3+) and takes the rear for the front."""
    return np.array([pose[0], pose[1], wrap_angle(pose[2] + math.pi)])


def compose_all(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """a_from_c, (N, 3), of poses (N, 3) or (3,), yaw wrapped."""
    cos, sin = np.cos(a_from_b[..., 2]), np.sin(a_from_b[..., 2])
    x, y = b_from_c[..., 0], b_from_c[..., 1]
    yaw = wrap_angles(a_from_b[..., 2] + b_from_c[..., 2])
    return np.stack(
        [a_from_b[..., 0] + cos * x - sin * y, a_from_b[..., 1] + sin * x + cos * y, yaw], axis=-1
    )
