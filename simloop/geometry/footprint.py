"""Compute distances from the rectangular footprint to points, and the free part of a motion."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

_STEP_M = 0.02  # longest step along an arc
_STEP_RAD = 0.04  # largest turn of a step
_FINER = 20  # number of fine steps per step, used for points within the margin
_HALVINGS = 4  # number of bisections of the step that ends the free part


@njit(cache=True)
def rectangle_distance(x: float, y: float, half_length: float, half_width: float) -> float:
    """Compute the signed distance from a point to a rectangle centred at the origin.

    Args:
        x: x of the point in the rectangle's frame, m.
        y: y of the point in the rectangle's frame, m.
        half_length: Half the rectangle's side along x, m.
        half_width: Half the rectangle's side along y, m.

    Returns:
        The distance, m; negative inside.
    """
    dx, dy = abs(x) - half_length, abs(y) - half_width
    return math.hypot(max(dx, 0.0), max(dy, 0.0)) + min(max(dx, dy), 0.0)


@njit(cache=True)
def arc_end(ahead: float, turned: float) -> tuple[float, float]:
    """Compute the end of an arc that starts at the origin along x.

    Args:
        ahead: Length of the arc, m.
        turned: Turn of the heading along the arc, rad.

    Returns:
        x, y of the end, m.
    """
    if abs(turned) > 1e-9:
        return ahead / turned * math.sin(turned), ahead / turned * (1.0 - math.cos(turned))
    return ahead, 0.0


@njit(cache=True)
def points_in(pose: FloatArray, seen_from: FloatArray, points: FloatArray) -> FloatArray:
    """Transform points into another frame.

    Args:
        pose: (3,) x, y, yaw of the target frame, m, m, rad.
        seen_from: (3,) x, y, yaw of the frame in which the points are given.
        points: (n, 2) x, y in the frame ``seen_from``, m.

    Returns:
        (n, 2) the same points in the frame ``pose``, m.
    """
    out = np.empty_like(points)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = seen_from[0] - pose[0], seen_from[1] - pose[1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    cos, sin = math.cos(seen_from[2] - pose[2]), math.sin(seen_from[2] - pose[2])
    for i in range(points.shape[0]):
        out[i, 0] = x + cos * points[i, 0] - sin * points[i, 1]
        out[i, 1] = y + sin * points[i, 0] + cos * points[i, 1]
    return out


@njit(cache=True)
def near_points(points: FloatArray, pose: FloatArray, near_m: float) -> FloatArray:
    """Select the points within a distance of a pose, and transform them to map.

    Args:
        points: (n, 2) x, y in the frame of ``pose``, m.
        pose: (3,) x, y, yaw in map, m, m, rad.
        near_m: The distance, m.

    Returns:
        (k, 2) the near points in map, m.
    """
    out, k = np.empty_like(points), 0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if math.hypot(x, y) < near_m:
            out[k, 0] = pose[0] + cos * x - sin * y
            out[k, 1] = pose[1] + sin * x + cos * y
            k += 1
    return out[:k]


@njit(cache=True)
def _hindered(
    points: FloatArray,
    ahead: float,
    turned: float,
    half_length: float,
    half_width: float,
    margin: float,
) -> bool:
    """Return whether an arc brings the footprint within a margin of a point, and nearer to it."""
    cx, cy = arc_end(ahead, turned)
    cos, sin = math.cos(turned), math.sin(turned)
    reach = math.hypot(half_length, half_width) + margin
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - cx, points[i, 1] - cy
        if dx * dx + dy * dy > reach * reach:
            continue
        there = rectangle_distance(
            cos * dx + sin * dy, cos * dy - sin * dx, half_length, half_width
        )
        if there < margin:
            here = rectangle_distance(points[i, 0], points[i, 1], half_length, half_width)
            if there < here - 1e-6:
                return True
    return False


@njit(cache=True)
def _free_of(
    points: FloatArray,
    ahead: float,
    turned: float,
    half_length: float,
    half_width: float,
    margin: float,
    steps: int,
) -> float:
    """Return the free fraction of an arc, tested at ``steps`` steps along it."""
    for step in range(1, steps + 1):
        f = step / steps
        if _hindered(points, f * ahead, f * turned, half_length, half_width, margin):
            low, high = (step - 1) / steps, f
            for _ in range(_HALVINGS):
                f = 0.5 * (low + high)
                if _hindered(points, f * ahead, f * turned, half_length, half_width, margin):
                    high = f
                else:
                    low = f
            return low
    return 1.0


@njit(cache=True)
def within(points: FloatArray, half_length: float, half_width: float, margin: float) -> FloatArray:
    """Select the points that are nearer to the footprint than a margin.

    Args:
        points: (n, 2) x, y in base_link, m.
        half_length: Half the footprint's length, m.
        half_width: Half the footprint's width, m.
        margin: The margin, m.

    Returns:
        (k, 2) the points within it, in base_link, m.
    """
    out, k = np.empty_like(points), 0
    for i in range(points.shape[0]):
        if rectangle_distance(points[i, 0], points[i, 1], half_length, half_width) < margin:
            out[k] = points[i]
            k += 1
    return out[:k]


@njit(cache=True)
def free_fraction(
    points: FloatArray,
    ahead: float,
    turned: float,
    half_length: float,
    half_width: float,
    margin: float,
) -> float:
    """Compute the part of a motion that is free until the footprint is within a margin of a point.

    The motion is an arc. A point that is already within the margin blocks only motions that bring
    the footprint nearer to it. For such points the margin does not cover the motion between two
    steps, so the steps are finer.

    Args:
        points: (n, 2) x, y in the present base_link, m.
        ahead: Length of the arc, m; negative backwards.
        turned: Turn of the heading along the arc, rad.
        half_length: Half the footprint's length, m.
        half_width: Half the footprint's width, m.
        margin: Distance to keep from the points, m.

    Returns:
        The free part of the motion, 0 to 1.
    """
    steps = math.ceil(max(abs(ahead) / _STEP_M, abs(turned) / _STEP_RAD))
    free = _free_of(points, ahead, turned, half_length, half_width, margin, steps)
    near = within(points, half_length, half_width, margin)
    if near.shape[0] and free > 0.0:
        part = math.ceil(free * steps * _FINER)
        free *= _free_of(near, free * ahead, free * turned, half_length, half_width, margin, part)
    return free


@njit(cache=True)
def room_after(
    points: FloatArray, ahead: float, turned: float, half_length: float, half_width: float
) -> float:
    """Compute the distance from the footprint to the nearest point after an arc.

    Args:
        points: (n, 2) x, y in base_link before the motion, m.
        ahead: Length of the arc, m; negative backwards.
        turned: Turn of the heading along the arc, rad.
        half_length: Half the footprint's length, m.
        half_width: Half the footprint's width, m.

    Returns:
        The signed distance, m; inf if there are no points.
    """
    end = np.array((*arc_end(ahead, turned), turned))
    seen, least = points_in(end, np.zeros(3), points), np.inf
    for i in range(seen.shape[0]):
        gap = rectangle_distance(seen[i, 0], seen[i, 1], half_length, half_width)
        least = min(least, gap)
    return least
