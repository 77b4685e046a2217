"""What never changes in a recording: the arena, the vehicle's shapes, and how lines are drawn."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simloop.config import VehicleConfig
from simloop.messages import FloatArray
from simloop.recording.shapes import Body, Shape

if TYPE_CHECKING:
    import rerun as rr

MAP = "map"
ODOM = "map/odom"
BASE = "map/odom/base_link"
CAMERA = f"{BASE}/camera"

_LINES = {
    f"{MAP}/plan/candidates": ([170, 196, 222], 0.004),
    f"{MAP}/plan/chosen": ([160, 60, 168], 0.008),
    f"{MAP}/path": ([30, 106, 201], 0.015),
    f"{MAP}/obstacle_discs": ([235, 130, 40], 0.006),
    f"{MAP}/movers": ([204, 82, 61], 0.012),
    f"{MAP}/goal_told": ([40, 160, 70], 0.012),
    f"{MAP}/ellipse_95_x10": ([200, 40, 120], 0.006),
    f"{MAP}/trails/truth": ([60, 150, 80], 0.01),
    f"{MAP}/trails/belief": ([40, 44, 52], 0.006),
    f"{MAP}/trails/odometry": ([200, 170, 60], 0.005),
    f"{MAP}/trails/wheels": ([150, 110, 70], 0.005),
}
_POINTS = {
    f"{MAP}/plan/waypoints": ([160, 60, 168], 0.02),
    f"{BASE}/laser/scan": ([214, 48, 48], 0.012),
    f"{MAP}/low_obstacles": ([128, 60, 20], 0.02),
}


def log_scene(
    stream: rr.RecordingStream,
    shapes: Sequence[Shape],
    bodies: Sequence[Body],
    goal: FloatArray,
    mounts: tuple[Sequence[float] | FloatArray, FloatArray | None],
    vehicle: VehicleConfig,
) -> None:
    """Log frames, shapes, styles and the goal, all of them static.

    mounts: (3,) of the laser in base_link, and of the camera, if there is one.
    """
    import rerun as rr

    def log(entity: str, *what: Any) -> None:
        stream.log(entity, *what, static=True)

    log(MAP, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for entity, place in zip((f"{BASE}/laser", CAMERA), mounts, strict=True):
        if place is not None:
            log(entity, rr.Transform3D(translation=place))
    homes = {"world": f"{MAP}/arena", "base_link": BASE}
    for body in bodies:
        if body.name not in homes:
            home = f"{homes[body.parent]}/{body.name}"
            turn = rr.Quaternion(xyzw=body.quaternion_wxyz[[1, 2, 3, 0]])
            log(home, rr.Transform3D(translation=body.position_m, quaternion=turn))
            homes[body.name] = f"{home}/turned"
    _log_shapes(log, shapes, homes)
    x, y = 0.5 * vehicle.length_m, 0.5 * vehicle.width_m
    ring = [[-x, -y, 0.005], [x, -y, 0.005], [x, y, 0.005], [-x, y, 0.005], [-x, -y, 0.005]]
    log(f"{MAP}/truth/footprint", rr.LineStrips3D([ring], colors=[60, 150, 80], radii=0.008))
    where = [[goal[0], goal[1], 0.004]]
    log(
        f"{MAP}/goal",
        rr.Cylinders3D(
            lengths=0.008, radii=0.1, centers=where, colors=[40, 160, 70], fill_mode="solid"
        ),
    )
    for entity, (colour, radius) in _LINES.items():
        log(entity, rr.LineStrips3D.from_fields(colors=[colour], radii=[radius]))
    for entity, (colour, radius) in _POINTS.items():
        log(entity, rr.Points3D.from_fields(colors=[colour], radii=[radius]))


def _log_shapes(log: Any, shapes: Sequence[Shape], homes: dict[str, str]) -> None:
    """Shapes of one kind on one body go into one entity; each mesh has its own."""
    groups: dict[tuple[str, str], list[Shape]] = defaultdict(list)
    for shape in shapes:
        name = shape.name if shape.kind == "mesh" else shape.kind
        groups[homes[shape.body], name].append(shape)
    for (home, name), group in groups.items():
        log(f"{home}/shapes/{name}", *_archetype(group))


def _archetype(group: list[Shape]) -> list[Any]:
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
        # A capsule's own frame begins at the centre of its lower ball.
        lengths, z = 2.0 * size[:, 1], np.array([_axis(q) for q in turns])
        starts = centres - size[:, 1:2] * z
        return [rr.Capsules3D(lengths=lengths, radii=size[:, 0], translations=starts, **common)]
    if kind in ("sphere", "ellipsoid"):
        half = size if kind == "ellipsoid" else np.repeat(size[:, :1], 3, axis=1)
        return [rr.Ellipsoids3D(half_sizes=half, centers=centres, **common)]
    if kind == "plane":
        size = np.column_stack([size[:, :2], np.full(len(size), 1e-3)])
        centres = centres - [0.0, 0.0, 2e-3]
    return [rr.Boxes3D(half_sizes=size, centers=centres, **common)]


def _axis(xyzw: FloatArray) -> FloatArray:
    """(3,) the z axis of a rotated frame."""
    x, y, z, w = xyzw
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
