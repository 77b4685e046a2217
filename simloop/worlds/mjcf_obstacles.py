"""Add obstacles to a world before it is compiled."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from simloop.worlds.obstacles import Obstacle

_MATERIALS = ("oak", "teal", "brick", "mustard", "slate", "sage", "plum")


def add_obstacles(world: mujoco.MjSpec, obstacles: Sequence[Obstacle], first: int = 1) -> None:
    """Add static geoms named ``obstacle_drawn_NN``, numbered in order.

    Args:
        world: the specification to add to.
        obstacles: the obstacles to add.
        first: number of the first obstacle.
    """
    for number, obstacle in enumerate(obstacles, start=first):
        _add_obstacle(world, f"obstacle_drawn_{number:02d}", obstacle, number)


def _add_obstacle(world: mujoco.MjSpec, name: str, obstacle: Obstacle, number: int) -> None:
    parts = obstacle.parts()
    for letter, part in zip("ab", parts, strict=False):
        geom = world.worldbody.add_geom(
            name=name if len(parts) == 1 else f"{name}_{letter}",
            contype=1,
            conaffinity=0,
            material=_MATERIALS[number % len(_MATERIALS)],
        )
        _shape(world, geom, part)


def _shape(world: mujoco.MjSpec, geom: mujoco.MjsGeom, part: Obstacle) -> None:
    x, y = part.position_m
    half_height = 0.5 * part.height_m
    geom.pos = [x, y, part.bottom_m + half_height]
    geom.quat = [np.cos(0.5 * part.yaw_rad), 0.0, 0.0, np.sin(0.5 * part.yaw_rad)]
    if part.shape == "cylinder":
        geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [0.5 * part.size_m[0], half_height, 0.0]
    elif part.shape == "box":
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size = [0.5 * part.size_m[0], 0.5 * part.size_m[1], half_height]
    else:
        # An ellipse is a prism too. An ellipsoid would overhang, and the LiDAR would see a smaller
        # outline than the hull touches.
        section = Obstacle(
            part.shape, (0.0, 0.0), part.size_m, 0.0, part.height_m, part.vertices_m
        ).sections()[0]
        outline = section.vertices_m[:: 2 if part.shape == "ellipse" else 1]
        vertices = [
            np.column_stack([outline, np.full(len(outline), z)])
            for z in (-half_height, half_height)
        ]
        mesh = world.add_mesh(name=geom.name, uservert=np.concatenate(vertices).ravel().tolist())
        geom.type = mujoco.mjtGeom.mjGEOM_MESH
        geom.meshname = mesh.name
