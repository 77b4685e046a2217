"""Localise the robot in a given map, from a known or an unknown start.

A lost robot reports that it is lost. It then joins the scans of its last metres and searches the
whole map for them. A single scan, of a corridor or a corner, fits in many places.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from simloop.estimation.relocalise import Place, best_place
from simloop.geometry.se2 import between
from simloop.graph_slam.closures import cluster_of
from simloop.graph_slam.scan_tracker import ScanTracker
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import meetings
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

_RIVAL_M, _RIVAL_RAD = 0.5, 0.35  # two poses farther apart than this are different places
_COARSE_POINTS = 150  # about how many points the search of the whole map uses
_MOST_RIVALS = 6  # if more places than this look alike, the search gives no result
_CLEARLY = 0.02  # share of points: a rival must have this many more in free space
_TILE_CELLS = 2048  # largest side of a square that is searched at once: 26 million numbers
_NO_WEIGHTS = np.zeros(2)  # no penalty for the distance from the middle of the window
# Standard deviations of x, y, m, and yaw, rad: at a known start, and at a place that was found.
_START_STD, _FOUND_STD = (0.1, 0.1, 0.05), (0.05, 0.05, 0.02)


class MapLocaliser:
    """Tracker of the robot in a map that does not change.

    A place that the search of the whole map finds is accepted later: when the robot has moved on
    and the scans still fit.

    Attributes:
        lost: whether the pose is only a guess.
        relocalised: how often a search of the whole map found the robot.
    """

    def __init__(
        self, grid: GridMap, config: MappingConfig, pose: FloatArray | None = None
    ) -> None:
        """Start at a known place, or lost.

        Args:
            grid: the map.
            config: settings.
            pose: (3,) base_link in map at the first scan; None if unknown.
        """
        self._grid, self._config = grid, config
        self._tracker = ScanTracker(config)
        self.lost = pose is None
        self._lookout: _Lookout | None = _Lookout(config) if pose is None else None
        self._unproved: FloatArray | None = None
        if pose is not None:
            self._set(np.array(pose, np.float64), _START_STD)
        self._odom: FloatArray | None = None
        self._misses = 0
        self.relocalised = 0

    @property
    def pose(self) -> FloatArray:
        """(3,) base_link in map; only a guess while ``lost``."""
        return self._tracker.pose.copy()

    def step(self, points: FloatArray, odom: FloatArray) -> bool:
        """Process a scan.

        Args:
            points: (n, 2) hits in base_link, m.
            odom: (3,) raw odometry, odom_from_base.

        Returns:
            Whether the pose is known; False while lost.
        """
        motion = np.zeros(3) if self._odom is None else between(self._odom, odom)
        self._odom = np.array(odom, np.float64)
        self._tracker.predict(motion)
        if self._lookout is not None:
            cluster = self._lookout.look(points, motion)
            if cluster is not None:
                self._find(cluster)
            return False
        good = self._tracker.match(self._grid, points, motion) and self._believable(points)
        self._misses = 0 if good else self._misses + 1
        if self._misses >= self._config.lost_scans:
            self.lost, self._lookout, self._unproved = True, _Lookout(self._config), None
        elif self._unproved is not None and _apart(self._unproved, self.pose, self._config):
            self.lost, self._unproved = False, None
            self.relocalised += 1
        return not self.lost

    def _believable(self, points: FloatArray) -> bool:
        """Return whether the match is credible: few points lie in the map's free space."""
        agreement, known = meetings(self._grid, points, self._tracker.pose)
        return agreement >= self._config.track_agreement and known >= self._config.least_share

    def _find(self, cluster: FloatArray) -> None:
        """Search the whole map. A place that is found must still be confirmed by motion."""
        pose = relocalise(self._grid, cluster, self._config)
        if pose is not None:
            self._set(pose, _FOUND_STD)
            self._lookout, self._misses, self._unproved = None, 0, pose

    def _set(self, pose: FloatArray, std: tuple[float, float, float]) -> None:
        self._tracker.pose = pose
        self._tracker.covariance = np.diag(np.square(std))


