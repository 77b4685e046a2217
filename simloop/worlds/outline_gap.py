"""Compute the gap between the robot's outline, a rectangle, and the obstacles."""

from __future__ import annotations

import numpy as np

from simloop.geometry.outline_distance import within_reach
from simloop.messages import FloatArray
from simloop.worlds.body import Outline
from simloop.worlds.floor_plan import FloorPlan, outline_edges, segment_distances

_BATCH = 64


def least_clearance(floor: FloorPlan, poses: FloatArray, outline: Outline) -> float:
    """Compute the least gap between the outline and the floor plan's obstacles over many poses.

    It is exact for a rectangle and convex outlines.

    Args:
        floor: the floor plan.
        poses: (N, 3) x, y, yaw of base_link in map, m, m, rad.
        outline: the rectangle.

    Returns:
        The gap, m; 0 or less where they overlap; inf without obstacles or poses.
    """
    if not floor.sections or not len(poses):
        return float("inf")
    # The gap is at least the centre's clearance less the half diagonal. The poses are searched in
    # the order of this bound, and the search ends where the bound exceeds the best gap so far.
    reach = 0.5 * float(np.hypot(outline.length_m, outline.width_m))
    lower = floor.clearance_m(poses[:, :2]) - reach
    order = np.argsort(lower, kind="stable")
    best = float("inf")
    for first in range(0, len(order), _BATCH):
        batch = order[first : first + _BATCH]
        if lower[batch[0]] >= best:
            break
        best = min(best, float(clearances(floor, poses[batch], outline).min()))
    return best


def clearances(floor: FloorPlan, poses: FloatArray, outline: Outline) -> FloatArray:
    """Compute the gap between the outline and the nearest obstacle, at each pose.

    Args:
        floor: the floor plan.
        poses: (N, 3) x, y, yaw of base_link in map, m, m, rad.
        outline: the rectangle.

    Returns:
        (N,) gaps, m; 0 or less where outline and obstacle overlap.
    """
    corners = outline_corners(poses, outline)
    # First, the distances between all sides of the rectangle and all edges of the obstacles.
    sides_start, sides_end = corners.reshape(-1, 2), np.roll(corners, -1, axis=1).reshape(-1, 2)
    # The centre is inside the rectangle. So what is farther from it than the nearest obstacle by
    # more than the half diagonal is farther from the rectangle, too.
    reach = 0.5 * float(np.hypot(outline.length_m, outline.width_m))
    near = np.flatnonzero(within_reach(poses[:, :2], reach, floor.outlines)).tolist()
    edges, swell = outline_edges([floor.sections[s] for s in near])
    apart = segment_distances(sides_start, sides_end, edges[:, 0], edges[:, 1]) - swell
    gap = apart.min(axis=1).reshape(len(poses), 4).min(axis=1)
    # Sides do not cross if a corner is inside an obstacle or an obstacle inside the outline.
    depth = floor.clearance_m(corners.reshape(-1, 2)).reshape(len(poses), 4).min(axis=1)
    gap = np.minimum(gap, depth)
    inside = _inside(poses, edges[:, 0], outline)
    return np.where(inside, np.minimum(gap, 0.0), gap)


def outline_corners(poses: FloatArray, outline: Outline) -> FloatArray:
    """Compute the corners of the outline at each pose.

    Args:
        poses: (N, 3) x, y, yaw of base_link in map, m, m, rad.
        outline: the rectangle, centred on base_link.

    Returns:
        (N, 4, 2) corners in map, m, counter-clockwise from the front left.
    """
    size = [outline.length_m, outline.width_m]
    local = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * size
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x = poses[:, 0, None] + cos * local[:, 0] - sin * local[:, 1]
    y = poses[:, 1, None] + sin * local[:, 0] + cos * local[:, 1]
    return np.stack([x, y], axis=-1)


def _inside(poses: FloatArray, points: FloatArray, outline: Outline) -> FloatArray:
    """Tell at each pose (N,) whether any of points (M, 2) is within the outline."""
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    dx, dy = points[:, 0] - poses[:, 0, None], points[:, 1] - poses[:, 1, None]
    ahead, aside = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    return np.any((ahead <= 0.5 * outline.length_m) & (aside <= 0.5 * outline.width_m), axis=1)
