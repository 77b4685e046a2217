"""Make solids of the collision shapes of a Gazebo world.

Boxes, cylinders, spheres, capsules, ellipsoids, cones, and the parts of a polyline are convex
solids. A mesh is a shell of triangles, or convex solids if it is made of them. A plane is ground.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np

from simloop.common.errors import InputError
from simloop.common.limits import check_limit
from simloop.messages import FloatArray
from simloop.worlds.gazebo.convex_parts import closed_edges, convex_parts
from simloop.worlds.gazebo.meshes import convex_bodies, read_triangles
from simloop.worlds.gazebo.model_files import ModelFiles
from simloop.worlds.gazebo.models import Collision
from simloop.worlds.gazebo.values import child_numbers, is_true, numbers
from simloop.worlds.solids import Solid

_GEOM = mujoco.mjtGeom
_SUPPORTED = "box, cylinder, sphere, capsule, ellipsoid, cone, polyline, mesh, plane"
_ROUND = 64  # points around a cone
_LEVEL = 1e-3  # largest slope of a plane that is ground
_LEAST_M, _MOST_M = 1e-6, 1e5


class Shell(NamedTuple):
    """A mesh in map.

    Attributes:
        triangles: (N, 3, 3) corners, m, counter-clockwise seen from outside.
        mesh: file, part and scale; equal for meshes that differ only in their pose.
        local: (N, 3, 3) the corners in the mesh's own frame, scaled, m.
        pose: (4, 4) pose of that frame in map.
    """

    triangles: FloatArray
    mesh: tuple[object, ...]
    local: FloatArray
    pose: FloatArray


class _Mesh(NamedTuple):
    """A scaled mesh: its triangles (N, 3, 3), and its bodies (V, 3) if all are convex."""

    triangles: FloatArray
    bodies: list[FloatArray] | None


class Ground(NamedTuple):
    """A level plane.

    Attributes:
        height_m: its height in map, m.
    """

    height_m: float


Body = Solid | Shell | Ground


class ShapeReader:
    """Make solids of collision shapes. Each mesh file is read once."""

    def __init__(self, files: ModelFiles) -> None:
        """Set where meshes are found.

        Args:
            files: finds the files of meshes.
        """
        self._files = files
        self._meshes: dict[tuple[Path, str], FloatArray] = {}
        self._scaled: dict[tuple[object, ...], _Mesh] = {}
        self._triangles = 0

    def bodies(self, collision: Collision) -> list[Body]:
        """Make the solids of a collision shape.

        Args:
            collision: the shape and its pose.

        Returns:
            Its bodies in map.

        Raises:
            InputError: the shape is not supported, or its size is impossible.
        """
        shape = next(one for one in collision.geometry if ":" not in one.tag)
        if shape.tag == "plane":
            return [_plane(collision, shape)]
        if shape.tag == "polyline":
            return list(_polyline(collision))
        if shape.tag == "mesh":
            return self._mesh(collision, shape)
        size = _size(collision, shape)
        if shape.tag == "cone":
            return [_hull(collision, _cone(size))]
        kinds = {
            "box": _GEOM.mjGEOM_BOX,
            "cylinder": _GEOM.mjGEOM_CYLINDER,
            "sphere": _GEOM.mjGEOM_SPHERE,
            "capsule": _GEOM.mjGEOM_CAPSULE,
            "ellipsoid": _GEOM.mjGEOM_ELLIPSOID,
        }
        return [_solid(collision, kinds[shape.tag], size, np.zeros((0, 3)))]

    def _mesh(self, collision: Collision, shape: Xml.Element) -> list[Body]:
        uri = (shape.findtext("uri") or "").strip()
        part = (shape.findtext("submesh/name") or "").strip()
        file = self._files.file(f"{collision.where}: mesh", uri, collision.folder)
        if (file, part) not in self._meshes:
            self._meshes[file, part] = read_triangles(collision.where, file, part)
        triangles = self._meshes[file, part]
        self._triangles += len(triangles)
        check_limit(self._triangles, 2e6, f"{collision.where}: triangles of all meshes up to here")
        centred = bool(part) and is_true(
            collision.where, "center", shape.findtext("submesh/center"), otherwise=False
        )
        scale = np.array(collision.scale)
        if shape.find("scale") is not None:
            scale = scale * child_numbers(collision.where, shape, "scale", 3)
        if not np.all(np.abs(scale) >= _LEAST_M):
            raise InputError(f"{collision.where}: a mesh with an impossible scale")
        hull = shape.get("optimization") == "convex_hull"
        key = (file, part, centred, hull, *scale.tolist())
        if key not in self._scaled:
            self._scaled[key] = _scaled(triangles, scale, centred, hull)
        mesh, pose = self._scaled[key], collision.pose
        if mesh.bodies is not None:
            return [_hull(collision, vertices) for vertices in mesh.bodies]
        placed = mesh.triangles @ pose[:3, :3].T + pose[:3, 3]
        return [Shell(placed, key, mesh.triangles, pose)]


def _scaled(triangles: FloatArray, scale: FloatArray, centred: bool, hull: bool) -> _Mesh:
    """Scale triangles (N, 3, 3) by factors (3,), and find their convex bodies or their hull."""
    if centred:
        corners = triangles.reshape(-1, 3)
        triangles = triangles - 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    triangles = triangles * scale
    if np.prod(scale) < 0.0:  # mirrored: the outside would be inside
        triangles = triangles[:, ::-1]
    return _Mesh(triangles, [triangles.reshape(-1, 3)] if hull else convex_bodies(triangles))


def _size(collision: Collision, shape: Xml.Element) -> tuple[float, float, float]:
    """Read the size of a shape: half lengths and radii as MuJoCo orders them, scaled."""
    where, (x, y, z) = collision.where, collision.scale
    if shape.tag == "box":
        length, width, height = child_numbers(where, shape, "size", 3)
        size = (0.5 * length * x, 0.5 * width * y, 0.5 * height * z)
    elif shape.tag == "ellipsoid":
        a, b, c = child_numbers(where, shape, "radii", 3)
        size = (a * x, b * y, c * z)
    elif shape.tag == "sphere":
        radius = child_numbers(where, shape, "radius", 1)[0] * max(x, y, z)
        size = (radius, radius, radius)
    elif shape.tag in ("cylinder", "capsule", "cone"):
        # Gazebo scales a radius by the larger of the two factors.
        radius = child_numbers(where, shape, "radius", 1)[0] * max(x, y)
        half = 0.5 * child_numbers(where, shape, "length", 1)[0] * z
        size = (radius, half, radius)
    else:
        what = f"{where}: a {shape.tag[:40]} {shape.findtext('uri') or ''}".rstrip()
        raise InputError(f"{what}: not supported; supported are {_SUPPORTED}")
    least = 0.0 if shape.tag == "capsule" else _LEAST_M
    if not (
        size[0] >= _LEAST_M and size[1] >= least and size[2] >= _LEAST_M and max(size) <= _MOST_M
    ):
        raise InputError(f"{where}: a {shape.tag} of an impossible size")
    return size


def _solid(
    collision: Collision,
    kind: mujoco.mjtGeom,
    size: tuple[float, float, float],
    vertices: FloatArray,
) -> Solid:
    pose = collision.pose
    return Solid(collision.model, kind, np.array(size), pose[:3, 3], pose[:3, :3], vertices)


def _hull(collision: Collision, vertices: FloatArray) -> Solid:
    """Make the convex hull of points (V, 3) in the shape's frame."""
    return _solid(collision, _GEOM.mjGEOM_MESH, (0.0, 0.0, 0.0), vertices)


