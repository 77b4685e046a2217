"""Write the static parts of a recording: the arena, the vehicle, and the styles of lines."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from simloop.messages import FloatArray
from simloop.recording.shapes import Scene, Shape
from simloop.recording.stream import RecordingFile

MAP = "map"
ODOM = "map/odom"
BASE = "map/odom/base_link"
CAMERA = f"{BASE}/camera"

_TRUE_COLOUR, _GOAL_COLOUR = [60, 150, 80], [40, 160, 70]
# Colour, 0 to 255, and radius, m, of all lines and points of the run.
_LINES = {
    f"{MAP}/plan/candidates": ([170, 196, 222], 0.004),
    f"{MAP}/plan/chosen": ([160, 60, 168], 0.008),
    f"{MAP}/path": ([30, 106, 201], 0.015),
    f"{MAP}/obstacle_discs": ([235, 130, 40], 0.006),
    f"{MAP}/movers": ([204, 82, 61], 0.012),
    f"{MAP}/goal_told": (_GOAL_COLOUR, 0.012),
    f"{MAP}/ellipse_95_x10": ([200, 40, 120], 0.006),
    f"{MAP}/trails/truth": (_TRUE_COLOUR, 0.01),
    f"{MAP}/trails/belief": ([40, 44, 52], 0.006),
    f"{MAP}/trails/odometry": ([200, 170, 60], 0.005),
    f"{MAP}/trails/wheels": ([150, 110, 70], 0.005),
}
_POINTS = {
    f"{MAP}/plan/waypoints": ([160, 60, 168], 0.02),
    f"{BASE}/laser/scan": ([214, 48, 48], 0.012),
    f"{MAP}/low_obstacles": ([128, 60, 20], 0.02),
}


def log_scene(file: RecordingFile, scene: Scene) -> None:
    """Write the static parts: frames, shapes, styles of lines, and the goal.

    Args:
        file: The recording.
        scene: The scene to show.
    """
    rr = file.rr
    file.log_static(MAP, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for entity, place in ((f"{BASE}/laser", scene.laser_m), (CAMERA, scene.camera_m)):
        if place is not None:
            file.log_static(entity, rr.Transform3D(translation=place))
    # A body is two entities: its place in the parent, and below it the motion of its joint.
    entities = {"world": f"{MAP}/arena", "base_link": BASE}
    for body in scene.bodies:
        if body.name not in entities:
            entity = f"{entities[body.parent]}/{body.name}"
            turn = rr.Quaternion(xyzw=body.quaternion_wxyz[[1, 2, 3, 0]])
            file.log_static(entity, rr.Transform3D(translation=body.position_m, quaternion=turn))
            entities[body.name] = f"{entity}/turned"
    _log_shapes(file, scene.shapes, entities)
    x, y = 0.5 * scene.outline_m[0], 0.5 * scene.outline_m[1]
    ring = [[-x, -y, 0.005], [x, -y, 0.005], [x, y, 0.005], [-x, y, 0.005], [-x, -y, 0.005]]
    outline = rr.LineStrips3D([ring], colors=_TRUE_COLOUR, radii=0.008)
    file.log_static(f"{MAP}/truth/footprint", outline)
    goal = rr.Cylinders3D(
        lengths=0.008,
        radii=0.1,
        centers=[[*scene.goal_m[:2], 0.004]],
        colors=_GOAL_COLOUR,
        fill_mode="solid",
    )
    file.log_static(f"{MAP}/goal", goal)
    for entity, (colour, radius) in _LINES.items():
        file.log_static(entity, rr.LineStrips3D.from_fields(colors=[colour], radii=[radius]))
    for entity, (colour, radius) in _POINTS.items():
        file.log_static(entity, rr.Points3D.from_fields(colors=[colour], radii=[radius]))


def _log_shapes(file: RecordingFile, shapes: Sequence[Shape], entities: dict[str, str]) -> None:
    """Write shapes of one kind on one body into one entity, and each mesh into its own entity."""
    groups: dict[tuple[str, str], list[Shape]] = defaultdict(list)
    for shape in shapes:
        name = shape.name if shape.kind == "mesh" else shape.kind
        groups[entities[shape.body], name].append(shape)
    for (entity, name), group in groups.items():
        file.log_static(f"{entity}/shapes/{name}", *_archetypes(group))


def _archetypes(group: list[Shape]) -> list[Any]:
    """Make the library's objects for shapes of one kind."""
    import rerun as rr

    kind = group[0].kind
    size = np.array([s.size_m for s in group])
    colours = np.round(255.0 * np.array([s.rgba for s in group])).astype(np.uint8)
    centres = np.array([s.position_m for s in group])
    turns = np.array([s.quaternion_wxyz for s in group])[:, [1, 2, 3, 0]]
    common: dict[str, Any] = {"quaternions": turns, "colors": colours, "fill_mode": "solid"}
    if kind == "mesh":
        (shape,) = group
        assert shape.vertices_m is not None
        mesh = rr.Mesh3D(
            vertex_positions=shape.vertices_m,
            triangle_indices=shape.faces,
            albedo_factor=colours[0],
        )
        pose = rr.InstancePoses3D(translations=centres, quaternions=turns)
        return [mesh, pose]
    if kind == "cylinder":
        return [
            rr.Cylinders3D(lengths=2.0 * size[:, 1], radii=size[:, 0], centers=centres, **common)
        ]
    if kind == "capsule":
        # The library places a capsule by the centre of its lower ball, MJCF by its middle.
        lengths, z = 2.0 * size[:, 1], np.array([_axis(q) for q in turns])
        starts = centres - size[:, 1:2] * z
        return [rr.Capsules3D(lengths=lengths, radii=size[:, 0], translations=starts, **common)]
    if kind in ("sphere", "ellipsoid"):
        half = size if kind == "ellipsoid" else np.repeat(size[:, :1], 3, axis=1)
        return [rr.Ellipsoids3D(half_sizes=half, centers=centres, **common)]
    if kind == "plane":
        # A plane is drawn as a thin box below its height, so that it does not hide the map.
        size = np.column_stack([size[:, :2], np.full(len(size), 1e-3)])
        centres = centres - [0.0, 0.0, 2e-3]
    return [rr.Boxes3D(half_sizes=size, centers=centres, **common)]


def _axis(xyzw: FloatArray) -> FloatArray:
    """Compute the z axis (3,) of a rotated frame."""
    x, y, z, w = xyzw
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
