"""Read geoms as plain solids from a compiled model, or from a specification before compilation.

The specification shows which obstacles an arena has without compiling it. So obstacles and movers
can be drawn first, and the world is compiled only once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from simloop.messages import FloatArray

_Pose = tuple[FloatArray, FloatArray]
_IDENTITY: _Pose = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
_MESH = mujoco.mjtGeom.mjGEOM_MESH
_WITHOUT_LIMITS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)


class Solid(NamedTuple):
    """One geom with its pose.

    Attributes:
        name: name of the geom.
        kind: shape of the geom.
        size_m: (3,) size as MuJoCo defines it for the shape: radii or half lengths.
        position_m: (3,) position of the centre.
        rotation: (3, 3) rotation from the geom's frame to the frame of ``position_m``.
        vertices_m: (V, 3) vertices of a mesh in the geom's frame; (0, 3) for all other shapes.
    """

    name: str
    kind: mujoco.mjtGeom
    size_m: FloatArray
    position_m: FloatArray
    rotation: FloatArray
    vertices_m: FloatArray

    def reach_m(self, direction: FloatArray) -> float:
        """Compute how far the solid extends along a direction (its support function).

        Args:
            direction: (3,) unit vector in the frame of ``position_m``.

        Returns:
            The greatest coordinate along ``direction``, m.

        Raises:
            ValueError: the geom is a plane or a height field, which have no such limit here.
        """
        local, size = direction @ self.rotation, self.size_m
        if self.kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            extent = float(size[0])
        elif self.kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            extent = float(size[0] + size[1] * abs(local[2]))
        elif self.kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            extent = float(size[0] * math.hypot(local[0], local[1]) + size[1] * abs(local[2]))
        elif self.kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            extent = float(np.linalg.norm(local * size))
        elif self.kind == mujoco.mjtGeom.mjGEOM_BOX:
            extent = float(np.abs(local) @ size)
        elif self.kind == _MESH:
            extent = float((self.vertices_m @ local).max())
        else:
            raise ValueError(f"geom {self.name!r} of type {self.kind.name} has no limits")
        return float(direction @ self.position_m) + extent


def solid_of_model(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Solid:
    """Read a geom of a compiled model, in the world frame.

    Args:
        model: the compiled model.
        data: its state, after ``mj_kinematics``.
        geom: the geom's number.

    Returns:
        The solid at its present pose.
    """
    vertices = np.zeros((0, 3))
    if model.geom_type[geom] == _MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    return Solid(
        model.geom(geom).name,
        mujoco.mjtGeom(int(model.geom_type[geom])),
        np.array(model.geom_size[geom]),
        np.array(data.geom_xpos[geom]),
        np.array(data.geom_xmat[geom]).reshape(3, 3),
        vertices,
    )


def solids_of_spec(
    spec: mujoco.MjSpec, root: mujoco.MjsBody, *, jointed: bool, skip: str = ""
) -> list[Solid]:
    """Read the collision geoms of a body and of all bodies below it, before compilation.

    Planes and height fields are left out. Joints are at zero. Meshes from files, and shapes that
    MuJoCo fits to a mesh, cannot be read from the specification. For them, a copy of it with only
    these geoms is compiled.

    Args:
        spec: the specification; it is not changed.
        root: the body to start from; ``spec.worldbody`` for the whole world.
        jointed: whether to include bodies that have joints, and bodies below them.
        skip: name of a body to leave out, with all bodies below it.

    Returns:
        The solids, in the frame of ``root``.
    """
    solids: list[Solid] = []
    unread: list[mujoco.MjsGeom] = []
    for body, pose in _bodies(root, _IDENTITY, jointed=jointed, skip=skip):
        for geom in body.geoms:
            if not (geom.contype or geom.conaffinity) or geom.type in _WITHOUT_LIMITS:
                continue
            if geom.meshname and not _is_plain(spec.mesh(geom.meshname), geom):
                unread.append(geom)
            else:
                solids.append(_solid(spec, geom, pose))
    return solids + (_compiled(spec, root, unread) if unread else [])


def _bodies(
    body: mujoco.MjsBody, pose: _Pose, *, jointed: bool, skip: str
) -> Iterator[tuple[mujoco.MjsBody, _Pose]]:
    """List the body and all below it, each with its pose in the frame of the first."""
    yield body, pose
    for child in body.bodies:
        left_out = child.mocap or (skip and child.name == skip)
        if not left_out and (jointed or not len(child.joints)):
            inner = _compose(pose, _out_of_frames(_own_pose(child), child.frame))
            yield from _bodies(child, inner, jointed=jointed, skip=skip)


def _compose(outer: _Pose, inner: _Pose) -> _Pose:
    """Transform ``inner``, a pose in ``outer``, to the frame in which ``outer`` is given."""
    moved, turned = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(moved, inner[0], outer[1])
    mujoco.mju_mulQuat(turned, outer[1], inner[1])
    return outer[0] + moved, turned


def _out_of_frames(pose: _Pose, frame: mujoco.MjsFrame | None) -> _Pose:
    """Transform a pose from a frame, perhaps inside other frames, to the body that holds them."""
    while frame is not None:
        pose, frame = _compose(_own_pose(frame), pose), frame.frame
    return pose


def _own_pose(element: mujoco.MjsBody | mujoco.MjsGeom | mujoco.MjsFrame) -> _Pose:
    """Read the element's own pose, with its orientation as a unit quaternion."""
    if element.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
        quat = np.array(element.quat, np.float64)
    else:
        quat = np.array(
            mujoco.MjSpec.resolve_orientation(
                degree=element.compiler.degree,
                sequence=element.compiler.eulerseq,
                orientation=element.alt,
            )
        )
    mujoco.mju_normalize4(quat)
    return np.array(element.pos, np.float64), quat


