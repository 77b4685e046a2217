"""Make a trajectory and a map from scans and wheel odometry.

The front end matches each scan to a submap made of the scans before it. Its frame is smooth: the
pose never jumps in it. The back end keeps a graph of keyframes, searches old submaps for loop
closures, and optimises the graph. The pose in map follows the graph, and jumps when the graph
changes.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.common.profiler import NullProfiler, Stopwatch
from simloop.geometry.se2 import between, compose
from simloop.graph_slam.closures import ClosureFinder
from simloop.graph_slam.pose_graph import Edge, PoseGraph, rotated_covariance
from simloop.graph_slam.scan_fit import LEAST_POINTS
from simloop.graph_slam.scan_tracker import ScanTracker
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import Submap
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

STAGES = ("match", "insert", "closures", "graph")
"""Names of the stages that the profiler measures."""

_LOST_SCANS = 5  # a scan becomes a keyframe after this many that did not fit in a row
_LOST_KEYFRAMES = 3  # a new submap starts after this many unmatched keyframes in a row


class GraphMapper:
    """Mapper that takes one scan after the other, in the order of their times.

    Attributes:
        graph: the keyframes and the edges between them.
        closures: the search for loop closures.
        submaps: all submaps, oldest first.
        unmatched: number of scans that fitted nowhere.
    """

    def __init__(
        self,
        config: MappingConfig | None = None,
        profiler: Stopwatch | None = None,
        start: FloatArray | None = None,
    ) -> None:
        """Make an empty map.

        Args:
            config: settings; None for the defaults.
            profiler: measures the ``STAGES``; None for no measurement.
            start: (3,) base_link in map at the first scan; None for the origin.
        """
        stages = profiler if profiler is not None else NullProfiler()
        self._time = {name: stages.stage(name) for name in STAGES}
        self._config = config if config is not None else MappingConfig()
        self.graph = PoseGraph()
        self.closures = ClosureFinder(self._config, self.graph)
        self.submaps: list[Submap] = []
        self.unmatched = 0
        self._active: list[Submap] = []
        self._odom: FloatArray | None = None
        self._tracker = ScanTracker(self._config)
        if start is not None:
            self._tracker.pose = np.array(start, np.float64)
        self._points: list[FloatArray] = []
        self._origins: list[FloatArray] = []
        self._locals: list[FloatArray] = []
        self._trail: list[tuple[int, FloatArray]] = []
        self._lost = 0
        self._fitted, self._missed = False, 0
        self._submap_ended = False
        self._ways_m: list[float] = []  # how far each keyframe is along the way
        self._searched_m = 0.0  # how far the last search for closures was

    @property
    def pose(self) -> FloatArray:
        """(3,) present pose of base_link in map."""
        keyframe, offset = self._trail[-1]
        return compose(self.graph.poses[keyframe], offset)

    @property
    def keyframe_points(self) -> list[FloatArray]:
        """Hits (n, 2) of each keyframe in its base_link, m."""
        return self._points

    def trajectory(self) -> FloatArray:
        """Return the pose at every scan, by the present state of the graph.

        Returns:
            (n, 3) base_link in map.
        """
        return np.array([compose(self.graph.poses[k], offset) for k, offset in self._trail])

    def step(self, points: FloatArray, origins: FloatArray, odom: FloatArray) -> bool:
        """Process a scan.

        Args:
            points: (n, 2) hits in base_link, m.
            origins: (n, 2) origin of each beam in base_link, m.
            odom: (3,) raw odometry, odom_from_base.

        Returns:
            Whether the scan became a keyframe.
        """
        if self._odom is None:
            self._odom = np.array(odom, np.float64)
            self._keyframe(points, origins, True)
            return True
        motion = between(self._odom, odom)
        self._odom = np.array(odom, np.float64)
        self._tracker.predict(motion)
        with self._time["match"]:
            matched = self._tracker.match(self._active[0].grid, points, motion)
        begins, empty = self._begins(points, matched)
        self.unmatched += not matched and not empty
        off = between(self._locals[-1], self._tracker.pose)
        far = math.hypot(off[0], off[1]) >= self._config.keyframe_m
        if begins or far or abs(off[2]) >= self._config.keyframe_rad:
            self._keyframe(points, origins, matched or empty)
            return True
        self._trail.append((len(self._locals) - 1, off))
        return False

    def finish(self) -> None:
        """Search once more where no closure was found, and optimise the graph.

        The graph knows more now than when the robot was there, and the last submaps are complete.
        """
        self._optimise()
        for submap in self._active:
            self._complete(submap)
        for number in self._unclosed():
            with self._time["closures"]:
                for edge in self.closures.find(self.submaps, self._points, self._locals, number):
                    self.graph.add_edge(edge)
        self._optimise()

    def _optimise(self) -> None:
        """Optimise the graph if there are new closures."""
        if self.graph.has_new_closures:
            with self._time["graph"]:
                self.graph.optimise()

    def _unclosed(self) -> list[int]:
        """Return keyframes, `closure_m` apart, without a closure of them or their neighbours."""
        near = self._config.cluster_keyframes // 2
        closed = {
            k
            for edge in self.graph.edges
            if edge.closure
            for k in range(edge.second - near, edge.second + near + 1)
        }
        chosen, last_m = [], 0.0
        for number, way_m in enumerate(self._ways_m):
            if way_m - last_m >= self._config.closure_m:
                last_m = way_m
                if number not in closed:
                    chosen.append(number)
        return chosen

    def map(self) -> GridMap:
        """Build the map from all keyframes at their present poses.

        Returns:
            The map.
        """
        grid = GridMap(self._config.grid)
        for points, origins, pose in zip(
            self._points, self._origins, self.graph.poses, strict=True
        ):
            grid.insert(points, origins, pose)
        return grid

    def _begins(self, points: FloatArray, matched: bool) -> tuple[bool, bool]:
        """Return whether a scan begins the map anew, and whether the map is still empty.

        The first scans of a log may be blind, or dazzled. Then no later scan fits, and a robot that
        stands would never enter one.
        """
        sees = len(points) >= LEAST_POINTS
        self._fitted |= matched
        self._missed = 0 if matched else self._missed + sees
        begins = sees and (not self._fitted or self._missed >= _LOST_SCANS)
        return begins, begins and not self._active[0].grid.occupied.any()

    def _keyframe(self, points: FloatArray, origins: FloatArray, matched: bool) -> None:
        """Add a keyframe to graph and submaps, and search for closures at some keyframes."""
        self._lost = 0 if matched else self._lost + 1
        self._missed = 0
        self._points.append(points)
        self._origins.append(origins)
        number = self._join(self._tracker.pose)
        self._ways_m.append(
            self._ways_m[-1] + _way(between(self._locals[-1], self._tracker.pose))
            if self._locals
            else 0.0
        )
        self._locals.append(self._tracker.pose.copy())
        self._trail.append((number, np.zeros(3)))
        if self._lost >= _LOST_KEYFRAMES:
            self._end_submaps()
        with self._time["insert"]:
            self._enter(number, points, origins)
        if self._ways_m[number] - self._searched_m >= self._config.closure_m:
            self._searched_m = self._ways_m[number]
            with self._time["closures"]:
                closures = self.closures.find(self.submaps, self._points, self._locals, number)
            for edge in closures:
                self.graph.add_edge(edge)
            # Optimisation is slow: do it only after a submap has ended, or for several closures.
            if len(closures) > 1 or self._submap_ended:
                self._submap_ended = False
                self._optimise()

    def _join(self, local: FloatArray) -> int:
        """Add a keyframe to the graph and return its number.

        One edge joins it to the anchor of the submap to which it was matched. A second edge, to
        the previous keyframe, would count the same match twice.
        """
        if not self._locals:
            return self.graph.add_pose(local)
        submap = self._active[0]
        step = between(submap.anchor_pose, local)
        number = self.graph.add_pose(compose(self.graph.poses[submap.anchor], step))
        covariance = rotated_covariance(self._tracker.covariance, -submap.anchor_pose[2])
        self.graph.add_edge(Edge(submap.anchor, number, step, covariance, False))
        return number

    def _enter(self, number: int, points: FloatArray, origins: FloatArray) -> None:
        """Add a keyframe to the active submaps, and start and finish submaps when due."""
        # Two overlapping submaps are active. The newer one is half full when the older one is
        # finished; from then on, scans are matched to the newer one.
        half_m = 0.5 * self._config.submap_m
        if (
            not self._active
            or self._ways_m[number] - self._ways_m[self._active[-1].anchor] >= half_m
        ):
            self._active.append(Submap(self._config.grid, number, self._tracker.pose))
            self.submaps.append(self._active[-1])
        if len(self._active) > 2:
            self._complete(self._active.pop(0))
            self._submap_ended = True
        for submap in self._active:
            submap.add(number, points, origins, self._tracker.pose)

    def _complete(self, submap: Submap) -> None:
        """Finish a submap. From then on it is searched for closures."""
        submap.finish()
        self.closures.hold(submap)

    def _end_submaps(self) -> None:
        """Finish the active submaps, because the scans no longer fit them."""
        for submap in self._active:
            self._complete(submap)
        self._active = []
        # The next submap starts at the present pose, which has no error relative to itself.
        self._tracker.covariance = np.zeros((3, 3))
        self._submap_ended = True


def _way(step: FloatArray) -> float:
    """Return how far a step (3,) goes and turns, m; a radian counts as a metre."""
    return math.hypot(step[0], step[1]) + abs(float(step[2]))
