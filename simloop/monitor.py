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

_STEP_M = 0.02
_STEP_RAD = 0.04


@njit(cache=True)
def rectangle_distance(x: float, y: float, half_length: float, half_width: float) -> float:
    """Signed distance, m, from the point (x, y) to a rectangle about the origin; < 0 inside."""
    dx, dy = abs(x) - half_length, abs(y) - half_width
    return math.hypot(max(dx, 0.0), max(dy, 0.0)) + min(max(dx, dy), 0.0)


@njit(cache=True)
def points_in(pose: FloatArray, seen_from: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2) points given in the frame ``seen_from`` (3,), expressed in the frame ``pose`` (3,)."""
    out = np.empty_like(points)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = seen_from[0] - pose[0], seen_from[1] - pose[1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    cos, sin = math.cos(seen_from[2] - pose[2]), math.sin(seen_from[2] - pose[2])
    for i in range(points.shape[0]):
        out[i, 0] = x + cos * points[i, 0] - sin * points[i, 1]
        out[i, 1] = y + sin * points[i, 0] + cos * points[i, 1]
    return out


@njit(cache=True)
def free_fraction(
    points: FloatArray,
    ahead: float,
    turned: float,
    half_length: float,
    half_width: float,
    margin: float,
) -> float:
    """How much of a motion is free, 0 to 1, before the footprint comes within ``margin`` of a point.

    points: (n, 2) in base_link now. The motion is an arc, ``ahead`` m long and ``turned`` rad
    round. A point that is within the margin already hinders only what brings it nearer.
    """
    steps = math.ceil(max(abs(ahead) / _STEP_M, abs(turned) / _STEP_RAD))
    reach = math.hypot(half_length, half_width) + margin + abs(ahead)
    for step in range(1, steps + 1):
        f = step / steps
        yaw = f * turned
        if abs(turned) > 1e-9:
            cx, cy = ahead / turned * math.sin(yaw), ahead / turned * (1.0 - math.cos(yaw))
        else:
            cx, cy = f * ahead, 0.0
        cos, sin = math.cos(yaw), math.sin(yaw)
        for i in range(points.shape[0]):
            px, py = points[i, 0], points[i, 1]
            if px * px + py * py > reach * reach:
                continue
            dx, dy = px - cx, py - cy
            there = rectangle_distance(
                cos * dx + sin * dy, cos * dy - sin * dx, half_length, half_width
            )
            if there < margin and there < rectangle_distance(px, py, half_length, half_width) - 1e-6:
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
        points = points_in(pose, self._pose, self._points)
        free = free_fraction(
            points, speed * horizon, yaw_rate * horizon, *self._half, config.monitor_margin_m
        )
        # Distance to stop grows at most with the square of the speed: a free part f allows f.
        return (speed, yaw_rate) if free >= 1.0 else (speed * free, yaw_rate * free)