def _solid(spec: mujoco.MjSpec, geom: mujoco.MjsGeom, body: _Pose) -> Solid:
    """Read a geom whose shape is in the specification. body: the pose of its body."""
    size, vertices = np.array(geom.size, np.float64), np.zeros((0, 3))
    pose = _own_pose(geom)
    if np.isfinite(geom.fromto[0]):
        size, pose = _between_ends(geom, size)
    pose = _out_of_frames(pose, geom.frame)
    if geom.type == _MESH:
        mesh = spec.mesh(geom.meshname)
        vertices = np.array(list(mesh.uservert), np.float64).reshape(-1, 3) * np.array(mesh.scale)
    position, quat = _compose(body, pose)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, quat)
    return Solid(geom.name, geom.type, size, position, rotation.reshape(3, 3), vertices)


def _between_ends(geom: mujoco.MjsGeom, size: FloatArray) -> tuple[FloatArray, _Pose]:
    """Compute size and pose of a geom given by the two ends of its axis, as MuJoCo does."""
    ends = np.array(geom.fromto, np.float64)
    axis, quat = ends[:3] - ends[3:], np.zeros(4)
    half = 0.5 * mujoco.mju_normalize3(axis)
    mujoco.mju_quatZ2Vec(quat, axis)
    if geom.type in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        size = np.array([size[0], size[0], half])
    else:
        size = np.array([size[0], half, 0.0])
    return size, (0.5 * (ends[:3] + ends[3:]), quat)


def _is_plain(mesh: mujoco.MjsMesh, geom: mujoco.MjsGeom) -> bool:
    """Tell whether the specification holds the vertices of a geom's mesh as they are used."""
    plain_pose = not np.any(mesh.refpos) and np.array_equal(mesh.refquat, _IDENTITY[1])
    return bool(geom.type == _MESH and not mesh.file and len(mesh.uservert) and plain_pose)


def _compiled(
    spec: mujoco.MjSpec, root: mujoco.MjsBody, geoms: list[mujoco.MjsGeom]
) -> list[Solid]:
    """Read these geoms, in the frame of ``root``, from a compiled copy without all others."""
    copy = spec.copy()
    meshes = {geom.meshname for geom in geoms}
    for geom, original in zip(copy.geoms, spec.geoms, strict=True):
        if original not in geoms:
            copy.delete(geom)
    for others in (copy.joints, copy.actuators, copy.sensors, copy.keys):
        for element in others:
            copy.delete(element)
    for mesh in copy.meshes:
        if mesh.name not in meshes:
            copy.delete(mesh)
    model = copy.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    at = model.body(root.name).id
    turned = data.xmat[at].reshape(3, 3)
    solids = [solid_of_model(model, data, geom) for geom in range(model.ngeom)]
    return [
        solid._replace(
            position_m=(solid.position_m - data.xpos[at]) @ turned,
            rotation=turned.T @ solid.rotation,
        )
        for solid in solids
    ]
