"""Loop closures: where the last few scans fit a submap from long ago, and whether to believe it.

What is looked for is a cluster, the scans of the last few keyframes as one: a single one, of a
corridor say, fits in many places. The search covers what the graph leaves open (three standard
deviations); a find must meet surfaces where it meets anything known, and have no rival elsewhere in
the window; one from a wide window must be borne out by a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.geometry.se2 import between, compose, transform_points, wrap_angle
from simloop.graph_slam.pose_graph import Edge, PoseGraph, turned
from simloop.graph_slam.scan_tracker import match_covariance
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import Submap, meetings
from simloop.mapping.correlative import thinned
from simloop.messages import FloatArray

_THIN_M = 0.1
_RIVAL_M, _RIVAL_RAD = 0.5, 0.35
_AGREE_M, _AGREE_RAD = 0.3, 0.06
_MOST_CANDIDATES = 3
_FORGET = 40  # keyframes after which a closure that nothing bore out is dropped


@dataclass(frozen=True, slots=True, eq=False)
class _Find:
    edge: Edge
    sure: bool


class ClosureFinder:
    """Looks for closures of the newest keyframe.

    points: each keyframe's hits (n, 2) in base_link; local: its pose (3,) in the front end's frame.
    """

    def __init__(self, config: MappingConfig, graph: PoseGraph) -> None:
        self._config, self._graph = config, graph
        self._waiting: list[Edge] = []
        self.tried = 0

    def look(
        self, submaps: list[Submap], points: list[FloatArray], local: list[FloatArray]
    ) -> list[Edge]:
        """Closures to believe, of the newest keyframe and of those that it bears out."""
        newest = len(local) - 1
        first = max(0, newest - self._config.cluster_keyframes + 1)
        old = [s for s in submaps if s.finished and s.keyframes[-1] < first]
        if not old:
            return []
        cluster = cluster_of(points[first:], local[first:], self._config.cluster_points)
        if len(cluster) < 0.1 * self._config.cluster_points:
            return []
        place, yaw = self._graph.uncertainty(newest)
        believed: list[Edge] = []
        for submap in self._candidates(old, newest, place):
            self.tried += 1
            window = np.array([3.0 * place[submap.anchor], 3.0 * yaw[submap.anchor]])
            found = self._match(submap, newest, cluster, window)
            if found is not None:
                believed += self._weigh(found, local)
        return believed

    def _candidates(self, old: list[Submap], newest: int, place: FloatArray) -> list[Submap]:
        """Submaps that the newest keyframe may stand in, nearest first."""
        poses = np.array(self._graph.poses)[:, :2]
        ranked = []
        for submap in old:
            if not math.isfinite(place[submap.anchor]):
                continue
            reach = 2.0 + min(3.0 * place[submap.anchor], self._config.most_window_m)
            off = float(np.hypot(*(poses[submap.keyframes] - poses[newest]).T).min())
            if off <= reach:
                ranked.append((off, submap.anchor, submap))
        return [submap for _, _, submap in sorted(ranked, key=lambda r: r[:2])[:_MOST_CANDIDATES]]

    def _match(
        self, submap: Submap, newest: int, cluster: FloatArray, window: FloatArray
    ) -> _Find | None:
        config, poses = self._config, self._graph.poses
        predicted = compose(submap.anchor_pose, between(poses[submap.anchor], poses[newest]))
        window = np.minimum(
            window + np.array([2.0 * config.grid.resolution_m, 0.03]),
            (config.most_window_m, config.most_window_rad),
        )
        weights = 0.05 / window**2
        found, score = submap.grid.search(
            cluster, predicted, window, weights, config.closure_least_score
        )
        if score < 0.0:
            return None
        pose, information, _, residual = submap.grid.refine(cluster, found)
        moved = math.dist(pose[:2], found[:2])
        if residual > config.grid.most_residual or moved > 3.0 * config.grid.resolution_m:
            return None
        agreement, overlap = meetings(submap.grid, cluster, pose)
        if agreement < config.agreement or overlap < config.least_overlap:
            return None
        if window[0] > _RIVAL_M:
            but = np.array([[*found, _RIVAL_M, _RIVAL_RAD]])
            rival = config.rival_score * score
            if submap.grid.search(cluster, predicted, window, weights, rival, but)[1] >= 0.0:
                return None
        covariance = self._covariance(submap, pose, information, residual)
        edge = Edge(submap.anchor, newest, between(submap.anchor_pose, pose), covariance, True)
        return _Find(edge, bool(window[0] <= config.sure_window_m))

    def _covariance(
        self, submap: Submap, pose: FloatArray, information: FloatArray, residual: float
    ) -> FloatArray:
        covariance = match_covariance(information, residual, self._config)
        return turned(covariance, -submap.anchor_pose[2])

    def _weigh(self, find: _Find, local: list[FloatArray]) -> list[Edge]:
        """A sure find at once; another once a second one says the same."""
        if find.sure:
            return [find.edge]
        newest = find.edge.second
        self._waiting = [e for e in self._waiting if newest - e.second <= _FORGET]
        poses = self._graph.poses
        place = compose(poses[find.edge.first], find.edge.pose)
        for other in self._waiting:
            if other.second == newest:
                continue
            way = between(local[other.second], local[newest])
            said = compose(compose(poses[other.first], other.pose), way)
            near = math.dist(place[:2], said[:2]) <= _AGREE_M
            if near and abs(wrap_angle(place[2] - said[2])) <= _AGREE_RAD:
                self._waiting.remove(other)
                return [other, find.edge]
        self._waiting.append(find.edge)
        return []


def cluster_of(points: list[FloatArray], poses: list[FloatArray], most: int) -> FloatArray:
    """(n, 2) hits of scans taken at ``poses``, as one, in base_link at the last; about ``most``."""
    parts = [
        transform_points(between(poses[-1], pose), some)
        for pose, some in zip(reversed(poses), reversed(points), strict=True)
    ]
    return thinned(np.concatenate(parts), _THIN_M, most)
