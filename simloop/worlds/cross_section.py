"""Compute the true floor plan of a world: outlines of MuJoCo geoms at the robot's heights."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from simloop.messages import FloatArray
from simloop.worlds.arena import bounds_of
from simloop.worlds.floor_plan import BAND_M, FloorPlan, Section, rasterise
from simloop.worlds.obstacles import ellipse_outline
from simloop.worlds.solids import Solid, solid_of_model, solids_of_spec

_UPRIGHT = 1.0 - 1e-9  # an axis with a larger vertical component is upright
_MOST_CORNERS = 2500  # of a flat solid
_ROUND = 64
"""Points around a tilted round shape. Its outline then has an error of 0.1 % of its radius."""


def floor_plan(
    model: mujoco.MjModel,
    resolution_m: float = 0.02,
    band_m: tuple[float, float] = BAND_M,
) -> FloorPlan:
    """Compute the floor plan of a compiled world: all static geoms except planes and the ground.

    Shapes are exact where they can be (see ``section_of``). Geoms named ``ground_*`` are left out,
    because the robot can drive over them.

    Args:
        model: the compiled world.
        resolution_m: cell size of the distance raster, m.
        band_m: the lowest and highest height, m, at which a geom counts.

    Returns:
        The floor plan over the arena's bounds.

    Raises:
        ValueError: a height field is not ground, or the arena has no bounds.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    stands = solid & (model.body_weldid[model.geom_bodyid] == 0)
    stands &= model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    solids = [
        solid_of_model(model, data, int(geom))
        for geom in np.flatnonzero(stands)
        if not _is_ground(model.geom(geom).name)
    ]
    sections = [section_of(one, band_m) for one in solids]
    return rasterise([s for s in sections if s is not None], bounds_of(model), resolution_m)


def sections_of_spec(
    world: mujoco.MjSpec, *, loose: bool, band_m: tuple[float, float] = BAND_M
) -> list[Section]:
    """Compute the outlines of the obstacles in a world that is not compiled yet.

    They equal those of ``floor_plan`` up to rounding.

    Args:
        world: the specification, with or without the vehicle, which is left out.
        loose: whether to include loose bodies, at their initial places.
        band_m: the lowest and highest height, m, at which a geom counts.

    Returns:
        One section for each geom that reaches the band.
    """
    solids = solids_of_spec(world, world.worldbody, jointed=loose, skip="base_link")
    sections = [section_of(one, band_m) for one in solids if not _is_ground(one.name)]
    return [section for section in sections if section is not None]


def _is_ground(name: str) -> bool:
    return name == "floor" or name.startswith("ground_")


def section_of(solid: Solid, band_m: tuple[float, float] = BAND_M) -> Section | None:
    """Compute the outline of one solid within a band of heights.

    The outline is exact for boxes, meshes (their convex hull) and spheres in any pose, for upright
    cylinders, and for capsules that stand or lie. Upright ellipsoids have an error of 0.1 mm, and
    all other shapes one of about 0.1 % of their radius.

    Args:
        solid: the solid in the world frame.
        band_m: the lowest and highest height, m.

    Returns:
        The outline in map, or None if the solid does not reach the band.

    Raises:
        ValueError: the geom's type has no outline.
    """
    name, position, rotation, size = solid.name, solid.position_m, solid.rotation, solid.size_m
    axis = rotation[:, 2]
    upright = abs(axis[2]) > _UPRIGHT
    if solid.kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _swept_ball(name, position, np.zeros(3), size[0], band_m)
    if solid.kind == mujoco.mjtGeom.mjGEOM_CAPSULE and (upright or abs(axis[2]) < 1e-9):
        return _swept_ball(name, position, axis * size[1], size[0], band_m)
    if solid.kind == mujoco.mjtGeom.mjGEOM_CYLINDER and upright:
        if _gap(position[2], size[1], band_m) > 0.0:
            return None
        return Section(name, position[None, :2].copy(), float(size[0]))
    if solid.kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID and upright:
        return _upright_ellipsoid(solid, band_m)
    cut = _hull_in_band(_hull_points(solid) @ rotation.T + position, band_m)
    return None if cut is None else Section(name, cut)


