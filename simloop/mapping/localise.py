"""Where the robot is in a map that it was given, from a known place or from none.

While lost it says so, and looks for itself in the whole map with what it has seen over the last
metres: one scan, of a corridor or of a corner, fits in many places.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.grid_map import GridMap
from simloop.mapping.closures import cluster_of
from simloop.mapping.scan_tracker import ScanTracker
from simloop.mapping.settings import MappingConfig
from simloop.mapping.submap import meetings
from simloop.messages import FloatArray
from simloop.se2 import between

_RIVAL_M, _RIVAL_RAD = 0.5, 0.35
_COARSE_POINTS = 150
_FOUND_STD_M, _FOUND_STD_RAD = 0.05, 0.02


class Localiser:
    """Tracks the robot through ``grid``, to which nothing is added.

    pose: (3,) base_link in map at the first scan, or None where nobody knows. ``lost``: whether
    ``pose`` is but odometry's guess; ``relocalised``: how often it found itself in the whole map.
    """

    def __init__(
        self, grid: GridMap, config: MappingConfig, pose: FloatArray | None = None
    ) -> None:
        self._grid, self._config = grid, config
        self._tracker = ScanTracker(config)
        self.lost = pose is None
        if pose is not None:
            self._tracker.pose = np.array(pose, np.float64)
            self._tracker.covariance = np.diag(np.square([0.1, 0.1, 0.05]))
        self._odom: FloatArray | None = None
        self._misses = 0
        self._points: list[FloatArray] = []
        self._odoms: list[FloatArray] = []
        self.relocalised = 0

    @property
    def pose(self) -> FloatArray:
        """(3,) base_link in map; no more than a guess while ``lost``."""
        return self._tracker.pose.copy()

    def step(self, points: FloatArray, odom: FloatArray) -> bool:
        """Take a scan's hits (n, 2) in base_link at raw odometry (3,); False while lost."""
        motion = np.zeros(3) if self._odom is None else between(self._odom, odom)
        self._odom = np.array(odom, np.float64)
        news = self._remember(points)
        self._tracker.predict(motion)
        if self.lost:
            if news:
                self._find()
            return not self.lost
        good = self._tracker.match(self._grid, points, motion)
        good = good and self._tracker.score >= self._config.least_score
        self._misses = 0 if good else self._misses + 1
        self.lost = self._misses >= self._config.lost_scans
        return not self.lost

    def _remember(self, points: FloatArray) -> bool:
        """Keep the scan if the robot has moved since the last that was kept."""
        assert self._odom is not None
        if self._odoms:
            off = between(self._odoms[-1], self._odom)
            near = math.hypot(off[0], off[1]) < self._config.keyframe_m
            if near and abs(off[2]) < self._config.keyframe_rad:
                return False
        most = self._config.cluster_keyframes
        self._points = [*self._points[1 - most :], points]
        self._odoms = [*self._odoms[1 - most :], self._odom]
        return True

    def _find(self) -> None:
        cluster = cluster_of(self._points, self._odoms, self._config.cluster_points)
        pose = relocalise(self._grid, cluster, self._config)
        if pose is None:
            return
        self._tracker.pose = pose
        self._tracker.covariance = np.diag(np.square([_FOUND_STD_M, _FOUND_STD_M, _FOUND_STD_RAD]))
        self.lost, self._misses = False, 0
        self.relocalised += 1


def relocalise(grid: GridMap, points: FloatArray, config: MappingConfig) -> FloatArray | None:
    """(3,) the one pose of all in the map at which points (n, 2) fit, or None: nowhere, or several.

    Exact: no pose on the search's raster is passed over that could fit better (branch and bound).
    """
    rows, cols = grid.log_odds.shape
    if not grid.occupied.any() or len(points) < 0.1 * config.cluster_points:
        return None
    centre = grid.origin_m + 0.5 * grid.resolution_m * np.array([cols, rows])
    reach = 0.5 * grid.resolution_m * max(rows, cols)
    prior, window = np.array([*centre, 0.0]), np.array([reach, math.pi])
    few = np.ascontiguousarray(points[:: max(1, len(points) // _COARSE_POINTS)])
    no_weights, least = np.zeros(2), config.closure_least_score
    found, score = grid.search(few, prior, window, no_weights, least)
    if score < 0.0:
        return None
    but = np.array([*found, _RIVAL_M, _RIVAL_RAD])
    rival = config.rival_score * score
    if grid.search(few, prior, window, no_weights, rival, but)[1] >= 0.0:
        return None
    pose, _, share, residual = grid.refine(points, found)
    if share < config.least_share or residual > config.grid.most_residual:
        return None
    agreement, overlap = meetings(grid, points, pose)
    good = agreement >= config.agreement and overlap >= config.least_overlap
    return pose if good else None
