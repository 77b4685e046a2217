"""A robot of mere kinematics and a room of line segments, for tests of what stops in time.

It has what a real one has against it: its commands take effect late, it brakes no harder than the
monitor takes it to, and it sees by rays, ten times a second.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from helpers.tracking import DRIVE, VEHICLE, allowed, monitor_of

HALF = np.array([0.5 * VEHICLE.length_m, 0.5 * VEHICLE.width_m])
PERIOD_S, SCAN_TICKS = 0.01, 10
RAYS = np.radians(np.arange(360.0))


def in_frame(pose, points):
    """(n, 2) points of the map, in the frame ``pose`` (3,)."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def gaps(pose, points):
    """(n,) signed distances, m, of points (n, 2) from the footprint at ``pose`` (3,)."""
    over = np.abs(in_frame(pose, points)) - HALF
    return np.hypot(*np.maximum(over, 0.0).T) + np.minimum(over.max(axis=1), 0.0)


def at_arc(ahead, turned):
    """Pose (3,) after an arc of ``ahead`` m and ``turned`` rad from the origin."""
    if abs(turned) < 1e-9:
        return np.array([ahead, 0.0, turned])
    radius = ahead / turned
    return np.array([radius * math.sin(turned), radius * (1.0 - math.cos(turned)), turned])


def box(x, y, yaw, length, width):
    """(4, 2, 2) segments of a box about (x, y)."""
    corners = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (length, width)
    cos, sin = math.cos(yaw), math.sin(yaw)
    corners = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def samples(segments, spacing=0.002):
    """(n, 2) points on segments (k, 2, 2), no further apart than ``spacing`` m."""
    return np.concatenate(
        [np.linspace(a, b, 2 + math.ceil(math.dist(a, b) / spacing)) for a, b in segments]
    )


def scan(pose, segments, noise_m, rng):
    """(n, 2) in base_link: where 360 rays from ``pose`` (3,) meet segments (k, 2, 2)."""
    bearing = RAYS + pose[2]
    ray = np.column_stack((np.cos(bearing), np.sin(bearing)))[:, None]
    a, along = segments[:, 0] - pose[:2], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        det = ray[..., 0] * along[:, 1] - ray[..., 1] * along[:, 0]
        reach = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]) / det
        part = (a[:, 0] * ray[..., 1] - a[:, 1] * ray[..., 0]) / det
        reach = np.where((part >= 0.0) & (part <= 1.0) & (reach > 0.0), reach, np.inf)
    ranges = reach.min(axis=1)
    seen = ranges < 12.0
    ranges = ranges[seen] + rng.normal(0.0, noise_m, seen.sum())
    return ranges[:, None] * np.column_stack((np.cos(RAYS[seen]), np.sin(RAYS[seen])))


def drive_blindly(segments, speed, rate, seconds=4.0, noise_m=0.0, late=5, seed=0, allow=allowed):
    """Ask for one velocity whatever comes; the least gap, m, and the last speeds, (2,).

    late: periods until a command takes effect. It speeds up at once, and slows down only as fast
    as the monitor takes it to.
    """
    monitor, rng = monitor_of(), np.random.default_rng(seed)
    surface, pose, moves = samples(segments), np.zeros(3), np.zeros(2)
    queue = deque([np.zeros(2)] * late, late + 1)
    slowest = PERIOD_S * np.array([DRIVE.max_decel_mps2, DRIVE.max_yaw_accel_radps2])
    least = gaps(pose, surface).min()
    for tick in range(round(seconds / PERIOD_S)):
        if tick % SCAN_TICKS == 0:
            monitor.observe(scan(pose, segments, noise_m, rng), pose)
        queue.append(np.array(allow(monitor, speed, rate, pose)))
        brake = min(1.0, *(slowest / np.maximum(np.abs(moves), 1e-9)))
        moves = _towards(moves, queue.popleft(), brake)
        middle = pose[2] + 0.5 * PERIOD_S * moves[1]
        pose = pose + PERIOD_S * np.array(
            [moves[0] * math.cos(middle), moves[0] * math.sin(middle), moves[1]]
        )
        least = min(least, gaps(pose, surface).min())
    return least, moves


def _towards(moves, asked, brake):
    """The velocity (2,) a period on: as asked, but never slower than braking can make it."""
    size = np.linalg.norm(asked) / max(np.linalg.norm(moves), 1e-9)
    return asked if size >= 1.0 else moves * max(size, 1.0 - brake)
