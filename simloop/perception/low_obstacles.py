"""Map obstacles that the LiDAR cannot see: too low for its plane, or hanging above it.

    depth image -> steep rises from the ground -> without what the scan shows -> a separate grid

A column of an image is a vertical slice through the world. A pixel is an obstacle if a pixel below
it in its column is lower and not much nearer. So ramps and a pitching robot make no obstacles, but
a bar that hangs free does. The map keeps the nearest such pixel of each column and some depth
behind it. An obstacle stays in the map when the robot is so near that the camera no longer sees it.
It is removed only where the camera sees free space over the whole height of the robot.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import LowObstaclesConfig, SlamConfig
from simloop.geometry.discs import on_discs
from simloop.geometry.footprint import points_in
from simloop.geometry.se2 import between, transform_points
from simloop.mapping.grid_map import GridMap
from simloop.messages import DepthImage, FloatArray, MoverTracks, pixel_slopes

_EDGE_M = 0.04  # two pixels of a column this close in depth belong to one object
_BIAS_M = 0.015  # a corner is seen too far away, as the mean of its cell: this moves it back
_DEPTHS_M = tuple(np.arange(0.05, 0.26, 0.05).tolist())
"""Depths behind its face to which an obstacle is assumed to extend, until they are seen free, m."""
# Spacing of the robot's trail, distance within which a place is on it, and distances ahead at
# which ``has_driven`` tests this.
_TRAIL_KEPT = 200  # places of the trail, 5 cm apart: those that matter are the last ones
_TRAIL_STEP_M, _ASIDE_M, _BACKWARDS_M = 0.05, 0.12, (0.1, 0.2, 0.3, 0.4, 0.5)
_SIGHTINGS = 1.5  # a cell needs more hits than this: a moving object hits each place only once
_FADE = 0.01  # share of the log-odds removed by each image while something moves
_FREE_MARGIN_M = 0.1  # no free votes in this distance before an obstacle
_SAME_M = 0.03  # a point this near to a surface of the scan lies on that surface
_TALL_M = 0.15  # the same for objects as tall as the scan's plane: they may have moved since
_ONE_SURFACE_M = 0.3  # neighbours in a scan that are farther apart are on different surfaces
_MOVER_PADDING_M = 0.1  # added to the radius of moving obstacles


@njit(cache=True)
def _climbs(
    depth: NDArray[np.float32], z: FloatArray, row: int, col: int, step: float, slope: float
) -> bool:
    """Return whether the pixel rises steeply from a pixel below it in its column."""
    for below in range(row + 1, depth.shape[0]):
        rise = z[row] - z[below]
        if rise >= step and rise >= slope * abs(depth[row, col] - depth[below, col]):
            return True
    return False


@njit(cache=True)
def find_obstacles(
    depth: NDArray[np.float32], row_slopes: FloatArray, camera_m: float, limits: FloatArray
) -> FloatArray:
    """Find the nearest obstacle in each column of a depth image.

    If the foot of an object lies in a wide gap between the depths of two rows, its distance is
    decided later, when the robot is nearer. A pixel above the robot's height is an obstacle too if
    the next ray below passes under it within the robot's height: its lower edge may lie anywhere
    between the two rays.

    Args:
        depth: (rows, cols) along the optical axis, m, top row first; inf where nothing came back.
        row_slopes: (rows,) rise of each row's rays per unit of depth.
        camera_m: height of the camera over the ground, m.
        limits: (4,) least step, m; least slope of a rise, for a column straight ahead (it is less
            steep to the sides); greatest height that obstructs the robot, m; greatest depth, m.

    Returns:
        (cols, 3) for each column: depth of the nearest obstacle, m, or inf; depth up to which the
        ground is surely free, m; greatest height seen of the nearest obstacle, m.
    """
    step, slope, height, reach = limits
    rows, cols = depth.shape
    found, z = np.zeros((cols, 3)), np.empty(rows)
    for col in range(cols):
        nearest, ground, free = np.inf, 0.0, np.inf
        before = 0.0  # depth of the next valid pixel below
        # Walk upwards from the foot of the image: each pixel is compared with those below it.
        for row in range(rows - 1, -1, -1):
            far = float(depth[row, col])
            z[row] = camera_m + row_slopes[row] * far if far < np.inf else np.nan
            if not far < np.inf:
                continue
            if z[row] < step:
                ground = max(ground, far)
            elif far <= reach and (far < nearest or before < free):
                # The ray below reached farther than this pixel, so there is a gap under it.
                under = row + 1 < rows and before > far
                hangs = under and camera_m + row_slopes[row + 1] * far < height <= z[row]
                if hangs or (z[row] <= height and _climbs(depth, z, row, col, step, slope)):
                    free = min(free, before, far)
                    # The foot is known well only if the pixel below has about the same depth.
                    if far - before < _EDGE_M:
                        nearest = min(nearest, far)
            before = far
        found[col, 0], found[col, 1] = nearest, min(ground, free)
        # The height shows whether the LiDAR should have seen the obstacle too.
        for row in range(rows):
            if abs(depth[row, col] - nearest) < _EDGE_M:
                found[col, 2] = max(found[col, 2], z[row])
    return found


@njit(cache=True)
def on_scan_surfaces(
    points: FloatArray, scan: FloatArray, tolerance_m: FloatArray, gap_m: float
) -> NDArray[np.bool_]:
    """Find the points that lie on the surfaces that a scan shows.

    Neighbouring hits of the scan are joined by a straight line, because the camera also sees a
    wall between two beams.

    Args:
        points: (n, 2) m.
        scan: (m, 2) hits of a full turn, in the same frame and in the order of their bearings, m.
        tolerance_m: (n,) a point nearer than this to a line is on it.
        gap_m: neighbours of the scan farther apart than this are not joined.

    Returns:
        (n,) bool, whether each point lies on a surface.
    """
    out = np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        for k in range(scan.shape[0]):
            # From the previous hit (the last one for k = 0) to this one.
            ax, ay = scan[k - 1, 0], scan[k - 1, 1]
            dx, dy = scan[k, 0] - ax, scan[k, 1] - ay
            px, py = points[i, 0] - ax, points[i, 1] - ay
            square = dx * dx + dy * dy
            if square > gap_m * gap_m:
                dx, dy, square = 0.0, 0.0, 0.0  # two surfaces: test the previous hit alone
            # f: position of the point's projection along the line, 0 to 1.
            f = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square > 0.0 else 0.0
            if math.hypot(px - f * dx, py - f * dy) < tolerance_m[i]:
                out[i] = True
                break
    return out


class LowObstacleMap:
    """Map of the obstacles that the depth camera saw and the LiDAR did not.

    Attributes:
        surfaces_m: (k, 2) in map, all obstacles with their assumed depth.
        seen_m: (m, 2) in map, the part of them that was really seen.
    """

    def __init__(
        self,
        config: LowObstaclesConfig,
        slam: SlamConfig,
        base_from_camera: FloatArray,
        laser_height_m: float,
    ) -> None:
        """Make an empty map.

        Args:
            config: definition of an obstacle.
            slam: settings of the grids.
            base_from_camera: (3,) the camera's position in base_link, m. It looks along x and is
                level.
            laser_height_m: height of the LiDAR's plane over the ground, m.
        """
        self._config, self._laser_m = config, laser_height_m
        sure = replace(slam, occupied_log_odds=_SIGHTINGS * slam.hit_log_odds)
        self._seen, self._behind = GridMap(sure), GridMap(sure)
        self._mount = np.array(base_from_camera, np.float64)
        self._limits = np.array([config.step_m, config.slope, config.height_m, config.reach_m])
        self.surfaces_m = self.seen_m = np.empty((0, 2))
        self._trail: list[FloatArray] = []

    def update(
        self,
        image: DepthImage,
        pose: FloatArray,
        scan_m: FloatArray,
        scan_pose: FloatArray,
        movers: MoverTracks | None = None,
    ) -> FloatArray:
        """Enter a depth image.

        Args:
            image: the image.
            pose: (3,) base_link in map when the image was taken.
            scan_m: (n, 2) hits of the latest scan, m, in base_link at ``scan_pose``.
            scan_pose: (3,) base_link in map at the end of that scan, which may be earlier.
            movers: tracked moving obstacles; they are not entered.

        Returns:
            (k, 2) in map, m, hit means of the cells that became occupied.
        """
        if not self._trail or math.dist(self._trail[-1], pose[:2]) > _TRAIL_STEP_M:
            self._trail.append(np.array(pose[:2]))
        rows, cols = image.depth_m.shape
        column_slopes = pixel_slopes(cols, image.focal_px[0])
        row_slopes = pixel_slopes(rows, image.focal_px[1])
        nearest, free, top = find_obstacles(
            image.depth_m, row_slopes, self._mount[2], self._limits
        ).T
        met = np.isfinite(nearest)
        scan_now = transform_points(between(pose, scan_pose), scan_m)
        depth, slope = nearest[met], column_slopes[met]
        new = self._unseen_by_scan(self._points(depth, slope), top[met], scan_now)
        if movers is not None:
            discs = movers.discs_at(image.t_ns, _MOVER_PADDING_M)
            new &= ~on_discs(transform_points(pose, self._points(depth, slope)), discs)
            self._fade()
        rays = self._free_rays(free, column_slopes, row_slopes[0])
        return self._insert(depth[new], slope[new], rays, pose)

    def has_driven(self, pose: FloatArray, course: float) -> bool:
        """Return whether the robot has driven here before, so that it may reverse without seeing.

        Args:
            pose: (3,) base_link in map.
            course: direction in map in which the robot would drive from the pose, rad.

        Returns:
            Whether the robot's own trail follows the next half metre.
        """
        ahead = np.array(_BACKWARDS_M)[:, None] * np.array([math.cos(course), math.sin(course)])
        apart = (pose[:2] + ahead)[:, None] - np.array(self._trail or [np.full(2, np.inf)])
        return bool((np.hypot(*np.moveaxis(apart, -1, 0)).min(axis=1) < _ASIDE_M).all())

    def trail_from(self, pose: FloatArray) -> FloatArray:
        """Express the last part of the robot's own trail in its present frame.

        Args:
            pose: (3,) base_link in map now.

        Returns:
            (k, 2) where base_link has been, in base_link, m.
        """
        trail = np.array(self._trail[-_TRAIL_KEPT:]).reshape(-1, 2)
        return points_in(pose, np.zeros(3), trail)

    def _unseen_by_scan(
        self, points: FloatArray, top_m: FloatArray, scan_m: FloatArray
    ) -> NDArray[np.bool_]:
        """Return (n,) which of points (n, 2), with heights ``top_m`` (n,), the scan lacks."""
        tolerance = np.where(top_m >= self._laser_m, _TALL_M, _SAME_M)
        return ~on_scan_surfaces(points, scan_m, tolerance, _ONE_SURFACE_M)

    def _free_rays(
        self, free: FloatArray, column_slopes: FloatArray, top_slope: float
    ) -> list[FloatArray]:
        """Return starts and ends (m, 2) in base_link of the rays over ground seen free."""
        # At smaller depths the image does not cover the whole height of the robot.
        whole_m = max(self._mount[2], self._config.height_m - self._mount[2]) / top_slope
        until = np.minimum(free - _FREE_MARGIN_M, self._config.clear_m)
        clear = until > whole_m
        return [self._points(d, column_slopes[clear]) for d in (whole_m, until[clear])]

    def _insert(
        self, depth: FloatArray, slope: FloatArray, rays: list[FloatArray], pose: FloatArray
    ) -> FloatArray:
        """Enter obstacles (n,) by depth and column slope; return the newly occupied places."""
        behind = np.concatenate([self._points(depth + d, slope) for d in _DEPTHS_M])
        fresh = [
            _enter(self._seen, self._points(depth - _BIAS_M, slope), rays, pose),
            _enter(self._behind, behind, rays, pose),
        ]
        self.seen_m = self._seen.surfaces()
        self.surfaces_m = np.concatenate((self.seen_m, self._behind.surfaces()))
        return np.concatenate(fresh)

    def _fade(self) -> None:
        """Reduce all evidence a little, because moving obstacles leave traces in the map."""
        for grid in (self._seen, self._behind):
            grid.fade(_FADE)

    def _points(self, depth: FloatArray | float, slope: FloatArray) -> FloatArray:
        """Return points (n, 2) in base_link, m, by depth and leftward slope of their columns."""
        x, y, _ = self._mount
        return np.stack(np.broadcast_arrays(x + depth, y + depth * slope), axis=1)


def _enter(
    grid: GridMap, points: FloatArray, rays: list[FloatArray], pose: FloatArray
) -> FloatArray:
    """Enter points (n, 2) and free rays (m, 2) in base_link; return newly occupied places."""
    starts, ends = rays
    through = np.repeat([False, True], [len(points), len(ends)])
    fresh, _ = grid.insert(
        np.concatenate((points, ends)), np.concatenate((points, starts)), pose, through
    )
    return fresh
