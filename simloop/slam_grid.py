"""Grid SLAM: scans are deskewed, matched to the map that earlier scans made, and entered in it.

The map is a log-odds occupancy grid that grows as needed; each cell also keeps the sums of its
hits, so that surfaces are known finer than the cells. Unknown is free, as in Sabiha 2022.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.config import SlamConfig, VehicleConfig
from simloop.geometry.discs import discs_of, on_discs
from simloop.geometry.se2 import transform_points
from simloop.geometry.small_matrices import inverse_3
from simloop.mapping.grid_map import NOWHERE_M, GridMap
from simloop.mapping.map_files import load_map
from simloop.mapping.scan_match import deskew
from simloop.messages import FloatArray, LidarScan, PoseFix, WorldView

_FIRST_POINTS = 10  # a scan with fewer hits is not matched
_NEXT_TO_NOTHING = 1e-3 * np.eye(3)  # information where a match has none at all
_EDGE_PENALTY = 0.02  # of the search's score at the window's edge: of equals, the nearest


class GridSlam:
    """The robot's map, and the pose fixes that it gives.

    base_from_laser: (3,) x, y, yaw of the laser in base_link.
    """

    def __init__(
        self, config: SlamConfig, vehicle: VehicleConfig, base_from_laser: FloatArray
    ) -> None:
        self._config, self._mount = config, np.ascontiguousarray(base_from_laser, np.float64)
        prior = Path(config.prior_map)
        self.grid = load_map(prior, config) if config.prior_map else GridMap(config)
        self.resolution_m = self.grid.resolution_m
        self.new_surfaces_m = np.empty((0, 2))
        self.new_share = 0.0
        self._scan_t_ns = -1
        self.points_m = np.empty((0, 2))
        self._matched = self._origins = np.empty((0, 2))
        self._window = np.array([config.search_xy_m, config.search_yaw_rad])
        self._floor = np.diag(np.square([config.match_std_xy_m] * 2 + [config.match_std_yaw_rad]))

    @property
    def matched(self) -> int:
        """How many points of the last scan were held against the map."""
        return len(self._matched)

    @property
    def origin_m(self) -> FloatArray:
        """(2,) lower left corner of the first cell."""
        return self.grid.origin_m

    @property
    def log_odds(self) -> np.ndarray:
        """(rows, cols) float32, [iy, ix], a read-only view; 0 is unknown."""
        return _read_only(self.grid.log_odds)

    @property
    def occupied(self) -> np.ndarray:
        """(rows, cols) bool, a read-only view: where ``log_odds`` is above the threshold."""
        return _read_only(self.grid.occupied)

    def match(
        self,
        scan: LidarScan,
        trail_t_ns: np.ndarray,
        trail: FloatArray,
        prior_pose: FloatArray,
        prior_covariance: FloatArray,
        moving: FloatArray | None = None,
    ) -> PoseFix:
        """Where the scan fits the map: pose of base_link at the scan's end.

        trail_t_ns (k,), trail (k, 3): the estimator's poses over the sweep, oldest first.
        prior_pose (3,), prior_covariance (3, 3): its belief at the scan's end. ``ok`` is False on
        an empty map, with too few hits, or where the scan does not fit. moving: (n, 3) discs in
        map, x, y, radius, of what moves: its points are not the map's, and tell nothing.
        """
        self._take(scan, trail_t_ns, trail)
        prior = np.array(prior_pose, np.float64)
        self._matched = self.points_m
        if moving is not None:
            theirs = on_discs(transform_points(prior, self.points_m), moving)
            self._matched = np.ascontiguousarray(self.points_m[~theirs])
        if self.grid.scans == 0 or len(self._matched) < _FIRST_POINTS:
            return PoseFix(scan.t_ns, prior, np.array(prior_covariance), 0.0, False)
        # The belief is mostly so good that the refinement's basin holds the answer; where it
        # is not, or the refined pose does not fit, the whole window is searched.
        unsure = math.sqrt(max(prior_covariance[0, 0], prior_covariance[1, 1])) > 0.5 * (
            self.resolution_m
        )
        found = None if unsure else self.grid.refine(self._matched, prior)
        if found is None or not self._fits(*found[2:]):
            again = self.grid.refine(self._matched, self._search(prior))
            if found is None or again[2] > found[2]:
                found = again
        pose, information, share, residual = found
        ok = self._fits(share, residual)
        covariance = self._covariance(information, residual) if ok else np.array(prior_covariance)
        return PoseFix(scan.t_ns, pose, covariance, share, ok)

    def insert(
        self, scan: LidarScan, pose: FloatArray, moving: NDArray[np.bool_] | None = None
    ) -> None:
        """Enter a scan that ended at ``pose`` (3,); the trail is that of its match.

        moving: (n,) which of ``points_m`` lie on what moves, and are left out.

        ``new_surfaces_m`` (k, 2) then holds where, in map, cells became occupied by it, and
        ``new_share`` their share of all cells in which its beams ended.
        """
        if scan.t_ns != self._scan_t_ns:
            self._take(scan, np.array([scan.t_ns], np.int64), np.array([pose], np.float64))
        if self._config.extend_map:
            points, origins = self.points_m, self._origins
            if moving is not None:
                points, origins = points[~moving], origins[~moving]
            self.new_surfaces_m, self.new_share = self.grid.insert(
                points, origins, np.array(pose, np.float64)
            )

    def view(self, t_ns: int, goal: FloatArray, surfaces_m: FloatArray | None = None) -> WorldView:
        """The map as a planner sees it; surfaces_m: (k, 2) in map, what else stands there."""
        grid = self.grid
        if surfaces_m is not None and len(surfaces_m):
            grid = grid.joined(surfaces_m)
        box = NOWHERE_M * np.array([-1.0, -1.0, 1.0, 1.0])
        occupied, origin = grid.occupied, grid.origin_m
        found = discs_of(occupied, origin, self.resolution_m)
        if occupied.size:
            size = self.resolution_m * np.array(occupied.shape[::-1])
            low = np.minimum(origin, goal - self._config.beyond_m)
            high = np.maximum(origin + size, goal + self._config.beyond_m)
            box = np.concatenate((low, high))
        return WorldView(t_ns, origin.copy(), self.resolution_m, grid.distances(), found, box)

    def _take(self, scan: LidarScan, trail_t_ns: np.ndarray, trail: FloatArray) -> None:
        self.points_m, self._origins = deskew(
            scan.angles_rad,
            scan.ranges_m,
            scan.t_ns - scan.age_ns,
            np.array([scan.range_min_m, scan.range_max_m]),
            trail_t_ns,
            trail,
            self._mount,
        )
        self._scan_t_ns = scan.t_ns

    def _search(self, prior: FloatArray) -> FloatArray:
        points = self._matched[:: max(1, len(self._matched) // self._config.search_points)]
        weights = _EDGE_PENALTY / self._window**2
        return self.grid.search(np.ascontiguousarray(points), prior, self._window, weights)[0]

    def _fits(self, share: float, residual: float) -> bool:
        return share >= self._config.least_overlap and residual <= self._config.most_residual

    def _covariance(self, information: FloatArray, residual: float) -> FloatArray:
        """(3, 3): what the match leaves open, and the grain of the cells as a floor.

        A direction that no surface holds, as along a corridor, has no information and so a large
        variance. The map's own error is not in it: it is the same for one fix after the other.
        """
        scaled = inverse_3(information + _NEXT_TO_NOTHING)
        covariance = scaled * max(residual, 0.1) + self._floor
        return 0.5 * (covariance + covariance.T)


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.setflags(write=False)
    return view
