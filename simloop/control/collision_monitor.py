"""The collision monitor: from its present speed the robot stops before what it has just seen.

It looks at the last few scans alone, not at the map or the plan: points in base_link, carried
along by the estimate's motion since. The motion that a command would bring, and the braking
after it, is an arc; the footprint's rectangle is swept along it among the points.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numba import njit

from simloop.config import TrackerConfig, VehicleConfig
from simloop.geometry.footprint import (
    free_fraction,
    near_points,
    nearer_than,
    points_in,
    room_after,
)
from simloop.messages import FloatArray

_LEAST_PART = 0.1  # less than this of a velocity is not worth creeping with
_SCANS = 3
_WINDOW = 4  # points on either side that a point is averaged with
_ONE_SURFACE_M = 0.05
_LOOKS = 4  # places on an arc at which room is looked for
_BETWEEN_SCANS_M = 0.2  # how far the robot may at least come before the next scan, and some
_SCANS_MISSED = 4  # after as many without a scan it stands, whatever else


@njit(cache=True)
def steadied(points: FloatArray, window: int, apart: float) -> FloatArray:
    """(n, 2) points, ordered by bearing, each averaged with its neighbours on one surface.

    A ray's noise, as large as the margin, would else stop the robot again and again beside what
    it can pass. Neighbours count in pairs, one from either side, as far as both lie within
    ``apart`` m of the point: along a flat surface that moves no point but across it, and a thin
    post or an edge stays where it is.
    """
    n = points.shape[0]
    out = points.copy()
    for i in range(n):
        sum_x, sum_y, count = points[i, 0], points[i, 1], 1
        for k in range(1, min(window, (n - 1) // 2) + 1):
            a, b = (i - k) % n, (i + k) % n
            if (
                math.hypot(points[a, 0] - points[i, 0], points[a, 1] - points[i, 1]) > apart
                or math.hypot(points[b, 0] - points[i, 0], points[b, 1] - points[i, 1]) > apart
            ):
                break
            sum_x += points[a, 0] + points[b, 0]
            sum_y += points[a, 1] + points[b, 1]
            count += 2
        out[i, 0], out[i, 1] = sum_x / count, sum_y / count
    return out


@njit(cache=True)
def steadied_around(pose: FloatArray, points: FloatArray, window: int, apart: float) -> FloatArray:
    """(n, 2) in the frame ``pose`` (3,), of points (n, 2) in map: by bearing, and steadied."""
    near, bearing = points_in(pose, np.zeros(3), points), np.empty(points.shape[0])
    for i in range(near.shape[0]):
        bearing[i] = math.atan2(near[i, 1], near[i, 0])
    return steadied(near[np.argsort(bearing, kind="mergesort")], window, apart)


@njit(cache=True)
def allowed_part(
    points: FloatArray,
    seen_from: FloatArray,
    pose: FloatArray,
    speed: float,
    yaw_rate: float,
    limits: FloatArray,
) -> float:
    """The part, 0 to 1, of a velocity from which the robot can be stopped in time.

    points: (n, 2) in the frame ``seen_from`` (3,); pose: (3,) of base_link now, both in map.
    limits: (6,) reaction time, s, deceleration, m/s^2, yaw deceleration, rad/s^2, half the
    footprint's length and width, and the margin, m. A part f of the velocity goes on for the
    reaction time t and then brakes for f T: it goes f t + f^2 T / 2 of what a second brings.
    """
    reaction, brake, yaw_brake, half_length, half_width, margin = limits
    braking = max(abs(speed) / brake, abs(yaw_rate) / yaw_brake)
    horizon = reaction + 0.5 * braking
    ahead, turned = speed * horizon, yaw_rate * horizon
    # No part of the footprint gets farther than this from where it is now.
    reach = abs(ahead) + math.hypot(half_length, half_width) + margin
    near = nearer_than(points_in(pose, seen_from, points), reach)
    free = horizon * free_fraction(near, ahead, turned, half_length, half_width, margin)
    if free >= horizon:
        return 1.0
    part = (math.sqrt(reaction**2 + 2.0 * braking * free) - reaction) / max(braking, 1e-9)
    return part if part > _LEAST_PART else 0.0


def stopping_limits(
    config: TrackerConfig, vehicle: VehicleConfig, brake_mps2: float, margin_m: float
) -> FloatArray:
    """(6,) what a stop needs: the ``limits`` of ``allowed_part``."""
    return np.array(
        [
            config.monitor_reaction_s,
            brake_mps2,
            config.max_yaw_accel_radps2,
            0.5 * vehicle.length_m,
            0.5 * vehicle.width_m,
            margin_m,
        ]
    )


class CollisionMonitor:
    """Scales a body velocity down to what the last scans allow."""

    def __init__(self, config: TrackerConfig, vehicle: VehicleConfig, scan_s: float = 0.1) -> None:
        """scan_s: time, s, from one scan to the next."""
        self._limits = stopping_limits(
            config, vehicle, config.max_decel_mps2, config.monitor_margin_m
        )
        reach = math.hypot(vehicle.length_m, vehicle.width_m) / 2.0 + config.monitor_margin_m
        top = config.max_speed_mps
        braking = max(
            top / config.max_decel_mps2, config.max_yaw_rate_radps / config.max_yaw_accel_radps2
        )
        stop = top * (config.monitor_reaction_s + braking)
        self._near_m = reach + stop + max(_BETWEEN_SCANS_M, _SCANS_MISSED * scan_s * top)
        self._scans: deque[FloatArray] = deque(maxlen=_SCANS)  # points in map
        self._points = np.empty((0, 2))
        self._pose = np.zeros(3)

    def observe(
        self, points_m: FloatArray, pose: FloatArray, standing_m: FloatArray | None = None
    ) -> None:
        """Take a scan: points (n, 2) in base_link, seen from ``pose`` (3,) in map.

        standing_m: (k, 2) in map, what scans do not show and stands there nevertheless.
        """
        self._pose = pose = np.array(pose, np.float64)
        self._scans.append(near_points(np.ascontiguousarray(points_m), pose, self._near_m))
        merged = np.concatenate(self._scans)
        self._points = steadied_around(pose, merged, _WINDOW, _ONE_SURFACE_M)
        if standing_m is not None and len(standing_m):
            near = standing_m[np.hypot(*(standing_m - pose[:2]).T) < self._near_m]
            self._points = np.concatenate((self._points, points_in(pose, np.zeros(3), near)))

    def forget(self) -> None:
        """Take it that nothing has been seen: the robot stands elsewhere than was thought."""
        self._scans.clear()
        self._points = np.empty((0, 2))

    def allow(self, speed: float, yaw_rate: float, pose: FloatArray) -> tuple[float, float]:
        """The part of a velocity (m/s, rad/s) that can be stopped in time at ``pose`` (3,)."""
        if self._points.shape[0] == 0 or (speed == 0.0 and yaw_rate == 0.0):
            return speed, yaw_rate
        part = allowed_part(self._points, self._pose, pose, speed, yaw_rate, self._limits)
        return (speed, yaw_rate) if part >= 1.0 else (speed * part, yaw_rate * part)

    def can_turn(self, turned: float, pose: FloatArray, extra_m: float = 0.0) -> bool:
        """Whether a turn on the spot by ``turned`` rad at ``pose`` (3,) keeps the margin and some,
        ``extra_m``, from all that was seen."""
        half_length, half_width, margin = self._limits[3:].tolist()
        near = points_in(pose, self._pose, self._points)
        free = free_fraction(near, 0.0, turned, half_length, half_width, margin + extra_m)
        return free >= 1.0

    def look_along(self, ahead: float, turned: float, pose: FloatArray) -> tuple[float, float]:
        """How much of an arc from ``pose`` (3,) is free, 0 to 1, and the most room, m, on the way.

        The arc is ``ahead`` m long and ``turned`` rad round; room counts to the nearest point.
        Where the free part ends at something there is no room left: what counts is where there was.
        """
        half_length, half_width, margin = self._limits[3:].tolist()
        near = points_in(pose, self._pose, self._points)
        free = free_fraction(near, ahead, turned, half_length, half_width, margin)
        parts = (free * k / _LOOKS for k in range(_LOOKS + 1))
        room = max(room_after(near, f * ahead, f * turned, half_length, half_width) for f in parts)
        return free, room
