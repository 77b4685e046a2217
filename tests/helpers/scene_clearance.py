"""Clearance by dense sampling: the slow, obvious twin of the benchmark's judge."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from simloop.benchmarks.planners.scenes import Instance, true_clearance
from simloop.messages import FloatArray


def scene_clearance(instance: Instance, waypoints: FloatArray, step_m: float) -> float:
    """`true_clearance`, polygons included, by samples ``step_m`` apart; 0 inside a polygon."""
    worst = true_clearance(instance, waypoints, step_m)
    for a, b in pairwise(waypoints):
        count = 2 + int(np.hypot(*(b - a)) / step_m)
        points = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        for polygon in instance.world.polygons_m:
            worst = min(worst, float(_polygon_distance(np.asarray(polygon), points).min()))
    return worst


def _polygon_distance(polygon: FloatArray, points: FloatArray) -> FloatArray:
    """Distance of points (N, 2) from a convex polygon (C, 2), counter-clockwise; 0 inside."""
    least, inside = np.full(len(points), np.inf), np.ones(len(points), dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        edge, off = b - a, points - a
        inside &= edge[0] * off[:, 1] - edge[1] * off[:, 0] >= 0.0
        t = np.clip(off @ edge / (edge @ edge), 0.0, 1.0)
        least = np.minimum(least, np.hypot(*(off - t[:, None] * edge).T))
    return np.where(inside, 0.0, least)
