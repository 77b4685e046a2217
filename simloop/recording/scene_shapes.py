"""Read the visible scene, its bodies and shapes, from a compiled model."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import is_free, road_wheels, sprocket_radius
from simloop.recording.shapes import Body, Scene, Shape, ShapeKind
from simloop.scenario.build import World
from simloop.scenario.scenario import Scenario

_COLLISION_GROUP = 3
_KINDS: dict[int, ShapeKind] = {
    mujoco.mjtGeom.mjGEOM_PLANE.value: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE.value: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE.value: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID.value: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER.value: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX.value: "box",
    mujoco.mjtGeom.mjGEOM_MESH.value: "mesh",
}


def scene_of(scenario: Scenario, world: World) -> Scene:
    """Describe what a recording shows before the run begins.

    Args:
        scenario: The scenario of the run.
        world: Its built world.

    Returns:
        The scene. Sizes and counts come from the compiled model.
    """
    model = world.model
    return Scene(
        scene_shapes(model),
        scene_bodies(model),
        np.array(world.floor.bounds_m),
        np.array(scenario.start),
        np.array(scenario.goal),
        model.site("lidar").pos,
        len(road_wheels(model)) // 2,
        model.site("camera").pos if scenario.config.camera.enabled else None,
        (world.body.length_m, world.body.width_m),
        sprocket_radius(model),
        title_of(scenario),
    )


def title_of(scenario: Scenario) -> str:
    """Make the title of a recording or a contact sheet.

    Args:
        scenario: The scenario of the run.

    Returns:
        Title and seed.
    """
    return f"{scenario.title or scenario.name}, seed {scenario.seed}"


def scene_shapes(model: mujoco.MjModel) -> list[Shape]:
    """List all visible geoms, that is those outside the collision group.

    Args:
        model: The compiled model.

    Returns:
        One shape for each visible geom.
    """
    shapes = []
    for geom in range(model.ngeom):
        field = int(model.geom_type[geom]) == mujoco.mjtGeom.mjGEOM_HFIELD
        kind = "mesh" if field else _KINDS.get(int(model.geom_type[geom]))
        if kind is None or model.geom_group[geom] >= _COLLISION_GROUP:
            continue
        material = model.geom_matid[geom]
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        vertices = faces = None
        if field:
            vertices, faces = _surface_of(model, int(model.geom_dataid[geom]))
        elif kind == "mesh":
            mesh = model.mesh(model.geom_dataid[geom])
            start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            vertices = model.mesh_vert[start : start + count].astype(np.float64)
            start, count = int(mesh.faceadr[0]), int(mesh.facenum[0])
            faces = model.mesh_face[start : start + count].copy()
        shapes.append(
            Shape(
                model.geom(geom).name or f"geom_{geom}",
                model.body(model.geom_bodyid[geom]).name,
                kind,
                model.geom_pos[geom].copy(),
                model.geom_quat[geom].copy(),
                model.geom_size[geom].copy(),
                rgba.astype(np.float64),
                vertices,
                faces,
            )
        )
    return shapes


def _surface_of(model: mujoco.MjModel, field: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """Compute vertices (n, 3), m, and triangles (m, 3) of a height field, in its geom's frame."""
    # MuJoCo stores the heights in rows along y, scaled so that the highest is 1.
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, high, _ = model.hfield_size[field]
    start = int(model.hfield_adr[field])
    heights = high * model.hfield_data[start : start + rows * columns].astype(np.float64)
    x, y = np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows)
    grid_x, grid_y = np.meshgrid(x, y)
    vertices = np.stack([grid_x.ravel(), grid_y.ravel(), heights], axis=1)
    number = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = (
        part.ravel()
        for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    )
    # Two triangles for each cell with corners a, b (below) and d, c (above).
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return vertices, faces


def scene_bodies(model: mujoco.MjModel) -> list[Body]:
    """List every body except the world.

    Args:
        model: The compiled model.

    Returns:
        The bodies, parents first. A free body is at the origin: its pose comes with the run.
    """
    return [
        Body(
            model.body(i).name,
            model.body(model.body_parentid[i]).name,
            np.zeros(3) if is_free(model, i) else model.body_pos[i].copy(),
            np.array([1.0, 0.0, 0.0, 0.0]) if is_free(model, i) else model.body_quat[i].copy(),
        )
        for i in range(1, model.nbody)
    ]
