"""Deskew each scan, match it to the map of the earlier scans, and enter it there (grid SLAM).

The map is a log-odds occupancy grid that grows when needed. Each cell also keeps the sums of its
hits, so that surfaces are known finer than the cells. Unknown space counts as free (Sabiha 2022).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.config import SlamConfig
from simloop.estimation.sight import silent_beams
from simloop.geometry.discs import discs_of, on_discs
from simloop.geometry.se2 import transform_points
from simloop.geometry.small_matrices import inverse_3
from simloop.mapping.grid_map import NOWHERE_M, GridMap
from simloop.mapping.map_files import load_map
from simloop.mapping.scan_match import deskew
from simloop.messages import FloatArray, LidarScan, PoseFix, WorldView

_LEAST_POINTS = 10  # a scan with fewer hits is not matched
_LEAST_INFORMATION = 1e-3 * np.eye(3)  # added, so that the information can be inverted
_RECENT_SCANS = 5  # what one of so many last scans measured, the next one must measure too
_NOWHERE = np.empty((0, 2))
_EDGE_PENALTY = 0.02  # taken off the score at the window's edge: the nearest of equals wins


class GridSlam:
    """Map of the robot, and the scan matcher that makes pose fixes with it.

    Attributes:
        grid: The map.
        resolution_m: Side of a cell, m.
        points_m: (n, 2) hits of the last scan in base_link at its end, m.
    """

    def __init__(self, config: SlamConfig, base_from_laser: FloatArray) -> None:
        """Start with an empty map, or with the map file in the settings.

        Args:
            config: Settings of the map and the matcher.
            base_from_laser: (3,) x, y, yaw of the laser in base_link, m and rad.

        Raises:
            InputError: The map file cannot be read.
        """
        self._config, self._mount = config, np.ascontiguousarray(base_from_laser, np.float64)
        prior = Path(config.prior_map)
        self.grid = load_map(prior, config) if config.prior_map else GridMap(config)
        self.resolution_m = self.grid.resolution_m
        self._scan_t_ns = -1
        self._sweep = (np.zeros(1, np.int64), np.zeros((1, 3)))
        self.points_m = np.empty((0, 2))
        self._matched = self._origins = np.empty((0, 2))
        self._window = np.array([config.search_xy_m, config.search_yaw_rad])
        self._floor = np.diag(np.square([config.match_std_xy_m] * 2 + [config.match_std_yaw_rad]))

    @property
    def matched(self) -> int:
        """Number of points of the last scan that were compared with the map."""
        return len(self._matched)

    @property
    def origin_m(self) -> FloatArray:
        """(2,) lower left corner of the first cell in map, m."""
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
        sweep_t_ns: NDArray[np.int64],
        sweep_poses: FloatArray,
        prior_pose: FloatArray,
        prior_covariance: FloatArray,
        ignore: FloatArray | None = None,
    ) -> PoseFix:
        """Find the pose at which a scan fits the map.

        Args:
            scan: A full turn of the LiDAR.
            sweep_t_ns: (k,) rising stamps of the odometry during the turn, ns.
            sweep_poses: (k, 3) x, y, yaw of base_link in odom at those stamps.
            prior_pose: (3,) predicted pose of base_link in map at the scan's end.
            prior_covariance: (3, 3) covariance of the predicted pose.
            ignore: (n, 3) discs x, y, radius in map, m, of moving obstacles; points on them are
                not compared. None if nothing moves.

        Returns:
            The pose of base_link in map at the scan's end. Its ``ok`` is False if the map is empty,
            the scan has too few hits, or it does not fit.
        """
        self._deskew(scan, sweep_t_ns, sweep_poses)
        prior = np.array(prior_pose, np.float64)
        self._matched = self.points_m
        if ignore is not None:
            ignored = on_discs(transform_points(prior, self.points_m), ignore)
            self._matched = np.ascontiguousarray(self.points_m[~ignored])
        if self.grid.scans == 0 or len(self._matched) < _LEAST_POINTS:
            return PoseFix(scan.t_ns, prior, np.array(prior_covariance), 0.0, False)
        # The prediction is usually so good that the refinement converges from it. If it is too
        # uncertain, or if the refined pose does not fit, the whole window is searched.
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

    def unanswered(
        self, scan: LidarScan, pose: FloatArray, reach_m: float
    ) -> tuple[FloatArray, int]:
        """Find the surfaces that the scan of the last ``match`` should have measured and did not.

        Args:
            scan: That scan.
            pose: (3,) x, y, yaw of base_link in map at the scan's end.
            reach_m: Distance up to which the beams stay in the map's plane, m.

        Returns:
            The places (k, 2) in map, m, that silent beams cross, one for each of these beams, and
            how many of them were measured in one of the last scans.
        """
        silent = silent_beams(scan.ranges_m)
        if not self.grid.scans or not silent.any():
            return _NOWHERE, 0
        ends, origins = deskew(
            scan.angles_rad[silent],
            np.full(np.count_nonzero(silent), min(reach_m, scan.range_max_m)),
            scan.t_ns - scan.age_ns[silent],
            np.array([0.0, scan.range_max_m]),
            *self._sweep,
            self._mount,
        )
        places, recent = self.grid.unanswered(ends, origins, pose, _RECENT_SCANS)
        return places, int(np.count_nonzero(recent))

    def insert(
        self, scan: LidarScan, pose: FloatArray, mask: NDArray[np.bool_] | None = None
    ) -> tuple[FloatArray, float]:
        """Enter a scan in the map, unless the settings forbid changes of the map.

        If this is the scan of the last ``match``, its deskewed points are used. For any other scan,
        the robot is assumed to have stood still during the turn.

        Args:
            scan: A full turn of the LiDAR.
            pose: (3,) x, y, yaw of base_link in map at the scan's end.
            mask: (n,) which of ``points_m`` are left out; None to use all.

        Returns:
            The hit means (k, 2) in map, m, of the cells that became occupied, and their share of
            all cells in which a beam ended.
        """
        if scan.t_ns != self._scan_t_ns:
            self._deskew(scan, np.array([scan.t_ns], np.int64), np.array([pose], np.float64))
        if not self._config.extend_map:
            return np.empty((0, 2)), 0.0
        points, origins = self.points_m, self._origins
        if mask is not None:
            points, origins = points[~mask], origins[~mask]
        return self.grid.insert(points, origins, np.array(pose, np.float64))

    def view(self, t_ns: int, goal: FloatArray, surfaces_m: FloatArray | None = None) -> WorldView:
        """Make the view of the map for a planner.

        Args:
            t_ns: Stamp of the view, ns.
            goal: (2,) in map, m; the bounds extend beyond it.
            surfaces_m: (k, 2) in map, m, additional surfaces that no scan shows; None for none.

        Returns:
            Distance field, obstacle discs and bounds, without moving obstacles.
        """
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

    def _deskew(
        self, scan: LidarScan, sweep_t_ns: NDArray[np.int64], sweep_poses: FloatArray
    ) -> None:
        self.points_m, self._origins = deskew(
            scan.angles_rad,
            scan.ranges_m,
            scan.t_ns - scan.age_ns,
            np.array([scan.range_min_m, scan.range_max_m]),
            sweep_t_ns,
            sweep_poses,
            self._mount,
        )
        self._scan_t_ns = scan.t_ns
        self._sweep = (sweep_t_ns, sweep_poses)

    def _search(self, prior: FloatArray) -> FloatArray:
        points = self._matched[:: max(1, len(self._matched) // self._config.search_points)]
        weights = _EDGE_PENALTY / self._window**2
        return self.grid.search(np.ascontiguousarray(points), prior, self._window, weights)[0]

    def _fits(self, share: float, residual: float) -> bool:
        return share >= self._config.least_overlap and residual <= self._config.most_residual

    def _covariance(self, information: FloatArray, residual: float) -> FloatArray:
        """Return the covariance (3, 3) of the match, with a floor for the size of the cells.

        An unobservable direction, as along a corridor, has no information and so a large variance.
        The map's own error is not included, because it is the same in successive fixes.
        """
        scaled = inverse_3(information + _LEAST_INFORMATION)
        covariance = scaled * max(residual, 0.1) + self._floor
        return 0.5 * (covariance + covariance.T)


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.setflags(write=False)
    return view
