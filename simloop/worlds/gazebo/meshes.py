"""Read the meshes of a Gazebo world as triangles.

OBJ and binary STL files are read by MuJoCo. COLLADA, STL as text, and parts of a mesh by name need
the package trimesh.
"""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.limits import check_limit
from simloop.messages import FloatArray
from simloop.worlds.gazebo.xml_tree import parse_tree

MOST_TRIANGLES = 300_000
"""Triangles of a mesh, at most."""

_BY_MUJOCO = (".obj", ".stl")
_BY_TRIMESH = (".obj", ".stl", ".dae")
_SAME_M = 1e-6  # vertices that are nearer are one
_ROUND = 1e-6  # relative error of a volume


def read_triangles(where: str, file: Path, submesh: str = "") -> FloatArray:
    """Read a mesh.

    Args:
        where: file and model that name the mesh, for the error text.
        file: the mesh.
        submesh: name of the part to read; "": the whole mesh.

    Returns:
        (N, 3, 3) corners of the triangles, x, y, z, m, counter-clockwise seen from outside.

    Raises:
        InputError: the mesh cannot be read. The text has one line.
    """
    what, kind = f"{where}: mesh {file.name}", file.suffix.lower()
    if kind not in _BY_TRIMESH:
        raise InputError(f"{what}: format '{kind}'; choices: {', '.join(_BY_TRIMESH)}")
    data = read_bytes(file)
    # Known before the mesh is read: lines of an OBJ file, and the length of a binary STL file.
    lines = max(data.count(b"\nf"), data.count(b"\nv ")) if kind == ".obj" else 0
    check_limit(
        max(lines, len(data) // 50 if kind == ".stl" else 0),
        MOST_TRIANGLES,
        f"{what}: triangles or vertices",
    )
    plain = kind in _BY_MUJOCO and not submesh
    triangles = _by_mujoco(what, kind, data) if plain else _by_trimesh(what, kind, data, submesh)
    check_limit(len(triangles), MOST_TRIANGLES, f"{what}: triangles")
    if not len(triangles) or not np.abs(triangles).max() < 1e5:
        raise InputError(f"{what}: has no triangles, or is larger than 100 km")
    return triangles


def _by_mujoco(what: str, kind: str, data: bytes) -> FloatArray:
    """Read an OBJ or binary STL file with MuJoCo."""
    if kind == ".stl" and data[:5] == b"solid" and b"facet" in data[:1000]:
        return _by_trimesh(what, kind, data, "")  # MuJoCo does not read STL as text
    name = f"mesh{kind}"
    spec = mujoco.MjSpec()
    # As a shell, a mesh may be open.
    mesh = spec.add_mesh(name="mesh", file=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
    geom.contype = geom.conaffinity = 0  # without contacts, a mesh may be flat
    spec.assets = {name: data}
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{what}: cannot be read: {error}") from None
    # MuJoCo puts a mesh at its centre; this leads back.
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, model.mesh_quat[0])
    vertices = model.mesh_vert.astype(np.float64) @ turned.reshape(3, 3).T + model.mesh_pos[0]
    return vertices[model.mesh_face]


def _by_trimesh(what: str, kind: str, data: bytes, submesh: str) -> FloatArray:
    """Read any mesh with trimesh."""
    try:
        import trimesh

        if kind == ".dae":
            import collada  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"{what}: needs the package {error.name}: pip install 'simloop[worlds]'"
        ) from None
    log = logging.getLogger("trimesh")
    if not log.handlers:
        log.addHandler(logging.NullHandler())  # or it prints tracebacks of what it tries first
    if kind == ".dae":
        parse_tree(data, what)  # raises for entities, which could expand it
    try:
        # Without a resolver, no further file is read.
        scene: Any = trimesh.load_scene(
            io.BytesIO(data), file_type=kind[1:], resolver=None, skip_materials=True
        )
        unit = _unit_m(str(scene.units or "")) if kind == ".dae" else 1.0
        return unit * _of_scene(scene, submesh)
    except MemoryError:
        raise InputError(f"{what}: takes too much memory") from None
    except Exception as error:  # the readers raise errors of all kinds for a damaged file
        raise InputError(f"{what}: cannot be read: {error or type(error).__name__}") from None


def _of_scene(scene: Any, submesh: str) -> FloatArray:
    """List the triangles (N, 3, 3) of all meshes of a scene, or of those with a name."""
    found = [np.zeros((0, 3, 3))]
    names = set()
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        names |= {str(node), str(name)}
        if submesh and submesh not in (str(node), str(name)):
            continue
        mesh = scene.geometry[name]
        if hasattr(mesh, "faces"):
            corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
            placed = corners @ pose[:3, :3].T + pose[:3, 3]
            found.append(placed if np.linalg.det(pose[:3, :3]) > 0.0 else placed[:, ::-1])
    if submesh and len(found) == 1:
        raise ValueError(f"has no submesh '{submesh}'; there are {', '.join(sorted(names))}")
    return np.concatenate(found)


def _unit_m(text: str) -> float:
    """Read the length of a mesh's unit, m: trimesh gives ``0.0254 * meters``."""
    try:
        return float(text.partition("*")[0])
    except ValueError:
        return 1.0


def convex_bodies(triangles: FloatArray) -> list[FloatArray] | None:
    """Split a mesh into separate bodies, if they all are convex.

    Args:
        triangles: (N, 3, 3) its triangles.

    Returns:
        The vertices (V, 3) of each body; None if one is not closed or not convex.
    """
    cells = np.round(triangles.reshape(-1, 3) / _SAME_M).astype(np.int64)
    _, first, points = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    corners = points.reshape(-1, 3)
    links = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(links)), links.T), (len(first), len(first)))
    count, label = connected_components(graph, directed=False)
    if count > 200:
        return None
    bodies = []
    for body in range(count):
        own = triangles[label[corners[:, 0]] == body]
        vertices = triangles.reshape(-1, 3)[first[label == body]]
        if not _is_convex(own, vertices):
            return None
        bodies.append(vertices)
    return bodies


def _is_convex(triangles: FloatArray, vertices: FloatArray) -> bool:
    """Tell whether triangles (N, 3, 3) are the surface of the hull of their vertices (V, 3)."""
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError):
        return False
    a, b, c = (triangles - vertices.mean(axis=0)).transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    # The volume alone does not do: parts of a mesh can cancel out.
    near = abs(volume - hull.volume) < _ROUND * hull.volume + 1e-12
    return near and abs(area - hull.area) < _ROUND * hull.area + 1e-12
