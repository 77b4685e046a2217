"""Views, plans and smooth paths for tests."""

from __future__ import annotations

import numpy as np

from simloop.config import SmootherConfig, VehicleConfig
from simloop.messages import Plan, WorldView
from simloop.navigation.bezier_smoother import Smoother

VEHICLE, SAFE = VehicleConfig(), 0.26


def view_of(discs=(), size=6.0, resolution=0.05):
    """A view whose field is the exact distance to discs (x, y, r)."""
    n = round(size / resolution)
    centres = -size / 2 + resolution * (np.arange(n) + 0.5)
    x, y = np.meshgrid(centres, centres)
    distance = np.full((n, n), 10.0)
    for cx, cy, r in discs:
        distance = np.minimum(distance, np.maximum(0.0, np.hypot(x - cx, y - cy) - r))
    origin = np.array([-size / 2, -size / 2])
    bounds = np.array([-size / 2, -size / 2, size / 2, size / 2])
    return WorldView(0, origin, resolution, distance.astype(np.float32), np.zeros((0, 3)), bounds)


def plan_of(points):
    return Plan(0, np.array(points, float), 0.0, 0.0, 0.0, True, 0, 0, "test", safe_distance_m=SAFE)


def smooth(points, pose, view=None):
    smoother = Smoother(SmootherConfig(), VEHICLE)
    return smoother.smooth(plan_of(points), view or view_of(), np.array(pose, float))
