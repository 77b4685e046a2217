"""The description of a scene to draw, independent of any physics engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray

ShapeKind = Literal["plane", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One visible shape, in the frame of its body.

    Attributes:
        name: Name of the shape.
        body: Name of its body; ``world`` for the arena.
        kind: Kind of the shape. A height field is a mesh here.
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
    """A body that has shapes.

    Attributes:
        name: Name of the body.
        parent: Name of its parent body.
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
        shapes: The visible shapes.
        bodies: Their bodies, parents first.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the arena in map, m.
        start: (3,) x, y, yaw of base_link in map at the start, where odometry starts.
        goal_m: (2,) goal in map, m.
        laser_m: (3,) position of the LiDAR in base_link, m.
        road_wheels: Number of road wheels of each track.
        camera_m: (3,) position of the depth camera in base_link, m; None if there is none.
        outline_m: True length and width of the vehicle, m.
        sprocket_radius_m: True radius of its sprockets, m.
        title: Title of the recording.
    """

    shapes: list[Shape]
    bodies: list[Body]
    bounds_m: FloatArray
    start: FloatArray
    goal_m: FloatArray
    laser_m: FloatArray
    road_wheels: int
    camera_m: FloatArray | None = None
    outline_m: tuple[float, float] = (0.49, 0.465)
    sprocket_radius_m: float = 0.037
    title: str = ""
