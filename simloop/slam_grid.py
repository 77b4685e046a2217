"""Grid SLAM: matches each scan to the map it has made so far, and maps what it saw.

    match(scan, trail, prior) -> PoseFix      insert(scan, pose)      view(goal) -> WorldView
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simloop.config import SlamConfig, VehicleConfig
from simloop.grid_kernels import Cells, Frame, Odds, insert_scan, make_cells
from simloop.grid_view import distance_field, obstacle_discs, planning_bounds
from simloop.messages import FloatArray, LidarScan, PoseFix, WorldView
from simloop.scan_match import deskew, extent, refine, score_table, search, transform_beams
from simloop.se2 import wrap_angle

_CHUNK = 64  # the grid grows by whole chunks of cells, to the left and right, below and above
_MOST_CELLS = 4096  # a side; what lies further out is not mapped
_VAGUE = np.array([1.0, 1.0, 1.0])  # variance of what a scan does not tell, m^2, m^2, rad^2


class GridSlam:
    """An occupancy grid that grows, and the matcher that keeps the robot in it.

    config: the grid's and matcher's settings; vehicle: the robot's body; base_from_laser: (3,)
    x, y, yaw of the laser in base_link. The map frame is the frame of the poses given.
    """

    def __init__(
        self,
        config: SlamConfig,
        vehicle: VehicleConfig,
        base_from_laser: FloatArray | None = None,
    ) -> None:
        mount = np.zeros(3) if base_from_laser is None else base_from_laser
        self._config, self._vehicle = config, vehicle
        self._mount = (float(mount[0]), float(mount[1]), float(mount[2]))
        self._odds = Odds(
            config.hit_log_odds,
            config.miss_log_odds,
            config.max_log_odds,
            config.occupied_log_odds,
            config.most_hits,
            config.range_std_m,
            0.7 * config.resolution_m,
            0.5 * config.resolution_m,
        )
        self._frame = Frame(0.0, 0.0, config.resolution_m)
        self._cells = make_cells(0, 0)
        self._means = np.empty((0, 2))
        self._inserted = 0
        self._pose = np.zeros(3)
        self._beams, self._fate = np.zeros((0, 4)), np.zeros(0, np.uint8)
        self._points = np.zeros((0, 2))
        self._hits = 0
        self._deskewed_t_ns: int | None = None
        self._normal_eq, self._system = np.zeros((3, 7)), np.zeros((3, 3))
        self._view: WorldView | None = None

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """(rows, cols) [iy, ix], a read-only view; 0 is unknown."""
        view = self._cells.log_odds.view()
        view.setflags(write=False)
        return view

    @property
    def origin_m(self) -> FloatArray:
        """(2,) the lower left corner of cell (0, 0) in map, m."""
        return np.array(self._frame[:2])

    @property
    def resolution_m(self) -> float:
        """Side of a cell, m."""
        return self._config.resolution_m

    @property
    def points_m(self) -> FloatArray:
        """(n, 2) the last scan's hits, deskewed, in base_link at the scan's end; read-only."""
        points = self._points[: self._hits]
        points.setflags(write=False)
        return points

    def match(
        self,
        scan: LidarScan,
        trail_t_ns: NDArray[np.int64],
        trail_poses: FloatArray,
        prior_pose: FloatArray,
        prior_covariance: FloatArray,
    ) -> PoseFix:
        """Find the pose of base_link in map at the scan's end.

        trail_t_ns (K,), trail_poses (K, 3): where the estimator has base_link during the sweep,
        times strictly rising, the last the scan's end. prior_pose (3,), prior_covariance (3, 3):
        the estimate at the scan's end; its covariance only sets how far to search, so that the
        fix is independent of it. The fix is not ``ok`` where the map is empty or the overlap
        poor; its pose is then the prior. Raises ValueError for a trail or prior that is not finite.
        """
        prior = np.array(prior_pose, dtype=np.float64)
        self._deskew(scan, trail_t_ns, trail_poses)
        if not (np.isfinite(prior).all() and np.isfinite(prior_covariance).all()):
            raise ValueError("the prior of a scan match must be finite")
        if self._inserted == 0 or self._hits < self._config.min_matches:
            return self._no_fix(scan.t_ns, prior, prior_covariance, 0.0)
        start = (float(prior[0]), float(prior[1]), float(prior[2]))
        far, far_yaw = self._window(prior_covariance)
        best = self._refine(start)
        if self._is_doubtful(best, prior, prior_covariance):
            table = np.empty(self._cells.weight.shape, np.uint8)
            score_table(self._cells, table)
            window = (far, self._config.resolution_m, far_yaw, 0.02)
            points = self._points[: self._hits : 2]
            again = self._refine(search(table, self._frame, points, prior, window))
            if _support(again) > _support(best):
                best = again
        score = best[3] / self._hits
        away = math.hypot(best[0] - prior[0], best[1] - prior[1])
        turned = abs(wrap_angle(best[2] - prior[2]))
        trusted = (
            best[3] >= self._config.min_matches
            and score >= self._config.min_overlap
            and away <= 1.5 * far
            and turned <= 1.5 * far_yaw
        )
        if not trusted:
            return self._no_fix(scan.t_ns, prior, prior_covariance, score)
        return PoseFix(scan.t_ns, np.array(best[:3]), self._covariance(best), score, True)

    def insert(
        self,
        scan: LidarScan,
        pose: FloatArray,
        trail_t_ns: NDArray[np.int64] | None = None,
        trail_poses: FloatArray | None = None,
    ) -> None:
        """Map a scan, seen from ``pose`` (3,) of base_link in map at its end.

        The points deskewed by the last match of this scan are used; where there was none, the
        trail, if given, deskews them, else the robot is taken to have stood still.
        """
        if self._deskewed_t_ns != scan.t_ns:
            times = np.array([scan.t_ns], np.int64) if trail_t_ns is None else trail_t_ns
            self._deskew(scan, times, np.zeros((1, 3)) if trail_poses is None else trail_poses)
        pose = np.array(pose, dtype=np.float64)
        if not np.isfinite(pose).all():
            raise ValueError("a scan cannot be mapped at a pose that is not finite")
        self._inserted += 1
        self._pose = pose
        self._grow(pose)
        insert_scan(
            self._cells,
            self._frame,
            self._odds,
            pose,
            self._beams,
            self._fate,
            self._config.free_range_m,
            self._inserted,
        )
        self._view = None

    def view(self, t_ns: int, goal: FloatArray) -> WorldView:
        """What is known of the world: unknown is free. goal: (2,) in map, always inside bounds."""
        cached = self._view
        goal = np.array(goal, dtype=np.float64)[:2]
        if cached is not None and cached.t_ns == t_ns and np.array_equal(goal, self._goal):
            return cached
        cells, frame = self._cells, self._frame
        if cached is None:
            distance, count = distance_field(cells, frame, self._means)
            points = self._means[:count]
            discs = obstacle_discs(cells, frame, points) if count else np.zeros((0, 3))
        else:
            distance, discs = cached.distance_m, cached.discs_xyr_m
            points = self._means[cells.weight > 0.0]
        ends = np.stack((goal, self._pose[:2]))
        bounds = planning_bounds(points, frame.resolution, ends, self._config.bounds_margin_m)
        self._goal = goal
        self._view = WorldView(
            t_ns, self.origin_m, frame.resolution, distance, discs, bounds
        )
        return self._view

    def _deskew(
        self, scan: LidarScan, trail_t_ns: NDArray[np.int64], trail_poses: FloatArray
    ) -> None:
        count = scan.angles_rad.shape[0]
        if self._fate.shape[0] != count:
            self._beams, self._fate = np.zeros((count, 4)), np.zeros(count, np.uint8)
        poses = np.ascontiguousarray(trail_poses, dtype=np.float64)
        if len(poses) == 0 or not np.isfinite(poses).all():
            raise ValueError("the trail of a scan must hold at least one pose, all finite")
        deskew(
            scan.angles_rad,
            scan.ranges_m,
            scan.t_ns - scan.age_ns,
            (scan.range_min_m, scan.range_max_m),
            np.ascontiguousarray(trail_t_ns, dtype=np.int64),
            poses,
            self._mount,
            self._beams,
            self._fate,
        )
        self._points = np.empty((count, 2))
        self._hits = transform_beams(self._beams, self._fate, self._points)
        self._deskewed_t_ns = scan.t_ns

    def _window(self, covariance: FloatArray) -> tuple[float, float]:
        """Half-widths of the search, m and rad: the set ones, or three sigma where that is more."""
        config = self._config
        spread = 3.0 * math.sqrt(max(covariance[0, 0], covariance[1, 1], 0.0))
        turn = 3.0 * math.sqrt(max(covariance[2, 2], 0.0))
        return (
            min(max(config.search_xy_m, spread), 4.0 * config.search_xy_m),
            min(max(config.search_yaw_rad, turn), 4.0 * config.search_yaw_rad),
        )

    def _refine(self, start: tuple[float, float, float]) -> tuple[float, ...]:
        points = self._points[: self._hits]
        return refine(
            self._cells, self._frame, self._odds, points, start, self._normal_eq, self._system
        )

    def _is_doubtful(
        self, best: tuple[float, ...], prior: FloatArray, covariance: FloatArray
    ) -> bool:
        """Whether a refinement from the prior needs the search to confirm or replace it."""
        config = self._config
        spread = 3.0 * math.sqrt(max(covariance[0, 0], covariance[1, 1], 0.0))
        moved = math.hypot(best[0] - prior[0], best[1] - prior[1])
        turned = abs(wrap_angle(best[2] - prior[2]))
        return (
            spread > config.search_xy_m
            or moved > config.resolution_m
            or turned > 0.5 * config.search_yaw_rad
            or _support(best) < config.sure_support * self._hits
        )

    def _covariance(self, best: tuple[float, ...]) -> FloatArray:
        """(3, 3) of a refined pose: noise over information, and what all matches share.

        Information that only the normals' own errors pretend to is taken off, so that along a
        corridor little or none is left; there the variance is `_VAGUE`'s.
        """
        _, _, _, _, weights, squares = best
        config = self._config
        variance = max(config.range_std_m**2, squares / max(weights - 3.0, 1.0))
        information = (self._normal_eq[:, :3] - self._normal_eq[:, 4:]) / variance
        values, vectors = np.linalg.eigh(information)
        spread = 1.0 / (np.maximum(values, 0.0) + 1.0 / _VAGUE)
        covariance = (vectors * spread) @ vectors.T
        shared = (config.match_std_xy_m**2, config.match_std_xy_m**2, config.match_std_yaw_rad**2)
        return 0.5 * (covariance + covariance.T) + np.diag(shared)

    def _no_fix(
        self, t_ns: int, prior: FloatArray, covariance: FloatArray, score: float
    ) -> PoseFix:
        return PoseFix(t_ns, prior, np.array(covariance, dtype=np.float64), score, False)

    def _grow(self, pose: FloatArray) -> None:
        """Make room for the last scan, with a margin in which clearances are still right."""
        box = np.array([pose[0], pose[1], pose[0], pose[1]])
        extent(self._beams, self._fate, pose, box)
        step = self._config.resolution_m * _CHUNK
        margin = self._config.grid_margin_m
        low = np.floor((box[:2] - margin) / step).astype(int)
        high = np.ceil((box[2:] + margin) / step).astype(int)
        rows, cols = self._cells.weight.shape
        if rows:
            old = np.round(np.array(self._frame[:2]) / step).astype(int)
            low, high = np.minimum(low, old), np.maximum(high, old + (cols // _CHUNK, rows // _CHUNK))
            if np.array_equal(low, old) and np.array_equal(
                high, old + (cols // _CHUNK, rows // _CHUNK)
            ):
                return
        size = (high - low) * _CHUNK
        if rows and size.max() > _MOST_CELLS:
            return
        cells = make_cells(int(size[1]), int(size[0]))
        if rows:
            x, y = (old - low) * _CHUNK
            for new, layer in zip(cells, self._cells, strict=True):
                new[y : y + rows, x : x + cols] = layer
        self._cells = cells
        self._frame = Frame(float(low[0] * step), float(low[1] * step), self._frame.resolution)
        self._means = np.empty((cells.weight.size, 2))


def _support(best: tuple[float, ...]) -> float:
    """How much of a scan a refinement explains: the sum of its robust weights."""
    return best[4]
