"""Make upright obstacles of solids and meshes, by their outline at the robot's heights.

An upright box or cylinder is the same shape here. Any other shape becomes two layers of upright
obstacles: one at the heights of the hull, and one at those of the LiDAR's plane and the mast. Each
has the shape's outline between the layer's heights.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray
from simloop.worlds.cross_section import section_of
from simloop.worlds.floor_plan import BAND_M, Section
from simloop.worlds.gazebo.heights import Placed
from simloop.worlds.gazebo.outlines import Outlines
from simloop.worlds.gazebo.shapes import Shell
from simloop.worlds.obstacles import Obstacle, ShapeName
from simloop.worlds.solids import Solid

_SPLIT_M = 0.18  # between the hull and the LiDAR's plane
_HIGHEST_M = 3.0  # largest height of an obstacle
_TILT_RAD = 1e-3  # largest tilt of an upright shape
_SAME_M = 1e-6
_FLAT_M = 1e-4  # a corner that is nearer to the line of its neighbours is none
_THIN_M = 1e-3  # least height of an obstacle

_Outline = Callable[[float, float], list[Section]]


def obstacles_of(one: Placed, ground_m: float, outlines: Outlines) -> list[Obstacle]:
    """Make the obstacles of a body.

    Args:
        one: the body; it reaches the heights of the robot.
        ground_m: height of the ground in map, m.
        outlines: keeps the outlines of meshes for the other bodies of the world.

    Returns:
        The obstacles; none if no part of it is at the heights of the robot.

    Raises:
        InputError: its place is impossible, or its outline too intricate. The text has one line.
    """
    where = one.collision.where
    bottom, top = float(one.low[2]) - ground_m, float(one.high[2]) - ground_m
    try:
        if isinstance(one.body, Solid):
            upright = _upright(one.body, bottom, top)
            if upright is not None:
                return [upright]
        return _layers(_outline_of(where, one.body, ground_m, outlines), bottom, top)
    except InputError:
        raise
    except ValueError:
        raise InputError(f"{where}: a shape of an impossible size or place") from None


def _outline_of(where: str, body: Solid | Shell, ground_m: float, outlines: Outlines) -> _Outline:
    """Make the function that computes a body's outline between two heights over the ground."""

    def outline(low_m: float, high_m: float) -> list[Section]:
        band = (low_m + ground_m, high_m + ground_m)
        if isinstance(body, Solid):
            section = section_of(body, band)
            return [] if section is None else [section]
        polygons = outlines.between(body, *band)
        if polygons is None:
            raise InputError(
                f"{where}: a mesh whose outline at the robot's height is too intricate"
            )
        return [Section("", polygon) for polygon in polygons]

    return outline


def _upright(solid: Solid, bottom: float, top: float) -> Obstacle | None:
    """Make the obstacle of an upright box or cylinder; None for any other solid."""
    # The component of each of the solid's axes along the vertical.
    rise = np.abs(solid.rotation[2])
    axis = int(np.argmax(rise))
    if rise[axis] < math.cos(_TILT_RAD):
        return None
    if solid.kind == mujoco.mjtGeom.mjGEOM_CYLINDER and axis == 2:
        return _obstacle("cylinder", solid.position_m, (2.0 * solid.size_m[0],), 0.0, bottom, top)
    if solid.kind != mujoco.mjtGeom.mjGEOM_BOX:
        return None
    first = 0 if axis == 2 else (axis + 1) % 3
    second = 3 - axis - first
    yaw = math.atan2(solid.rotation[1, first], solid.rotation[0, first])
    size = (2.0 * solid.size_m[first], 2.0 * solid.size_m[second])
    # The box itself may be tilted a little, so its height is not that of the box around it.
    half, middle = float(solid.size_m[axis]), 0.5 * (bottom + top)
    return _obstacle("box", solid.position_m, size, yaw, middle - half, middle + half)


def _obstacle(
    shape: ShapeName,
    position: FloatArray,
    size: tuple[float, ...],
    yaw: float,
    bottom: float,
    top: float,
    vertices: tuple[tuple[float, float], ...] = (),
) -> Obstacle:
    """Make an obstacle between two heights; what is under the ground or very high is cut off."""
    bottom, top = max(bottom, 0.0), max(min(top, _HIGHEST_M), bottom + _THIN_M)
    where = (float(position[0]), float(position[1]))
    size = tuple(float(value) for value in size)
    return Obstacle(shape, where, size, float(yaw), top - bottom, vertices, bottom)


def _layers(outline: _Outline, bottom: float, top: float) -> list[Obstacle]:
    """Make the obstacles of a body that is no upright box or cylinder."""
    least, most = BAND_M
    if bottom > _SPLIT_M - _THIN_M or top < _SPLIT_M + _THIN_M:  # one layer has it all, or nearly
        return _stack(outline(least, most), bottom, min(top, most))
    lower, upper = outline(least, _SPLIT_M), outline(_SPLIT_M, most)
    if _are_same(lower, upper):
        return _stack(lower, bottom, top)
    return _stack(lower, bottom, min(top, _SPLIT_M)) + _stack(
        upper, max(bottom, _SPLIT_M), min(top, most)
    )


def _are_same(lower: list[Section], upper: list[Section]) -> bool:
    return len(lower) == len(upper) and all(
        a.vertices_m.shape == b.vertices_m.shape
        and np.allclose(a.vertices_m, b.vertices_m, rtol=0.0, atol=_SAME_M)
        and abs(a.radius_m - b.radius_m) < _SAME_M
        for a, b in zip(lower, upper, strict=True)
    )


def _stack(sections: list[Section], bottom: float, top: float) -> list[Obstacle]:
    return [one for section in sections for one in _of_section(section, bottom, top)]


def _of_section(section: Section, bottom: float, top: float) -> list[Obstacle]:
    """Make the obstacles of an outline: a circle, a stadium or a polygon."""
    corners, radius = section.vertices_m, section.radius_m
    if radius > 0.0:
        found = [_obstacle("cylinder", end, (2.0 * radius,), 0.0, bottom, top) for end in corners]
        if len(corners) == 2:
            along = corners[1] - corners[0]
            size = (float(np.linalg.norm(along)), 2.0 * radius)
            yaw = math.atan2(along[1], along[0])
            found.append(_obstacle("box", corners.mean(axis=0), size, yaw, bottom, top))
        return found
    corners = _without_flat_corners(corners)
    if len(corners) < 3:
        return []
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    square = abs(sides[0] @ sides[1]) < _SAME_M * lengths[0] * lengths[1]
    if square and len(corners) == 4 and np.allclose(sides[0], -sides[2], rtol=0.0, atol=_SAME_M):
        size, yaw = (lengths[0], lengths[1]), math.atan2(sides[0, 1], sides[0, 0])
        return [_obstacle("box", corners.mean(axis=0), size, yaw, bottom, top)]
    points = tuple((float(x), float(y)) for x, y in corners - middle)
    return [_obstacle("polygon", middle, (), 0.0, bottom, top, points)]


def _without_flat_corners(corners: FloatArray) -> FloatArray:
    """Leave out corners (V, 2) that are doubled, or on a straight side."""
    while len(corners) >= 3:
        before = corners - np.roll(corners, 1, axis=0)
        after = np.roll(corners, -1, axis=0) - corners
        height = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        height /= np.maximum(
            np.linalg.norm(np.roll(corners, -1, 0) - np.roll(corners, 1, 0), axis=1), 1e-12
        )
        flattest = int(np.argmin(height))
        if height[flattest] > _FLAT_M:
            return corners
        corners = np.delete(corners, flattest, axis=0)
    return corners
