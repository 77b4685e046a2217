"""Rooms of straight walls for tests: a scan of one is rays cast among segments."""

from __future__ import annotations

import math

import numpy as np

from simloop.messages import LidarScan

ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)


class Room:
    """Walls as segments (k, 4) x0, y0, x1, y1: a scan is rays cast among them."""

    def __init__(self, *segments):
        self.segments = np.array(segments, float)

    def ranges(self, pose, most=12.0, beams=360):
        angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
        directions = np.stack((np.cos(angles + pose[2]), np.sin(angles + pose[2])), axis=1)
        best = np.full(len(angles), np.inf)
        for x0, y0, x1, y1 in self.segments:
            along = np.array([x1 - x0, y1 - y0])
            to = np.array([x0 - pose[0], y0 - pose[1]])
            det = directions[:, 0] * -along[1] + directions[:, 1] * along[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (to[0] * -along[1] + to[1] * along[0]) / det
                s = (directions[:, 0] * to[1] - directions[:, 1] * to[0]) / det
            best = np.where((t > 0) & (s >= 0) & (s <= 1) & (t < best), t, best)
        return np.where(best <= most, best, np.inf)

    def scan(self, pose, rng=None, t_ns=0):
        ranges = self.ranges(pose)
        if rng is not None:
            ranges = ranges + 0.01 * rng.standard_normal(len(ranges))
        return LidarScan(t_ns, ANGLES, ranges, np.zeros(360, np.int64), 0.15, 12.0)

    def hits(self, pose, rng, noise_m=0.01, angles=ANGLES):
        """(n, 2) points in the sensor's frame."""
        ranges = self.ranges(pose)
        chosen = np.isin(ANGLES, angles) & np.isfinite(ranges)
        far = ranges[chosen] + noise_m * rng.standard_normal(int(chosen.sum()))
        return far[:, None] * np.stack((np.cos(ANGLES[chosen]), np.sin(ANGLES[chosen])), axis=1)


def box(x0, y0, x1, y1):
    """The four sides of a rectangle."""
    return ((x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0))