class _Lookout:
    """Collector of a lost robot's last scans, which are joined by matching."""

    def __init__(self, config: MappingConfig) -> None:
        self._config, self._tracker = config, ScanTracker(config)
        self._grid = GridMap(config.grid)
        self._points: list[FloatArray] = []
        self._poses: list[FloatArray] = []

    def look(self, points: FloatArray, motion: FloatArray) -> FloatArray | None:
        """Return the joined points (n, 2) in base_link if the robot has moved on, else None."""
        if self._poses:
            self._tracker.predict(motion)
            self._tracker.match(self._grid, points, motion)
            if not _apart(self._poses[-1], self._tracker.pose, self._config):
                return None
        self._grid.insert(points, np.zeros_like(points), self._tracker.pose)
        most = self._config.lookout_keyframes
        self._points = [*self._points[1 - most :], points]
        self._poses = [*self._poses[1 - most :], self._tracker.pose.copy()]
        return cluster_of(self._points, self._poses, self._config.cluster_points)


def _apart(a: FloatArray, b: FloatArray, config: MappingConfig) -> bool:
    """Return whether ``a`` and ``b`` are as far apart as two keyframes."""
    off = between(a, b)
    return math.hypot(off[0], off[1]) >= config.keyframe_m or abs(off[2]) >= config.keyframe_rad


def relocalise(grid: GridMap, points: FloatArray, config: MappingConfig) -> FloatArray | None:
    """Search the whole map for a set of points.

    The search is exact on its raster of poses (branch and bound). All places that come near the
    best score are then compared by the share of points that lie in the map's free space.

    Args:
        grid: The map.
        points: (n, 2) in base_link, m, of one scan or of several joined scans.
        config: The mapper's settings.

    Returns:
        (3,) x, y, yaw of base_link in map at the only place where the points fit. None if they
        fit nowhere, or at several places.
    """
    if not grid.occupied.any() or len(points) < 0.1 * config.cluster_points:
        return None
    places = []
    for candidate in _candidates(grid, points, config):
        pose, _, share, residual = grid.refine(points, candidate)
        agreement, overlap = meetings(grid, points, pose)
        fits = share >= config.least_share and residual <= config.grid.most_residual
        cost = 1.0 - agreement
        believable = overlap >= config.least_overlap and cost <= 1.0 - config.agreement
        places.append(Place(cost, fits and believable, pose))
    if len(places) > _MOST_RIVALS:
        return None
    return best_place(places, lambda best, other: other.cost >= 2.0 * best.cost + _CLEARLY)


def _candidates(grid: GridMap, points: FloatArray, config: MappingConfig) -> Iterator[FloatArray]:
    """Yield the poses (3,) with a score near the best one, best first and far apart."""
    few = np.ascontiguousarray(points[:: max(1, len(points) // _COARSE_POINTS)])
    excluded = np.empty((0, 5))
    least = config.closure_least_score
    while len(excluded) <= _MOST_RIVALS:
        best, place = -1.0, np.zeros(3)
        for middle, reach in _tiles(grid):
            prior, window = np.array([*middle, 0.0]), np.array([reach, math.pi])
            found, score = grid.search(few, prior, window, _NO_WEIGHTS, max(least, best), excluded)
            if score > best:
                best, place = score, found
        if best < 0.0:
            return
        if not len(excluded):
            least = max(least, config.rival_score * best)
        excluded = np.vstack([excluded, [*place, _RIVAL_M, _RIVAL_RAD]])
        yield place


def _tiles(grid: GridMap) -> list[tuple[FloatArray, float]]:
    """Cover a map by squares, each with its middle (2,) and half its side, m.

    One search keeps a number for each heading and each block of cells in the square. So a large
    map is searched in several squares, and a long one is not searched as the square around it.
    """
    sizes = np.array(grid.log_odds.shape[::-1])
    counts = -(-sizes // _TILE_CELLS)
    reach = 0.5 * grid.resolution_m * min(int(sizes.max()), _TILE_CELLS)
    step = grid.resolution_m * sizes / counts
    return [
        (grid.origin_m + step * (np.array([col, row]) + 0.5), reach)
        for row in range(counts[1])
        for col in range(counts[0])
    ]
