"""Grid SLAM: scans are deskewed, matched to the map that earlier scans made, and entered in it.

The map is a log-odds occupancy grid that grows as needed; each cell also keeps the sums of its
hits, so that surfaces are known finer than the cells. Unknown is free, as in Sabiha 2022.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from simloop.config import SlamConfig, VehicleConfig
from simloop.ekf_model import inverse_3
from simloop.grid_kernels import placed_bounds, surface_distance, trace_scan
from simloop.messages import FloatArray, LidarScan, PoseFix, WorldView
from simloop.obstacle_discs import discs_of
from simloop.scan_match import correlate, deskew, refine

_CHUNK = 64  # cells by which the grid grows
_FIRST_POINTS = 10  # a scan with fewer hits is not matched
_NEXT_TO_NOTHING = 1e-3 * np.eye(3)  # information where a match has none at all
_NOWHERE_M = 100.0  # distance reported where the map holds nothing


class GridSlam:
    """The robot's map, and the pose fixes that it gives.

    base_from_laser: (3,) x, y, yaw of the laser in base_link.
    """

    def __init__(
        self, config: SlamConfig, vehicle: VehicleConfig, base_from_laser: FloatArray
    ) -> None:
        self._config, self._mount = config, np.ascontiguousarray(base_from_laser, np.float64)
        self.resolution_m = config.resolution_m
        self.origin_m = np.zeros(2)
        self._log_odds = np.zeros((0, 0), np.float32)
        self._hits = np.zeros((0, 0, 3))
        self._stamp = np.zeros((0, 0), np.int32)
        self._occupied = np.zeros((0, 0), np.bool_)
        self.new_surfaces_m = np.empty((0, 2))
        self._scans = 0
        self._scan_t_ns = -1
        self.points_m = np.empty((0, 2))
        self._origins = np.empty((0, 2))
        self._distance: np.ndarray | None = None
        self._likelihood: np.ndarray | None = None
        self._offsets = _search_offsets(config)
        self._floor = np.diag(np.square([config.match_std_xy_m] * 2 + [config.match_std_yaw_rad]))

    @property
    def log_odds(self) -> np.ndarray:
        """(rows, cols) float32, [iy, ix], a read-only view; 0 is unknown."""
        view = self._log_odds.view()
        view.setflags(write=False)
        return view

    @property
    def occupied(self) -> np.ndarray:
        """(rows, cols) bool, a read-only view: where ``log_odds`` is above the threshold."""
        view = self._occupied.view()
        view.setflags(write=False)
        return view

    def match(
        self,
        scan: LidarScan,
        trail_t_ns: np.ndarray,
        trail: FloatArray,
        prior_pose: FloatArray,
        prior_covariance: FloatArray,
    ) -> PoseFix:
        """Where the scan fits the map: pose of base_link at the scan's end.

        trail_t_ns (k,), trail (k, 3): the estimator's poses over the sweep, oldest first.
        prior_pose (3,), prior_covariance (3, 3): its belief at the scan's end. ``ok`` is False on
        an empty map, with too few hits, or where the scan does not fit.
        """
        self._take(scan, trail_t_ns, trail)
        prior = np.array(prior_pose, np.float64)
        if self._scans == 0 or len(self.points_m) < _FIRST_POINTS:
            return PoseFix(scan.t_ns, prior, np.array(prior_covariance), 0.0, False)
        # The belief is mostly so good that the refinement's basin holds the answer; where it
        # is not, or the refined pose does not fit, the whole window is searched.
        unsure = math.sqrt(max(prior_covariance[0, 0], prior_covariance[1, 1])) > 0.5 * (
            self._config.resolution_m
        )
        found = None if unsure else self._refine(prior)
        if found is None or not self._fits(*found[2:]):
            again = self._refine(self._search(prior))
            if found is None or again[2] > found[2]:
                found = again
        pose, information, share, residual = found
        ok = self._fits(share, residual)
        covariance = self._covariance(information, residual) if ok else np.array(prior_covariance)
        return PoseFix(scan.t_ns, pose, covariance, share, ok)

    def insert(self, scan: LidarScan, pose: FloatArray) -> None:
        """Enter a scan that ended at ``pose`` (3,); the trail is that of its match.

        ``new_surfaces_m`` (k, 2) then holds where, in map, cells became occupied by it, and
        ``new_share`` their share of all cells in which its beams ended.
        """
        if scan.t_ns != self._scan_t_ns:
            self._take(scan, np.array([scan.t_ns], np.int64), np.array([pose], np.float64))
        self.new_surfaces_m, self.new_share = np.empty((0, 2)), 0.0
        if len(self.points_m) == 0:
            return
        pose = np.array(pose, np.float64)
        self._grow_to_hold(pose)
        self._scans += 1
        config = self._config
        self.new_surfaces_m, self.new_share = trace_scan(
            self.points_m,
            self._origins,
            pose,
            *self.origin_m.tolist(),
            config.resolution_m,
            self._log_odds,
            self._hits,
            self._stamp,
            self._occupied,
            self._scans,
            config.hit_log_odds,
            config.miss_log_odds,
            config.max_log_odds,
            config.occupied_log_odds,
        )
        self._distance = self._likelihood = None

    def view(self, t_ns: int, goal: FloatArray) -> WorldView:
        """The map as a planner sees it."""
        box = _NOWHERE_M * np.array([-1.0, -1.0, 1.0, 1.0])
        occupied = self._occupied
        found = discs_of(occupied, self.origin_m, self.resolution_m)
        if occupied.size:
            size = self.resolution_m * np.array(occupied.shape[::-1])
            low = np.minimum(self.origin_m, goal - self._config.beyond_m)
            high = np.maximum(self.origin_m + size, goal + self._config.beyond_m)
            box = np.concatenate((low, high))
        return WorldView(
            t_ns, self.origin_m.copy(), self.resolution_m, self._distances(), found, box
        )

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

    def _refine(self, start: FloatArray) -> tuple[FloatArray, FloatArray, float, float]:
        return refine(
            self.points_m,
            start,
            self._hits,
            *self.origin_m.tolist(),
            self.resolution_m,
            self._config.grain_m,
            self._config.refine_steps,
        )

    def _search(self, prior: FloatArray) -> FloatArray:
        if self._likelihood is None:
            spread = self.resolution_m
            self._likelihood = np.exp(-0.5 * (self._distances() / spread) ** 2)
        points = self.points_m[:: max(1, len(self.points_m) // self._config.search_points)]
        pose, _ = correlate(
            np.ascontiguousarray(points),
            prior,
            self._offsets,
            self._likelihood,
            *self.origin_m.tolist(),
            self.resolution_m,
        )
        return pose

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

    def _distances(self) -> np.ndarray:
        """(rows, cols) float32, m, to the nearest surface; cached until the map changes."""
        if self._distance is None:
            occupied = self._occupied
            distance = np.full(occupied.shape, _NOWHERE_M, np.float32)
            rows, cols = np.nonzero(occupied)
            if len(rows):
                free = np.logical_not(occupied).view(np.uint8)
                _, labels = cv2.distanceTransformWithLabels(
                    free, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
                )
                hits = self._hits[rows, cols]
                places = np.zeros((len(rows) + 1, 2))
                places[labels[rows, cols]] = hits[:, :2] / np.maximum(hits[:, 2:], 1.0)
                surface_distance(labels, places, self.resolution_m, distance)
            distance.setflags(write=False)
            self._distance = distance
        return self._distance

    def _grow_to_hold(self, pose: FloatArray) -> None:
        """Make the grid hold all points of the scan, the robot, and a cell of margin."""
        margin = 2.0 * self.resolution_m
        x_min, y_min, x_max, y_max = placed_bounds(self.points_m, pose)
        low = np.array((min(x_min, pose[0] - 0.5) - margin, min(y_min, pose[1] - 0.5) - margin))
        high = np.array((max(x_max, pose[0] + 0.5) + margin, max(y_max, pose[1] + 0.5) + margin))
        if self._holds(low, high):
            return
        res, size = self.resolution_m, np.array(self._log_odds.shape[::-1])
        if not size.any():
            self.origin_m = np.floor(low / res) * res
        before = np.maximum(0, np.ceil((self.origin_m - low) / res / _CHUNK)).astype(int) * _CHUNK
        top = self.origin_m + size * res
        after = np.maximum(0, np.ceil((high - top) / res / _CHUNK)).astype(int) * _CHUNK
        pads = ((before[1], after[1]), (before[0], after[0]))
        self._log_odds = np.pad(self._log_odds, pads)
        self._stamp = np.pad(self._stamp, pads)
        self._occupied = np.pad(self._occupied, pads)
        self._hits = np.pad(self._hits, (*pads, (0, 0)))
        # Hit sums are taken from the grid's corner, which moves.
        shift = before * res
        self._hits[..., :2] += self._hits[..., 2:] * shift
        self.origin_m = self.origin_m - shift


    def _holds(self, low: FloatArray, high: FloatArray) -> bool:
        """Whether the grid reaches over the box from ``low`` to ``high``, (2,) each."""
        rows, cols = self._log_odds.shape
        (x0, y0), res = self.origin_m.tolist(), self.resolution_m
        return bool(
            x0 <= low[0]
            and y0 <= low[1]
            and high[0] <= x0 + cols * res
            and high[1] <= y0 + rows * res
        )


def _search_offsets(config: SlamConfig) -> FloatArray:
    """(n, 3) offsets of the correlative search, nearest first: half a cell, and a cell at 3 m."""
    step_xy, step_yaw = 0.5 * config.resolution_m, config.resolution_m / 3.0
    xy = step_xy * np.arange(-round(config.search_xy_m / step_xy), 1)
    yaw = step_yaw * np.arange(-round(config.search_yaw_rad / step_yaw), 1)
    xy, yaw = np.concatenate((xy, -xy[-2::-1])), np.concatenate((yaw, -yaw[-2::-1]))
    grid = np.stack(np.meshgrid(xy, xy, yaw, indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.hypot(grid[:, 0], grid[:, 1]) / config.search_xy_m
    size = size + np.abs(grid[:, 2]) / config.search_yaw_rad
    return np.ascontiguousarray(grid[np.argsort(size, kind="stable")])
