"""The collision monitor: from its present speed the robot stops before what it has just seen.

It looks at the last scan alone, not at the map or the plan: points in base_link, carried
along by the estimate's motion since. The motion that a command would bring, and the braking
after it, is an arc; the footprint's rectangle is swept along it among the points.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import TrackerConfig, VehicleConfig
from simloop.messages import FloatArray
from simloop.se2 import compose, inverse

_STEP_M = 0.02
_STEP_RAD = 0.04


@njit(cache=True)
def rectangle_distance(x: float, y: float, half_length: float, half_width: float) -> float:
    """Signed distance, m, from the point (x, y) to a rectangle about the origin; < 0 inside."""
    dx, dy = abs(x) - half_length, abs(y) - half_width
    return math.hypot(max(dx, 0.0), max(dy, 0.0)) + min(max(dx, dy), 0.0)


@njit(cache=True)
def free_fraction(
    points: FloatArray, move: FloatArray, half_length: float, half_width: float, margin: float
) -> float:
    """How much of a motion is free, 0 to 1, before the footprint comes within ``margin`` of a point.

    points: (n, 2) in base_link now. move: (2,) m ahead and rad turned, along an arc. A point
    that is within the margin already hinders only a motion that brings it nearer.
    """
    ahead, turned = move[0], move[1]
    steps = math.ceil(max(abs(ahead) / _STEP_M, abs(turned) / _STEP_RAD))
    for step in range(1, steps + 1):
        f = step / steps
        yaw = f * turned
        if abs(turned) > 1e-9:
            cx, cy = ahead / turned * math.sin(yaw), ahead / turned * (1.0 - math.cos(yaw))
        else:
            cx, cy = f * ahead, 0.0
        cos, sin = math.cos(yaw), math.sin(yaw)
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - cx, points[i, 1] - cy
            there = rectangle_distance(
                cos * dx + sin * dy, cos * dy - sin * dx, half_length, half_width
            )
            if there < margin:
                here = rectangle_distance(points[i, 0], points[i, 1], half_length, half_width)
                if there < here - 1e-6:
                    return (step - 1) / steps
    return 1.0


class CollisionMonitor:
    """Scales a body velocity down to what the last scan allows."""

    def __init__(self, config: TrackerConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._half = (0.5 * vehicle.length_m, 0.5 * vehicle.width_m)
        self._points = np.empty((0, 2))
        self._pose = np.zeros(3)

    def observe(self, points_m: FloatArray, pose: FloatArray) -> None:
        """Take a scan: points (n, 2) in base_link, seen from ``pose`` (3,) in map."""
        near = np.abs(points_m).max(axis=1, initial=0.0) < 1.5
        self._points, self._pose = np.ascontiguousarray(points_m[near]), pose.copy()

    def allow(self, speed: float, yaw_rate: float, pose: FloatArray) -> tuple[float, float]:
        """The part of a velocity (m/s, rad/s) that can be stopped in time at ``pose`` (3,)."""
        if self._points.shape[0] == 0 or (speed == 0.0 and yaw_rate == 0.0):
            return speed, yaw_rate
        config = self._config
        braking = abs(speed) / config.max_decel_mps2 + abs(yaw_rate) / config.max_yaw_accel_radps2
        horizon = config.monitor_reaction_s + 0.5 * braking
        x, y, yaw = compose(inverse(pose), self._pose)
        cos, sin = math.cos(yaw), math.sin(yaw)
        points = self._points @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        move = np.array([speed * horizon, yaw_rate * horizon])
        free = free_fraction(points, move, *self._half, config.monitor_margin_m)
        # Distance to stop grows at most with the square of the speed: a free part f allows f.
        return (speed, yaw_rate) if free >= 1.0 else (speed * free, yaw_rate * free)
