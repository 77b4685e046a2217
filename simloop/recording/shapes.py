"""Describes a scene to be drawn, independent of any physics engine."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simloop.config import VehicleConfig
from simloop.messages import FloatArray

ShapeKind = Literal["plane", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One visible shape, in the frame of the body that carries it.

    Attributes:
        name: Its name.
        body: The body that carries it; ``world`` for the arena.
        kind: What it is. A height field is a mesh here.
        position_m: (3,) its centre in the body's frame, m.
        quaternion_wxyz: (4,) its attitude in the body's frame.
        size_m: (3,) as in MJCF, m: half sizes of a box and an ellipsoid, half extents of a plane;
            radius and half length of a cylinder and a capsule; radius of a sphere.
        rgba: (4,) colour, each 0 to 1.
        vertices_m: (V, 3) vertices of a mesh, m; None for all other kinds.
        faces: (F, 3) vertex numbers of a mesh's triangles; None for all other kinds.
    """

    name: str
    body: str
    kind: ShapeKind
    position_m: FloatArray
    quaternion_wxyz: FloatArray
    size_m: FloatArray
    rgba: FloatArray
    vertices_m: FloatArray | None = None
    faces: NDArray[np.int32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body that carries shapes.

    Attributes:
        name: Its name.
        parent: The name of its parent body.
        position_m: (3,) its place in the parent's frame with its joint at zero, m.
        quaternion_wxyz: (4,) its attitude in the parent's frame with its joint at zero.
    """

    name: str
    parent: str
    position_m: FloatArray
    quaternion_wxyz: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that a recording shows before the run begins.

    Attributes:
        shapes: What is visible.
        bodies: What carries it, parents first.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the arena in map, m.
        start: (3,) x, y, yaw of base_link in map at the start, where odometry begins.
        goal_m: (2,) goal in map, m.
        laser_m: (3,) the LiDAR in base_link, m.
        road_wheels: Road wheels of each track.
        camera_m: (3,) the depth camera in base_link, m; None if there is none.
        vehicle: Size of the vehicle.
        title: What the recording is called.
    """

    shapes: list[Shape]
    bodies: list[Body]
    bounds_m: FloatArray
    start: FloatArray
    goal_m: FloatArray
    laser_m: FloatArray
    road_wheels: int
    camera_m: FloatArray | None = None
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    title: str = ""
