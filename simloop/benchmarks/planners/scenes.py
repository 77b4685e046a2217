"""The fixed planning scenes S1 to S4 on which planners are compared, and a clearance check.

S1 is the four-obstacle scene of the TLBO papers (same start, goal and safe distance). S2 and S3 are
rooms with twelve and fifty discs. S4 is a U-shaped trap in a distance field. In all of them the
rooms with twelve and fifty discs. S4 is a U-shaped trap in a distance field. In all of them the
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simloop.messages import FloatArray, WorldView

_S1_DISCS = ((3.2, 0.6, 0.30), (4.3, 1.7, 0.35), (5.3, 1.5, 0.30), (6.1, 2.7, 0.30))
_S4_BOXES = (
    (5.0, 3.0, 5.2, 7.0),
    (3.0, 6.8, 5.2, 7.0),
    (3.0, 3.0, 5.2, 3.2),
    (7.0, 4.0, 7.2, 10.0),
    (6.0, 0.0, 6.2, 1.8),
)
_S4_RESOLUTION_M = 0.05
SCENE_NAMES = ("S1", "S2", "S3", "S4a", "S4b")


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One planning task.

    Attributes:
        name: Name of the task.
        world: The view that the planner receives.
        start: (3,) x, y, yaw, m and rad, map frame.
        goal: (2,) x, y, m, map frame.
        safe_m: Distance that the path must keep from every obstacle, m.
        boxes_m: (B, 4) x_min, y_min, x_max, y_max of the true obstacles behind a distance field,
            m, map frame; (0, 4) if the view is exact.
        best_cost: J* if it is stored; among discs `exact.exact_path` computes it.
    """

    name: str
    world: WorldView
    start: FloatArray
    goal: FloatArray
    safe_m: float
    boxes_m: FloatArray
    best_cost: float | None = None


def disc_world(discs: FloatArray, bounds: tuple[float, float, float, float]) -> WorldView:
    """Make a view with discs only.

    Args:
        discs: (K, 3) x, y, radius, m, map frame.
        bounds: x_min, y_min, x_max, y_max, m, map frame.

    Returns:
        The view.
    """
    return WorldView(
        t_ns=0,
        origin_m=np.array(bounds[:2]),
        resolution_m=0.05,
        distance_m=np.zeros((0, 0), dtype=np.float32),
        discs_xyr_m=np.array(discs, dtype=np.float64).reshape(-1, 3),
        bounds_m=np.array(bounds),
    )


def box_distance(boxes: FloatArray, points: FloatArray) -> FloatArray:
    """Compute the distance from points to the nearest of several boxes.

    Args:
        boxes: (B, 4) x_min, y_min, x_max, y_max, m.
        points: (N, 2) points, m.

    Returns:
        (N,) distances, m; 0 inside a box.
    """
    low = boxes[None, :, :2] - points[:, None]
    high = points[:, None] - boxes[None, :, 2:]
    outside = np.maximum(np.maximum(low, high), 0.0)
    return np.hypot(outside[..., 0], outside[..., 1]).min(axis=1)


def box_world(boxes: FloatArray, size_m: float, resolution_m: float) -> WorldView:
    """Make a view with a square distance field of boxes, exact at the cells' centres.

    Args:
        boxes: (B, 4) x_min, y_min, x_max, y_max, m, map frame.
        size_m: Side of the square, whose lower left corner is the origin, m.
        resolution_m: Side of a cell, m.

    Returns:
        The view.
    """
    cells = round(size_m / resolution_m)
    centres = (np.arange(cells) + 0.5) * resolution_m
    x, y = np.meshgrid(centres, centres)
    distance = box_distance(boxes, np.column_stack([x.ravel(), y.ravel()]))
    return WorldView(
        t_ns=0,
        origin_m=np.zeros(2),
        resolution_m=resolution_m,
        distance_m=distance.reshape(cells, cells).astype(np.float32),
        discs_xyr_m=np.zeros((0, 3)),
        bounds_m=np.array([0.0, 0.0, size_m, size_m]),
    )


def _random_discs(
    seed: int, count: int, size: float, radii: tuple[float, float], ends: FloatArray
) -> FloatArray:
    """Draw discs until ``count`` of them keep 0.31 m from both ends; the others are dropped."""
    rng = np.random.default_rng(seed)
    discs: list[tuple[float, float, float]] = []
    while len(discs) < count:
        x, y = rng.uniform(0.0, size, 2)
        r = rng.uniform(*radii)
        if np.hypot(*(ends - (x, y)).T).min() >= r + 0.31:
            discs.append((x, y, r))
    return np.array(discs)


def _scattered(
    name: str, seed: int, count: int, size: float, radii: tuple[float, float], ends: FloatArray
) -> Instance:
    """Make a square room with random discs between two ends (2, 2)."""
    discs = _random_discs(seed, count, size, radii, ends)
    world = disc_world(discs, (0.0, 0.0, size, size))
    start = np.array([*ends[0], 0.0])
    return Instance(name, world, start, ends[1], 0.26, np.zeros((0, 4)))


def scene(name: str) -> list[Instance]:
    """Return the instances of a scene.

    Args:
        name: One of `SCENE_NAMES`.

    Returns:
        One instance for S1, S4a and S4b, twenty for S2, ten for S3.

    Raises:
        ValueError: The name is unknown.
    """
    if name == "S1":
        world = disc_world(np.array(_S1_DISCS), (1.5, -1.5, 7.5, 4.5))
        start, goal = np.array([2.0, 0.0, 0.0]), np.array([7.0, 3.0])
        return [Instance("S1", world, start, goal, 0.30, np.zeros((0, 4)))]
    if name == "S2":
        ends = np.array([[0.0, 0.0], [3.6, 3.9]])
        seeds = [s for s in range(22) if s not in (4, 16)]
        return [_scattered(f"S2-{s}", 1000 + s, 12, 5.0, (0.10, 0.25), ends) for s in seeds]
    if name == "S3":
        ends = np.array([[0.5, 0.5], [9.5, 9.5]])
        return [_scattered(f"S3-{s}", 2000 + s, 50, 10.0, (0.10, 0.30), ends) for s in range(10)]
    if name in ("S4a", "S4b"):
        boxes = np.array(_S4_BOXES)
        world = box_world(boxes, 10.0, _S4_RESOLUTION_M)
        x, best = (1.0, 6.8261) if name == "S4a" else (4.2, 7.2490)
        start, goal = np.array([x, 5.0, 0.0]), np.array([9.0, 5.0])
        return [Instance(name, world, start, goal, 0.26, boxes, best)]
    raise ValueError(f"unknown scene {name!r}; choose from {', '.join(SCENE_NAMES)}")


def true_clearance(instance: Instance, waypoints: FloatArray, step_m: float = 2e-4) -> float:
    """Compute the clearance of a path by dense samples, from the true discs and boxes.

    The code is independent of the planners' kernels. Its error is at most
    step_m^2 / (8 clearance).

    Args:
        instance: The task.
        waypoints: (M, 2) waypoints, m, map frame.
        step_m: Distance between the samples, m.

    Returns:
        Least distance from any obstacle, m; negative inside a disc, 0 inside a box.
    """
    worst = np.inf
    for a, b in pairwise(waypoints):
        count = 2 + int(np.hypot(*(b - a)) / step_m)
        points = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        if len(instance.boxes_m):
            worst = min(worst, float(box_distance(instance.boxes_m, points).min()))
        for x, y, r in instance.world.discs_xyr_m:
            worst = min(worst, float(np.hypot(points[:, 0] - x, points[:, 1] - y).min() - r))
    return worst