def _cone(size: tuple[float, float, float]) -> FloatArray:
    """List the vertices (V, 3) of a cone whose apex is on top."""
    angle = 2.0 * math.pi * np.arange(_ROUND) / _ROUND
    ring = np.stack(
        [size[0] * np.cos(angle), size[0] * np.sin(angle), np.full(_ROUND, -size[1])], axis=1
    )
    return np.concatenate([ring, [[0.0, 0.0, size[1]]]])


def _plane(collision: Collision, shape: Xml.Element) -> Ground:
    normal = np.array([0.0, 0.0, 1.0])
    if (shape.findtext("normal") or "").strip():
        normal = np.array(child_numbers(collision.where, shape, "normal", 3))
    length = float(np.linalg.norm(normal))
    up = float(collision.pose[2, :3] @ normal) / length if length > 0.0 else 0.0
    if up < math.cos(_LEVEL):
        raise InputError(f"{collision.where}: a plane that is not level and facing up")
    return Ground(float(collision.pose[2, 3]))


def _polyline(collision: Collision) -> list[Solid]:
    """Make the convex parts of upright walls on outlines. Outlines in outlines are holes."""
    where = collision.where
    loops, height = [], 0.0
    for outline in collision.geometry.findall("polyline"):
        points = [numbers(where, "polyline point", one.text, 2) for one in outline.findall("point")]
        if len(points) < 3:
            raise InputError(f"{where}: a polyline of less than 3 points")
        loops.append(closed_edges(np.array(points)))
        height = height or child_numbers(where, outline, "height", 1)[0] * collision.scale[2]
    edges = np.concatenate(loops)
    if not _LEAST_M <= height <= _MOST_M:
        raise InputError(f"{where}: a polyline of an impossible height")
    parts = convex_parts(edges, even_odd=True)
    if parts is None:
        raise InputError(f"{where}: a polyline that is too intricate")
    return [
        _hull(
            collision,
            np.concatenate([np.column_stack([part, np.full(len(part), z)]) for z in (0.0, height)]),
        )
        for part in parts
    ]
