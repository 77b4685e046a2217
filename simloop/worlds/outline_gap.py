"""The gap between the robot's true outline, a rectangle, and what truly stands on the floor."""

from __future__ import annotations

import numpy as np

from simloop.config import VehicleConfig
from simloop.messages import FloatArray
from simloop.worlds.floor_plan import FloorPlan, outline_edges, segment_distances

_BATCH = 64


def least_clearance(floor: FloorPlan, poses: FloatArray, vehicle: VehicleConfig) -> float:
    """The least gap over poses (N, 3) of base_link in map, m; inf on a floor without obstacles.

    Exact between rectangle and convex outlines; 0 or less where they overlap. Poses that cannot
    be the closest, by the distance of their centre, are left out of the exact search.
    """
    if not floor.sections or not len(poses):
        return float("inf")
    reach = 0.5 * float(np.hypot(vehicle.length_m, vehicle.width_m))
    lower = floor.clearance_m(poses[:, :2]) - reach
    order = np.argsort(lower, kind="stable")
    best = float("inf")
    for first in range(0, len(order), _BATCH):
        batch = order[first : first + _BATCH]
        if lower[batch[0]] >= best:
            break
        best = min(best, float(clearances(floor, poses[batch], vehicle).min()))
    return best


def clearances(floor: FloorPlan, poses: FloatArray, vehicle: VehicleConfig) -> FloatArray:
    """(N,) the gap at each of poses (N, 3), m; 0 or less where outline and obstacle overlap."""
    corners = outline_corners(poses, vehicle)
    sides_start, sides_end = corners.reshape(-1, 2), np.roll(corners, -1, axis=1).reshape(-1, 2)
    edges, swell = outline_edges(floor)
    apart = segment_distances(sides_start, sides_end, edges[:, 0], edges[:, 1]) - swell
    gap = apart.min(axis=1).reshape(len(poses), 4).min(axis=1)
    # A corner inside an obstacle, or an obstacle wholly inside the outline, crosses no side.
    depth = floor.clearance_m(corners.reshape(-1, 2)).reshape(len(poses), 4).min(axis=1)
    gap = np.minimum(gap, depth)
    inside = _inside(poses, edges[:, 0], vehicle)
    return np.where(inside, np.minimum(gap, 0.0), gap)


def outline_corners(poses: FloatArray, vehicle: VehicleConfig) -> FloatArray:
    """(N, 4, 2) corners in map, counter-clockwise, of the rectangle centred on base_link."""
    local = (
        0.5
        * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        * [
            vehicle.length_m,
            vehicle.width_m,
        ]
    )
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x = poses[:, 0, None] + cos * local[:, 0] - sin * local[:, 1]
    y = poses[:, 1, None] + sin * local[:, 0] + cos * local[:, 1]
    return np.stack([x, y], axis=-1)


def _inside(poses: FloatArray, points: FloatArray, vehicle: VehicleConfig) -> FloatArray:
    """(N,) whether any of points (M, 2) lies within the outline at each pose."""
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    dx, dy = points[:, 0] - poses[:, 0, None], points[:, 1] - poses[:, 1, None]
    ahead, aside = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    return np.any((ahead <= 0.5 * vehicle.length_m) & (aside <= 0.5 * vehicle.width_m), axis=1)
