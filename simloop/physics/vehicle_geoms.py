"""Find and classify the model's geoms and sites: ground, obstacle, hull, road wheel, sensor."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from simloop.messages import FloatArray
from simloop.physics.track_model import GROUND, HULL, OBSTACLE, WHEEL

_ABOVE_M = 10.0  # height from which rays are cast down on the terrain


SEEN_GROUPS = (0, 1)
"""Geom groups that rays hit: the arena's, not the vehicle's visual (2) and collision (3) groups."""


def geom_kinds(model: mujoco.MjModel) -> np.ndarray:
    """Classify the geoms for the track kernels.

    Ground is ``floor`` and all geoms named ``ground_*``, or ``loose_*`` if their body can move. The
    vehicle is the tree under base_link. Everything else is an obstacle.

    Args:
        model: an arena with the vehicle.

    Returns:
        (ngeom,) GROUND, OBSTACLE, HULL, or WHEEL + the road wheel's number.
    """
    root = model.body("base_link").id
    kinds = np.full(model.ngeom, OBSTACLE, np.int64)
    for geom in range(model.ngeom):
        name, body = model.geom(geom).name, model.geom_bodyid[geom]
        moves = model.body_weldid[body] != 0
        if model.body_rootid[body] == root:
            kinds[geom] = HULL
        elif name == "floor" or name.startswith("ground_") or (name.startswith("loose_") and moves):
            kinds[geom] = GROUND
    for number, geom in enumerate(road_wheels(model)):
        kinds[geom] = WHEEL + number
    return kinds


def road_wheels(model: mujoco.MjModel) -> list[int]:
    """Find the geoms of the road wheels.

    Args:
        model: an arena with the vehicle.

    Returns:
        Geom numbers: ``road_left_0`` (the foremost), ``road_left_1``, ..., then the right side.

    Raises:
        ValueError: the sides have different numbers of road wheels, or fewer than two.
    """
    sides = []
    for label in ("left", "right"):
        count = 0
        while mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"road_{label}_{count}") >= 0:
            count += 1
        sides.append([model.geom(f"road_{label}_{i}").id for i in range(count)])
    if len(sides[0]) != len(sides[1]) or len(sides[0]) < 2:
        raise ValueError(
            f"the vehicle has {len(sides[0])} geoms road_left_* and {len(sides[1])} road_right_*; "
            "both sides need the same number of road wheels, at least two"
        )
    return sides[0] + sides[1]


def site_in_base(model: mujoco.MjModel, name: str) -> FloatArray:
    """Find the position of a site of the vehicle's chassis.

    Args:
        model: an arena with the vehicle.
        name: the site's name.

    Returns:
        (3,) in base_link, m; zeros if the vehicle has no such site.

    Raises:
        ValueError: the site is not fixed to base_link itself.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if index < 0:
        return np.zeros(3)
    if model.site_bodyid[index] != model.body("base_link").id:
        raise ValueError(f"site '{name}' must be in the body base_link")
    return np.array(model.site_pos[index], np.float64)


def sprocket_radius(model: mujoco.MjModel) -> float:
    """Find the radius at which the belts run round the sprockets.

    Args:
        model: an arena with the vehicle, whose sites ``sprocket_left_rim`` and
            ``sprocket_right_rim`` are cylinders of that radius.

    Returns:
        The radius, m.

    Raises:
        ValueError: a site is missing, or the two differ.
    """
    radii = []
    for name in ("sprocket_left_rim", "sprocket_right_rim"):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
        if index < 0:
            raise ValueError(f"the vehicle has no site '{name}', which gives its sprocket's radius")
        radii.append(float(model.site_size[index, 0]))
    if radii[0] != radii[1]:
        raise ValueError(
            f"both sprockets must have the same radius, but sprocket_left_rim has {radii[0]:g} m "
            f"and sprocket_right_rim {radii[1]:g} m"
        )
    return radii[0]


def is_free(model: mujoco.MjModel, body: int) -> bool:
    """Tell whether a body has a free joint, so that its pose is the joint's own.

    Args:
        model: any model.
        body: the body's number.

    Returns:
        True for a free body.
    """
    joint = int(model.body_jntadr[body])
    return joint >= 0 and bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def ground_height(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: Sequence[int], places: FloatArray
) -> float:
    """Compute the height of the ground at some places.

    Args:
        model: an arena.
        data: its state, reset; the kinematics are computed here.
        geoms: numbers of the ground's geoms.
        places: (n, 2) positions in the world, m.

    Returns:
        The highest point of any of the geoms at any of the places, m; at least 0, the floor.
    """
    mujoco.mj_kinematics(model, data)
    down, normal, highest = np.array([0.0, 0.0, -1.0]), np.zeros(3), 0.0
    for x, y in places:
        above = np.array([x, y, _ABOVE_M])
        for geom in geoms:
            far = _ray(model, data, geom, above, down, normal)
            highest = max(highest, _ABOVE_M - far if far >= 0.0 else 0.0)
    return highest


def _ray(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geom: int,
    origin: FloatArray,
    direction: FloatArray,
    normal: FloatArray,
) -> float:
    """Measure the distance, m, along a ray to one geom of any kind; -1 if the ray misses it."""
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return float(mujoco.mj_rayHfield(model, data, geom, origin, direction, normal))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return float(mujoco.mj_rayMesh(model, data, geom, origin, direction, normal))
    at, turned, size = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
    return float(mujoco.mju_rayGeom(at, turned, size, origin, direction, kind, normal))
