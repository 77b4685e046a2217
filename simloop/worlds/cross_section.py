"""Cross-sections of MuJoCo geoms at the height of a sensor or vehicle."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from simloop.messages import FloatArray
from simloop.worlds.arena import bounds_of
from simloop.worlds.floor_plan import BAND_M, FloorPlan, Section, rasterise
from simloop.worlds.obstacles import ellipse_outline

_UPRIGHT = 1.0 - 1e-9
_ROUND = 64
"""Points round a tilted round thing: its outline is then right to about 0.1 % of its radius."""


def floor_plan(
    model: mujoco.MjModel,
    resolution_m: float = 0.02,
    band_m: tuple[float, float] = BAND_M,
) -> FloorPlan:
    """What truly stands in the arena between two heights: all static geoms but planes and floor.

    Shapes are exact where they can be (see ``section_of_geom``); resolution_m is that
    of the raster. What is named ``ground_*`` is driven over, and is left out. Raises ValueError
    for any other height field, which is not supported.
    """
    return rasterise(sections_of(model, band_m), bounds_of(model), resolution_m)


def sections_of(
    model: mujoco.MjModel, band_m: tuple[float, float] = BAND_M, *, loose: bool = False
) -> list[Section]:
    """The outlines of what stands between two heights; loose: of loose things too, as placed."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    root = model.body_rootid[model.geom_bodyid]
    stands = solid & (model.body_weldid[model.geom_bodyid] == 0)
    if loose:
        stands |= solid & (root != 0) & (root != model.body("base_link").id)
    sections = []
    for geom in np.flatnonzero(stands):
        name = model.geom(geom).name
        is_ground = name == "floor" or name.startswith("ground_")
        if not is_ground and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            section = section_of_geom(model, data, int(geom), name, band_m)
            sections += [section] if section is not None else []
    return sections


def section_of_geom(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geom: int,
    name: str,
    band_m: tuple[float, float],
) -> Section | None:
    """The outline of one geom within the band of heights, or None if it does not reach it.

    Exact for boxes, meshes (their convex hull) and spheres in any pose, for upright cylinders,
    and for capsules that stand or lie; upright ellipsoids are right to 0.1 mm, all else to about
    0.1 % of its radius. data: after ``mj_kinematics``. Raises ValueError for other types.
    """
    position = data.geom_xpos[geom]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    axis = rotation[:, 2]
    upright = abs(axis[2]) > _UPRIGHT
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _swept_ball(name, position, np.zeros(3), size[0], band_m)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE and (upright or abs(axis[2]) < 1e-9):
        return _swept_ball(name, position, axis * size[1], size[0], band_m)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER and upright:
        if _gap(position[2], size[1], band_m) > 0.0:
            return None
        return Section(name, position[None, :2].copy(), float(size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID and upright:
        rise = (np.clip(position[2], *band_m) - position[2]) / size[2]
        if abs(rise) >= 1.0:
            return None
        outline = ellipse_outline(size[0], size[1]) * math.sqrt(1.0 - rise**2)
        turned = outline @ rotation[:2, :2].T
        # Upside down, the turn is also a reflection: the outline's sense comes out reversed.
        return Section(name, (turned if axis[2] > 0.0 else turned[::-1]) + position[:2])
    points = _hull_points(model, geom, kind, size) @ rotation.T + position
    cut = _hull_in_band(points, band_m)
    return None if cut is None else Section(name, cut)


def _gap(height: float, half: float, band_m: tuple[float, float]) -> float:
    return float(max(band_m[0] - (height + half), (height - half) - band_m[1]))


def _swept_ball(
    name: str, centre: FloatArray, half: FloatArray, radius: float, band_m: tuple[float, float]
) -> Section | None:
    """A ball swept along centre +- half, which stands or lies: where it comes nearest the band."""
    gap = max(0.0, _gap(centre[2], abs(half[2]), band_m))
    if gap >= radius:
        return None
    ends = np.array([centre[:2] - half[:2], centre[:2] + half[:2]])
    lies = bool(np.any(ends[0] != ends[1]))
    return Section(name, ends if lies else ends[:1], math.sqrt(radius**2 - gap**2))


def _hull_points(
    model: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom, size: FloatArray
) -> FloatArray:
    """(N, 3) points in the geom's frame whose convex hull is the geom."""
    corners = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
    around = 2.0 * math.pi * np.arange(_ROUND) / _ROUND
    ring = np.stack([np.cos(around), np.sin(around), np.zeros(_ROUND)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return corners * size
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        return np.array(model.mesh_vert[start : start + count], dtype=np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return np.concatenate([size[0] * ring + side * size[1] * up for side in (-1.0, 1.0)])
    if kind in (mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE):
        elevation = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _ROUND // 2 + 1)
        ball = ring * np.cos(elevation)[:, None, None] + up * np.sin(elevation)[:, None, None]
        ball = ball.reshape(-1, 3)
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ball * size
        return np.concatenate([size[0] * ball + side * size[1] * up for side in (-1.0, 1.0)])
    raise ValueError(f"no floor plan for a geom of type {kind.name}: {model.geom(geom).name!r}")


def _hull_in_band(points: FloatArray, band_m: tuple[float, float]) -> FloatArray | None:
    """(V, 2) counter-clockwise: the convex hull of points (N, 3), cut to the band, seen from above.

    The cut is spanned by the vertices within the band and by where edges cross its two planes.
    """
    hull = ConvexHull(points)
    pairs = np.concatenate(
        [hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]]
    )
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]
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
        return None  # it does not reach the band, or only touches it
