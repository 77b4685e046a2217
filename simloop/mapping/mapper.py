"""The mapper: scans and wheel odometry in, trajectory and map out.

A scan is matched to the submap that the scans before it made (front end); keyframes and what joins
them go into a graph, loop closures are looked for in older submaps, and the graph says where the
keyframes stand (back end). The front end's own frame stays smooth; the map's may jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.correlative import thinned
from simloop.ekf_model import inverse_3
from simloop.grid_map import GridMap
from simloop.mapping.closures import ClosureFinder, turned
from simloop.mapping.pose_graph import Edge, PoseGraph
from simloop.mapping.settings import MappingConfig
from simloop.mapping.submap import Submap
from simloop.messages import FloatArray
from simloop.profiler import NullProfiler, Stopwatch
from simloop.se2 import between, compose, wrap_angle

STAGES = ("match", "insert", "closures", "graph")

_NEXT_TO_NOTHING = 1e-3 * np.eye(3)
_FIRST_POINTS = 10  # a scan with fewer hits is not matched
_LOST_KEYFRAMES = 3  # in a row that fit nothing: a new submap is begun
_WIDEST_M, _WIDEST_RAD = 1.0, 0.5
_BETTER = 0.05  # by which a fit far from where odometry has it must be better
_SURPRISE = 9.0  # squared Mahalanobis distance


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    pose: FloatArray
    information: FloatArray
    score: float
    residual: float


class GraphMapper:
    """Scans in the order of their times.

    ``pose`` (3,): base_link in map, now. ``unmatched``: scans that fitted nothing.
    """

    def __init__(
        self, config: MappingConfig | None = None, profiler: Stopwatch | None = None
    ) -> None:
        stages = profiler if profiler is not None else NullProfiler()
        self._time = {name: stages.stage(name) for name in STAGES}
        self._config = config if config is not None else MappingConfig()
        self.graph = PoseGraph()
        self.closures = ClosureFinder(self._config, self.graph)
        self.submaps: list[Submap] = []
        self.unmatched = 0
        self._active: list[Submap] = []
        self._odom: FloatArray | None = None
        self._local = np.zeros(3)
        self._covariance = np.zeros((3, 3))
        self._points: list[FloatArray] = []
        self._origins: list[FloatArray] = []
        self._locals: list[FloatArray] = []
        self._trail: list[tuple[int, FloatArray]] = []
        self._lost = 0
        self._submap_ended = False

    @property
    def pose(self) -> FloatArray:
        """(3,) base_link in map."""
        keyframe, offset = self._trail[-1]
        return compose(self.graph.poses[keyframe], offset)

    @property
    def keyframe_points(self) -> list[FloatArray]:
        """Each keyframe's hits, (n, 2) in its base_link."""
        return self._points

    def trajectory(self) -> FloatArray:
        """(n, 3) base_link in map at each scan, by what is known by now."""
        return np.array([compose(self.graph.poses[k], offset) for k, offset in self._trail])

    def step(self, points: FloatArray, origins: FloatArray, odom: FloatArray) -> bool:
        """Take a scan, points and origins (n, 2) in base_link, at raw odometry ``odom`` (3,).

        True if it became a keyframe.
        """
        if self._odom is None:
            self._odom = np.array(odom, np.float64)
            self._keyframe(points, origins, True)
            return True
        motion = between(self._odom, odom)
        self._odom = np.array(odom, np.float64)
        self._predict(motion)
        with self._time["match"]:
            matched = self._match(points, motion)
        self.unmatched += not matched
        off = between(self._locals[-1], self._local)
        far = math.hypot(off[0], off[1]) >= self._config.keyframe_m
        if far or abs(off[2]) >= self._config.keyframe_rad:
            self._keyframe(points, origins, matched)
            return True
        self._trail.append((len(self._locals) - 1, off))
        return False

    def finish(self) -> None:
        """Put all keyframes where, by all that has been found, they stand."""
        if self.graph.has_news:
            with self._time["graph"]:
                self.graph.optimise()

    def map(self) -> GridMap:
        """The map made anew from all keyframes where they stand by now."""
        grid = GridMap(self._config.grid)
        for points, origins, pose in zip(
            self._points, self._origins, self.graph.poses, strict=True
        ):
            grid.insert(points, origins, pose)
        return grid

    def _predict(self, motion: FloatArray) -> None:
        config = self._config
        way, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
        along = (
            config.odometry_xy_m
            + config.odometry_xy_per_m * way
            + config.odometry_xy_per_rad * turn
        )
        yaw = (
            config.odometry_yaw_rad
            + config.odometry_yaw_per_m * way
            + config.odometry_yaw_per_rad * turn
        )
        moved = compose(self._local, motion)
        dx, dy = moved[:2] - self._local[:2]
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        self._covariance = jacobian @ self._covariance @ jacobian.T
        self._covariance += np.diag(np.square([along, along, yaw]))
        self._local = moved

    def _match(self, points: FloatArray, motion: FloatArray) -> bool:
        """Correct the pose by where the scan fits the older active submap; False: nowhere.

        motion: (3,) since the last scan by odometry, which may be wrong altogether
        (wheels that spin, counters that take backwards for forwards): where the scan
        does not fit about where odometry has it, it is looked for as far as that on either side.
        """
        if len(points) < _FIRST_POINTS:
            return False
        spread = np.sqrt(np.diag(self._covariance))
        near = np.array([3.0 * max(spread[0], spread[1]), 3.0 * spread[2]])
        few = thinned(points, self._config.grid.resolution_m, self._config.search_points)
        found = self._fit(points, few, near)
        if found is None or found.score < self._config.good_score:
            step, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
            far = self._fit(points, few, near + np.array([2.0 * step + 0.1, turn + 0.1]))
            if far is not None and (found is None or far.score > found.score + _BETTER):
                found = far
        if found is None:
            return False
        self._correct_by(found)
        return True

    def _fit(self, points: FloatArray, few: FloatArray, window: FloatArray) -> _Fit | None:
        """The best fit within ``window`` (2,) m, rad about the pose, or None."""
        config, grid = self._config, self._active[0].grid
        window = np.minimum(window, (_WIDEST_M, _WIDEST_RAD))
        found, score = grid.search(few, self._local, window, 0.1 / window**2)
        if score < 0.0:
            return None
        pose, information, share, residual = grid.refine(points, found)
        if share < config.least_share or residual > config.grid.most_residual:
            return None
        if math.dist(pose[:2], found[:2]) > 3.0 * config.grid.resolution_m:
            return None
        return _Fit(pose, information, score, residual)

    def _correct_by(self, fit: _Fit) -> None:
        """Weigh the fit against what odometry says (a Kalman update)."""
        config = self._config
        noise = inverse_3(fit.information + _NEXT_TO_NOTHING) * max(fit.residual, 0.1)
        noise += np.diag(np.square([config.fit_std_xy_m] * 2 + [config.fit_std_yaw_rad]))
        off = fit.pose - self._local
        off[2] = wrap_angle(off[2])
        weight = inverse_3(self._covariance + noise)
        surprise = float(off @ weight @ off)
        if surprise > _SURPRISE:  # odometry was not what it is thought to be
            self._covariance *= surprise / _SURPRISE
            weight = inverse_3(self._covariance + noise)
        gain = self._covariance @ weight
        self._local = self._local + gain @ off
        self._local[2] = wrap_angle(self._local[2])
        covariance = (np.eye(3) - gain) @ self._covariance
        self._covariance = 0.5 * (covariance + covariance.T)

    def _keyframe(self, points: FloatArray, origins: FloatArray, matched: bool) -> None:
        self._lost = 0 if matched else self._lost + 1
        self._points.append(points)
        self._origins.append(origins)
        number = self._join(self._local)
        self._locals.append(self._local.copy())
        self._trail.append((number, np.zeros(3)))
        if self._lost >= _LOST_KEYFRAMES:
            self._end_submaps()
        with self._time["insert"]:
            self._enter(number, points, origins)
        if number % self._config.closure_every == 0:
            with self._time["closures"]:
                closures = self.closures.look(self.submaps, self._points, self._locals)
            for edge in closures:
                self.graph.add_edge(edge)
            if len(closures) > 1 or self._submap_ended:
                self._submap_ended = False
                self.finish()

    def _join(self, local: FloatArray) -> int:
        """Put a keyframe into the graph, where the front end has it."""
        if not self._locals:
            return self.graph.add_pose(local)
        before = len(self._locals) - 1
        way = between(self._locals[before], local)
        number = self.graph.add_pose(compose(self.graph.poses[before], way))
        pairs = [(before, self._locals[before], way)]
        submap = self._active[0]
        if submap.anchor != before:
            pairs.append((submap.anchor, submap.anchor_pose, between(submap.anchor_pose, local)))
        config = self._config
        floor = np.diag(np.square([config.match_std_xy_m] * 2 + [config.match_std_yaw_rad]))
        for first, pose, step in pairs:
            covariance = turned(self._covariance, -pose[2]) + floor
            self.graph.add_edge(Edge(first, number, step, covariance, False))
        return number

    def _enter(self, number: int, points: FloatArray, origins: FloatArray) -> None:
        half = self._config.submap_keyframes // 2
        if not self._active or len(self._active[-1].keyframes) >= half:
            self._active.append(Submap(self._config.grid, number, self._local))
            self.submaps.append(self._active[-1])
        if len(self._active) > 2:
            self._active.pop(0).finish()
            self._submap_ended = True
        for submap in self._active:
            submap.add(number, points, origins, self._local)

    def _end_submaps(self) -> None:
        for submap in self._active:
            submap.finish()
        self._active = []
        self._covariance = np.zeros((3, 3))
        self._submap_ended = True