def _upright_ellipsoid(solid: Solid, band_m: tuple[float, float]) -> Section | None:
    """Compute the widest ellipse of an upright ellipsoid within the band."""
    position, rotation, size = solid.position_m, solid.rotation, solid.size_m
    rise = (np.clip(position[2], *band_m) - position[2]) / size[2]
    if abs(rise) >= 1.0:
        return None
    outline = ellipse_outline(size[0], size[1]) * math.sqrt(1.0 - rise**2)
    turned = outline @ rotation[:2, :2].T
    # If the ellipsoid is upside down, the rotation also mirrors the outline: it runs clockwise.
    upwards = rotation[2, 2] > 0.0
    return Section(solid.name, (turned if upwards else turned[::-1]) + position[:2])


def _gap(height: float, half: float, band_m: tuple[float, float]) -> float:
    """Compute the vertical distance of a height range to the band, m; negative if they overlap."""
    return float(max(band_m[0] - (height + half), (height - half) - band_m[1]))


def _swept_ball(
    name: str, centre: FloatArray, half: FloatArray, radius: float, band_m: tuple[float, float]
) -> Section | None:
    """Compute the widest circle or stadium within the band of a ball swept along centre +- half.

    The axis is upright or level.
    """
    gap = max(0.0, _gap(centre[2], abs(half[2]), band_m))
    if gap >= radius:
        return None
    ends = np.array([centre[:2] - half[:2], centre[:2] + half[:2]])
    lies = bool(np.any(ends[0] != ends[1]))
    return Section(name, ends if lies else ends[:1], math.sqrt(radius**2 - gap**2))


def _hull_points(solid: Solid) -> FloatArray:
    """Compute points (N, 3) in the geom's frame whose convex hull is the solid."""
    kind, size = solid.kind, solid.size_m
    corners = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
    around = 2.0 * math.pi * np.arange(_ROUND) / _ROUND
    ring = np.stack([np.cos(around), np.sin(around), np.zeros(_ROUND)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return corners * size
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return solid.vertices_m
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return np.concatenate([size[0] * ring + side * size[1] * up for side in (-1.0, 1.0)])
    if kind in (mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE):
        elevation = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _ROUND // 2 + 1)
        ball = ring * np.cos(elevation)[:, None, None] + up * np.sin(elevation)[:, None, None]
        ball = ball.reshape(-1, 3)
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ball * size
        return np.concatenate([size[0] * ball + side * size[1] * up for side in (-1.0, 1.0)])
    raise ValueError(f"no floor plan for a geom of type {kind.name}: {solid.name!r}")


def _hull_in_band(points: FloatArray, band_m: tuple[float, float]) -> FloatArray | None:
    """Cut the convex hull of points (N, 3) to the band; from above, (V, 2) counter-clockwise."""
    try:
        edges = ConvexHull(points).simplices
        pairs = np.concatenate([edges[:, [0, 1]], edges[:, [1, 2]], edges[:, [2, 0]]])
    except (QhullError, ValueError):
        # The solid is flat. Lines between all of its corners span the same cut.
        if len(points) > _MOST_CORNERS:
            return None
        pairs = np.stack(np.triu_indices(len(points), 1), axis=1)
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]
    # The vertices within the band, and the points where edges cross its two planes, span the cut.
    kept = [points[(points[:, 2] >= band_m[0]) & (points[:, 2] <= band_m[1])]]
    for level in band_m:
        crossing = (start[:, 2] < level) != (end[:, 2] < level)
        a, b = start[crossing], end[crossing]
        share = (level - a[:, 2]) / (b[:, 2] - a[:, 2])
        kept.append(a + share[:, None] * (b - a))
    flat = np.concatenate(kept)[:, :2]
    try:
        return flat[ConvexHull(flat).vertices].copy()
    except (QhullError, ValueError):
        return None  # the solid does not reach the band, or only touches it
