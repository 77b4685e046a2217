"""What stands lower than the LiDAR's plane, or hangs above it: seen by a depth camera, remembered.

    image -> what rises steeply from the ground -> but what the scan shows too -> a grid of its own

Each column of an image is a slice through the world, upright and of one bearing. A pixel is in the
robot's way if one below it in its column lies lower, and not much nearer: so ramps, and a pitching
robot, are no obstacles, and a bar that hangs free is one. The nearest such pixel of a column is
kept, and a little of what it hides. What the camera sees no more, as it comes too near, is still
there; it is forgotten only where the whole height of the robot is seen to be free.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import Config, LowObstaclesConfig, SlamConfig
from simloop.geometry.discs import on_discs
from simloop.geometry.se2 import between, transform_points
from simloop.mapping.grid_map import GridMap
from simloop.messages import DepthImage, FloatArray, MoverTracks, pixel_slopes

_EDGE_M = 0.04  # two pixels of a column that are so near one another are of one thing
_NEARER_M = 0.015  # than seen: a corner recedes in the mean of its cell
_DEPTHS_M = tuple(np.arange(0.05, 0.26, 0.05).tolist())
"""What is seen is taken to be so deep, until it is seen that it is not."""
_TRAIL_M, _ASIDE_M, _BACKWARDS_M = 0.05, 0.12, (0.1, 0.2, 0.3, 0.4, 0.5)
_TURN_RAD, _LEAD_IN_RAD = 0.4, 0.3  # well within what the camera sees to either side
_SIGHTINGS = 1.5  # more of them are needed: something that moves is seen once in each place
_FADES = 0.01  # of the odds, with each image in which something moves
_NOT_SO_FAR_M = 0.1  # short of what stands there, no vote for free ground
_SAME_M = 0.03  # from the line between two points of a scan: seen by it too
_TALL_M = 0.15  # the same for what reaches up to the scan, and may have moved since its beams
_ONE_SURFACE_M = 0.3  # farther apart, two points of a scan are not of one surface
_MOVER_M = 0.1  # about what moves


@njit(cache=True)
def _climbs(
    depth: NDArray[np.float32], z: FloatArray, row: int, col: int, step: float, slope: float
) -> bool:
    """Whether a pixel is higher than one below it in its column, and not much farther or nearer."""
    for below in range(row + 1, depth.shape[0]):
        rise = z[row] - z[below]
        if rise >= step and rise >= slope * abs(depth[row, col] - depth[below, col]):
            return True
    return False


@njit(cache=True)
def in_the_way(
    depth: NDArray[np.float32], high: FloatArray, camera_m: float, limits: FloatArray
) -> FloatArray:
    """(cols, 3) for each column the depth, m, of the nearest thing that is in the way, or inf, up
    to which depth there surely is none, and how high, m, the nearest thing is seen to reach.

    depth: (rows, cols); high: (rows,) how much a row's rays rise for one of depth, top row first;
    camera_m: the camera over the ground. limits: (4,) least step, m, slope, most height, m, reach,
    m. The slope is that of a column straight ahead; it is less steep to the sides.

    A thing whose foot lies anywhere between two rows' ends that are far apart is left for a nearer
    look. One that begins above the height, with the next ray below passing under it, may hang
    down between these two rays, and counts.
    """
    step, slope, height, reach = limits
    rows, cols = depth.shape
    found, z = np.zeros((cols, 3)), np.empty(rows)
    for col in range(cols):
        nearest, ground, free = np.inf, 0.0, np.inf
        before = 0.0  # depth of the next valid pixel below
        for row in range(rows - 1, -1, -1):
            far = float(depth[row, col])
            z[row] = camera_m + high[row] * far if far < np.inf else np.nan
            if not far < np.inf:
                continue
            if z[row] < step:
                ground = max(ground, far)
            elif far <= reach and (far < nearest or before < free):
                under = row + 1 < rows and before > far
                hangs = under and camera_m + high[row + 1] * far < height <= z[row]
                if hangs or (z[row] <= height and _climbs(depth, z, row, col, step, slope)):
                    free = min(free, before, far)
                    if far - before < _EDGE_M:
                        nearest = min(nearest, far)
            before = far
        found[col, 0], found[col, 1] = nearest, min(ground, free)
        for row in range(rows):
            if abs(depth[row, col] - nearest) < _EDGE_M:
                found[col, 2] = max(found[col, 2], z[row])
    return found


@njit(cache=True)
def seen_too(
    points: FloatArray, scan: FloatArray, same: FloatArray, apart: float
) -> NDArray[np.bool_]:
    """(n,) which points (n, 2) lie within ``same`` (n,), m, of a line from one of a scan (m, 2),
    in order of bearing, to the next, where these are no more than ``apart`` m from one another."""
    out = np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        for k in range(scan.shape[0]):
            ax, ay = scan[k - 1, 0], scan[k - 1, 1]
            dx, dy = scan[k, 0] - ax, scan[k, 1] - ay
            px, py = points[i, 0] - ax, points[i, 1] - ay
            square = dx * dx + dy * dy
            if square > apart * apart:
                dx, dy, square = 0.0, 0.0, 0.0
            f = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square > 0.0 else 0.0
            if math.hypot(px - f * dx, py - f * dy) < same[i]:
                out[i] = True
                break
    return out


class LowObstacleMap:
    """Remembers in map; base_from_camera: (3,) in base_link, m, where it looks along x, level.

    ``surfaces_m`` (k, 2) holds, in map, all that is remembered; ``seen_m`` (m, 2) that part of it
    which was seen, without the depth that it is guessed to have.
    """

    def __init__(
        self, config: LowObstaclesConfig, slam: SlamConfig, base_from_camera: FloatArray
    ) -> None:
        self._config = config
        sure = replace(slam, occupied_log_odds=_SIGHTINGS * slam.hit_log_odds)
        self._seen, self._behind = GridMap(sure), GridMap(sure)
        self._mount = np.array(base_from_camera, np.float64)
        self._limits = np.array([config.step_m, config.slope, config.height_m, config.reach_m])
        self.surfaces_m = self.seen_m = np.empty((0, 2))
        self._trail: list[FloatArray] = []

    def look(
        self,
        image: DepthImage,
        pose: FloatArray,
        scan_m: FloatArray,
        scan_pose: FloatArray,
        movers: MoverTracks | None = None,
    ) -> FloatArray:
        """Take an image, seen from ``pose`` (3,) in map; (k, 2) in map, what is new in it.

        scan_m: (n, 2) in base_link at ``scan_pose`` (3,) in map, the latest scan's points.
        """
        if not self._trail or math.dist(self._trail[-1], pose[:2]) > _TRAIL_M:
            self._trail.append(np.array(pose[:2]))
        rows, cols = image.depth_m.shape
        aside = pixel_slopes(cols, image.focal_px[0])
        high = pixel_slopes(rows, image.focal_px[1])
        nearest, free, top = in_the_way(image.depth_m, high, self._mount[2], self._limits).T
        met = np.isfinite(nearest)
        far, its_aside = nearest[met], aside[met]
        points = self._points(far, its_aside)
        same_m = np.where(top[met] >= self._config.plane_m, _TALL_M, _SAME_M)
        # An image may come between two scans: the robot has moved on since the last one.
        scan_now = transform_points(between(pose, scan_pose), scan_m)
        new = ~seen_too(points, scan_now, same_m, _ONE_SURFACE_M)
        if movers is not None:
            theirs = movers.discs_at(image.t_ns, _MOVER_M)
            new &= ~on_discs(transform_points(pose, points), theirs)
            self._fade()
        far, its_aside = far[new], its_aside[new]
        behind = np.concatenate([self._points(far + d, its_aside) for d in _DEPTHS_M])
        # Nearer than this, the image's edges cut off the robot's foot or its head.
        whole_m = max(self._mount[2], self._config.height_m - self._mount[2]) / high[0]
        until = np.minimum(free - _NOT_SO_FAR_M, self._config.clear_m)
        clear = until > whole_m
        ways = [self._points(d, aside[clear]) for d in (whole_m, until[clear])]
        fresh = [
            _enter(self._seen, self._points(far - _NEARER_M, its_aside), ways, pose),
            _enter(self._behind, behind, ways, pose),
        ]
        self.seen_m = self._seen.surfaces()
        self.surfaces_m = np.concatenate((self.seen_m, self._behind.surfaces()))
        return np.concatenate(fresh)

    def has_been_on(self, pose: FloatArray, course: float) -> bool:
        """Whether the robot came by the way that leads from ``pose`` (3,) on a course, rad: one
        that it may take backwards, unseeing."""
        ahead = np.array(_BACKWARDS_M)[:, None] * np.array([math.cos(course), math.sin(course)])
        apart = (pose[:2] + ahead)[:, None] - np.array(self._trail or [np.full(2, np.inf)])
        return bool((np.hypot(*np.moveaxis(apart, -1, 0)).min(axis=1) < _ASIDE_M).all())

    def _fade(self) -> None:
        """Trust a little less in all that is remembered: what moves leaves traces."""
        for grid in (self._seen, self._behind):
            grid.fade(_FADES)

    def _points(self, depth: FloatArray | float, aside: FloatArray) -> FloatArray:
        """(n, 2) in base_link, at depths (n,) in columns that lead ``aside`` (n,) for one of it."""
        x, y, _ = self._mount
        return np.stack(np.broadcast_arrays(x + depth, y + depth * aside), axis=1)


def looking_ahead(config: Config) -> Config:
    """The settings of a robot that sees some things only ahead: it turns to where it will go, and
    then goes, so that nothing comes from the side under its tracks."""
    tracker, smoother = config.tracker, config.smoother
    turn = min(tracker.turn_on_spot_rad, _TURN_RAD)
    lead_in = min(smoother.lead_in_max_turn_rad, _LEAD_IN_RAD)
    return replace(
        config,
        tracker=replace(tracker, turn_on_spot_rad=turn),
        smoother=replace(smoother, lead_in_max_turn_rad=lead_in),
    )


def _enter(
    grid: GridMap, points: FloatArray, ways: list[FloatArray], pose: FloatArray
) -> FloatArray:
    """Enter points (n, 2) in a grid, and what is free: ways from (m, 2) to (m, 2); what is new."""
    starts, ends = ways
    through = np.repeat([False, True], [len(points), len(ends)])
    fresh, _ = grid.insert(
        np.concatenate((points, ends)), np.concatenate((points, starts)), pose, through
    )
    return fresh
