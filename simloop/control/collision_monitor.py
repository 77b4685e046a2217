"""The collision monitor: what the last scans show near the robot, and what can be stopped in time.

It uses the last few scans alone, not the map or the plan. Their points are kept in map and carried
to the robot's present pose by the estimate. The motion that a velocity brings, and the braking
after it, is an arc; the rectangular footprint is swept along it among the points.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numba import njit

from simloop.config import DriveConfig, MonitorConfig, VehicleConfig
from simloop.geometry.footprint import (
    free_fraction,
    near_points,
    points_in,
    room_after,
)
from simloop.messages import FloatArray

_LEAST_PART = 0.1  # less than this part of a velocity is not worth creeping with
_WINDOW = 4  # points on either side that a point is averaged with
_ONE_SURFACE_M = 0.05  # neighbours this near lie on one surface
_ONE_PLACE_M = 0.012  # scans from places this near to each other show the same points
_UNSURE_M = 0.02  # two standard deviations of one range
_LOOKS = 4  # places on an arc, besides its start, at which room is measured
_BETWEEN_SCANS_M = 0.2  # distance that the robot may travel before the next scan, at least
_SCANS_MISSED = 4  # after so many missing scans the robot stands in any case
_ORIGIN = np.zeros(3)
_ORIGIN.setflags(write=False)


@njit(cache=True)
def average_along_surfaces(
    points: FloatArray, window: int, apart: float, unsure: float = 0.0
) -> FloatArray:
    """Average each point with its neighbours on the same surface, against range noise.

    The noise of a single ray is as large as the monitor's margin. Without averaging it would stop
    the robot again and again beside what it can pass. Neighbours count in pairs, one from either
    side, as long as both lie within ``apart`` of the point: a flat surface keeps its place, and a
    thin post or an edge is not moved.

    Args:
        points: (n, 2) points ordered by bearing, m.
        window: Neighbours on either side that count at most.
        apart: Largest distance of a neighbour, m.
        unsure: How much nearer a point may be than it is read, m, if it has no neighbours. Points
            with less than the whole window are moved nearer, by what that is more than with it.

    Returns:
        (n, 2) averaged points, m, in the same frame and order.
    """
    n = points.shape[0]
    out = points.copy()
    for i in range(n):
        sum_x, sum_y, count = points[i, 0], points[i, 1], 1
        for k in range(1, min(window, (n - 1) // 2) + 1):
            a, b = (i - k) % n, (i + k) % n
            # One neighbour off the surface ends the window on both sides.
            if (
                math.hypot(points[a, 0] - points[i, 0], points[a, 1] - points[i, 1]) > apart
                or math.hypot(points[b, 0] - points[i, 0], points[b, 1] - points[i, 1]) > apart
            ):
                break
            sum_x += points[a, 0] + points[b, 0]
            sum_y += points[a, 1] + points[b, 1]
            count += 2
        out[i, 0], out[i, 1] = sum_x / count, sum_y / count
        full = 2 * window + 1
        if unsure > 0.0 and count < full:
            nearer = unsure * (1.0 / math.sqrt(count) - 1.0 / math.sqrt(full))
            out[i] *= max(0.0, 1.0 - nearer / max(math.hypot(out[i, 0], out[i, 1]), 1e-9))
    return out


@njit(cache=True)
def _steadied_around(
    pose: FloatArray, points: FloatArray, window: int, apart: float, unsure: float
) -> FloatArray:
    """(n, 2) in the frame ``pose`` (3,), of points (n, 2) in map: by bearing, and averaged."""
    near, bearing = points_in(pose, np.zeros(3), points), np.empty(points.shape[0])
    for i in range(near.shape[0]):
        bearing[i] = math.atan2(near[i, 1], near[i, 0])
    order = np.argsort(bearing, kind="mergesort")
    return average_along_surfaces(near[order], window, apart, unsure)


@njit(cache=True)
def _within_reach(points: FloatArray, reach: float) -> FloatArray:
    """(k, 2) of the points (n, 2): those no farther than ``reach`` m from the origin."""
    out, k = np.empty_like(points), 0
    for i in range(points.shape[0]):
        if points[i, 0] ** 2 + points[i, 1] ** 2 <= reach * reach:
            out[k] = points[i]
            k += 1
    return out[:k]


@njit(cache=True)
def stoppable_part(points: FloatArray, speed: float, yaw_rate: float, limits: FloatArray) -> float:
    """Find the part of a velocity from which the robot can still be stopped in time.

    A part f of the velocity continues for the reaction time t and then brakes for f T, where T is
    the braking time of the whole velocity: it travels f t + f^2 T / 2 of what a second brings. The
    largest f for which this is free follows from the free part of the full arc.

    Args:
        points: (n, 2) what has been seen, m, in base_link now.
        speed: Forward speed, m/s.
        yaw_rate: Yaw rate, rad/s.
        limits: (6,) reaction time, s, deceleration, m/s^2, yaw deceleration, rad/s^2, half the
            footprint's length and width, m, and the margin, m.

    Returns:
        The part, 0 to 1; 0 where it would be less than a tenth.
    """
    reaction, brake, yaw_brake, half_length, half_width, margin = limits
    braking = max(abs(speed) / brake, abs(yaw_rate) / yaw_brake)
    horizon = reaction + 0.5 * braking
    ahead, turned = speed * horizon, yaw_rate * horizon
    # No part of the footprint gets farther than this from where it is now.
    reach = abs(ahead) + math.hypot(half_length, half_width) + margin
    near = _within_reach(points, reach)
    free = horizon * free_fraction(near, ahead, turned, half_length, half_width, margin)
    if free >= horizon:
        return 1.0
    part = (math.sqrt(reaction**2 + 2.0 * braking * free) - reaction) / max(braking, 1e-9)
    return part if part > _LEAST_PART else 0.0


@njit(cache=True)
def examine_arc(
    points: FloatArray, ahead: float, turned: float, limits: FloatArray
) -> tuple[float, float]:
    """Measure how much of an arc is free, and the most room on its free part.

    Args:
        points: (n, 2) what has been seen, m, in base_link now.
        ahead: Length of the arc, m; negative backwards.
        turned: Yaw gained along the arc, rad.
        limits: (6,) as in `stoppable_part`.

    Returns:
        The free part, 0 to 1, and the most room, m, from the footprint to the nearest point at the
        arc's start or at one of four places on its free part. There is no room left where the free
        part ends, so the most counts.
    """
    half_length, half_width, margin = limits[3], limits[4], limits[5]
    free = free_fraction(points, ahead, turned, half_length, half_width, margin)
    room = -np.inf
    for k in range(_LOOKS + 1):
        f = free * k / _LOOKS
        room = max(room, room_after(points, f * ahead, f * turned, half_length, half_width))
    return free, room


def stopping_limits(
    monitor: MonitorConfig, drive: DriveConfig, vehicle: VehicleConfig
) -> FloatArray:
    """Collect what a stop needs, as the kernels take it.

    Args:
        monitor: Margin and reaction time.
        drive: Decelerations.
        vehicle: The footprint.

    Returns:
        (6,) the ``limits`` of `stoppable_part`.
    """
    return np.array(
        [
            monitor.reaction_s,
            drive.max_decel_mps2,
            drive.max_yaw_accel_radps2,
            0.5 * vehicle.length_m,
            0.5 * vehicle.width_m,
            monitor.margin_m,
        ]
    )


def _speed_within(range_m: float, limits: FloatArray) -> float:
    """The largest speed, m/s, from which the robot stops within ``range_m``; ``limits`` (6,)."""
    reaction, brake, _, half_length, half_width, margin = limits.tolist()
    room = range_m - math.hypot(half_length, half_width) - margin
    if room <= 0.0:
        return 0.0
    return float(math.sqrt((brake * reaction) ** 2 + 2.0 * brake * room) - brake * reaction)


class CollisionMonitor:
    """Remembers the points of the last scans that lie near the robot.

    Attributes:
        limits: (6,) as in `stoppable_part`.
        speed_cap_mps: The largest speed, m/s, from which the robot stops within its LiDAR's range.
    """

    def __init__(
        self,
        config: MonitorConfig,
        drive: DriveConfig,
        vehicle: VehicleConfig,
        scan_s: float = 0.1,
    ) -> None:
        """scan_s: time from one scan to the next, s."""
        self.limits = stopping_limits(config, drive, vehicle)
        reach = math.hypot(vehicle.length_m, vehicle.width_m) / 2.0 + config.margin_m
        top = drive.max_speed_mps
        braking = max(
            top / drive.max_decel_mps2, drive.max_yaw_rate_radps / drive.max_yaw_accel_radps2
        )
        stop = top * (config.reaction_s + braking)
        self._near_m = reach + stop + max(_BETWEEN_SCANS_M, _SCANS_MISSED * scan_s * top)
        self._scans: deque[FloatArray] = deque(maxlen=config.scans)  # points in map
        self._points = np.empty((0, 2))
        self._poses: deque[FloatArray] = deque(maxlen=config.scans)
        self._pose = np.zeros(3)
        self.speed_cap_mps = math.inf

    def observe(
        self,
        points_m: FloatArray,
        pose: FloatArray,
        standing_m: FloatArray | None = None,
        range_m: float = math.inf,
    ) -> None:
        """Take a scan.

        Args:
            points_m: (n, 2) its points, m, in base_link.
            pose: (3,) of base_link in map when the scan ended, m, m, rad.
            standing_m: (k, 2) in map, m: what stands there although no scan shows it.
            range_m: Greatest range of the sensor, m: what is farther away is not known.
        """
        self.speed_cap_mps = _speed_within(range_m, self.limits)
        self._pose = pose = np.array(pose, np.float64)
        self._scans.append(near_points(np.ascontiguousarray(points_m), pose, self._near_m))
        self._poses.append(pose)
        merged = np.concatenate(self._scans)
        # A robot that hardly moves sees the same few points of a corner again and again. Each new
        # draw of their noise would let it creep on, if one in twenty were far enough.
        moved_m = math.dist(pose[:2], self._poses[0][:2])
        unsure = _UNSURE_M if moved_m < _ONE_PLACE_M else 0.0
        self._points = _steadied_around(pose, merged, _WINDOW, _ONE_SURFACE_M, unsure)
        if standing_m is not None and len(standing_m):
            near = standing_m[np.hypot(*(standing_m - pose[:2]).T) < self._near_m]
            self._points = np.concatenate((self._points, points_in(pose, _ORIGIN, near)))

    def forget(self) -> None:
        """Drop all points: the robot stands elsewhere than was believed."""
        self._scans.clear()
        self._poses.clear()
        self._points = np.empty((0, 2))

    def points_at(self, pose: FloatArray) -> FloatArray:
        """Express what has been seen in the robot's present frame.

        Args:
            pose: (3,) of base_link in map now, m, m, rad.

        Returns:
            (n, 2) points in base_link, m.
        """
        return points_in(pose, self._pose, self._points)

    def can_turn(self, turned: float, pose: FloatArray, extra_m: float = 0.0) -> bool:
        """Say whether a turn on the spot keeps the margin from all that was seen.

        Args:
            turned: The turn, rad.
            pose: (3,) of base_link in map now, m, m, rad.
            extra_m: Distance to keep beyond the margin, m.

        Returns:
            True if the whole turn is free.
        """
        half_length, half_width, margin = self.limits[3:].tolist()
        near = self.points_at(pose)
        return free_fraction(near, 0.0, turned, half_length, half_width, margin + extra_m) >= 1.0
