"""Find loop closures: places where the last few scans fit an old submap.

The scans of the last few keyframes are matched together, as one cluster, because a single scan
fits in many places, for instance in a corridor. The half width of the search window is three
standard deviations of the pose in the graph. A match is accepted if

- most of its points that lie in known cells lie on surfaces,
- no other place in the window fits nearly as well, and
- the window was small, or a second match confirms it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.geometry.se2 import between, compose, transform_points, wrap_angle
from simloop.graph_slam.pose_graph import Edge, PoseGraph, rotated_covariance
from simloop.graph_slam.scan_fit import match_covariance
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import Submap, meetings
from simloop.mapping.correlative import thinned
from simloop.messages import FloatArray

_THIN_M = 0.1  # at most one point of a cluster is kept in each square of this side
_RIVAL_M, _RIVAL_RAD = 0.5, 0.35  # two matches farther apart than this are different places
_AGREE_M, _AGREE_RAD = 0.3, 0.06  # two matches that differ by less confirm each other
_MOST_CANDIDATES = 3  # most submaps that are searched for one keyframe
_MOST_GRIDS = 8  # so many finished submaps keep their grids
_FORGET_KEYFRAMES = 40  # an unconfirmed match is dropped after this many keyframes
# Cluster and submap were joined along metres of the way, and are bent: their match is not better
# known than this, however well it fits. Deviations of x, y, m, and yaw, rad.
_BENT = np.diag(np.square([0.05, 0.05, 0.01]))


@dataclass(frozen=True, slots=True, eq=False)
class _Match:
    """A closure that was found. If ``sure``, it needs no second match to confirm it."""

    edge: Edge
    sure: bool


class ClosureFinder:
    """Search for the newest keyframe in old submaps.

    Attributes:
        tried: number of submaps searched so far.
    """

    def __init__(self, config: MappingConfig, graph: PoseGraph) -> None:
        """Make a finder.

        Args:
            config: the mapper's settings.
            graph: the graph of keyframes; it is read, not changed.
        """
        self._config, self._graph = config, graph
        self._waiting: list[Edge] = []
        self._held: list[Submap] = []
        self.tried = 0

    def find(
        self,
        submaps: list[Submap],
        points: list[FloatArray],
        local: list[FloatArray],
        newest: int,
    ) -> list[Edge]:
        """Search for closures of a keyframe, with the scans of the keyframes before it.

        Args:
            submaps: all submaps; only finished ones are searched.
            points: hits (n, 2) of each keyframe in its base_link, m.
            local: pose (3,) of each keyframe in the front end's frame.
            newest: number of the keyframe; the cluster of scans ends with it.

        Returns:
            The accepted closures, of this keyframe and of earlier ones that it confirms.
        """
        first = max(0, newest - self._config.cluster_keyframes + 1)
        # A submap that holds scans of the cluster would match these scans with themselves.
        old = [
            s
            for s in submaps
            if s.finished and (s.keyframes[-1] < first or s.keyframes[0] > newest)
        ]
        if not old:
            return []
        cluster = cluster_of(
            points[first : newest + 1], local[first : newest + 1], self._config.cluster_points
        )
        if len(cluster) < 0.1 * self._config.cluster_points:
            return []
        place, yaw = self._graph.uncertainty(newest)
        accepted: list[Edge] = []
        for submap in self._candidates(old, newest, place):
            self.tried += 1
            self.hold(submap)
            window = np.array([3.0 * place[submap.anchor], 3.0 * yaw[submap.anchor]])
            match = self._match(submap, newest, cluster, window)
            if match is not None:
                accepted += self._confirm(match, local)
        return accepted

    def hold(self, submap: Submap) -> None:
        """Keep the grid of a finished submap, and forget the one that was not used for longest.

        Args:
            submap: the submap.
        """
        self._held = [other for other in self._held if other is not submap] + [submap]
        while len(self._held) > _MOST_GRIDS:
            self._held.pop(0).forget_grid()

    def _candidates(self, old: list[Submap], newest: int, place: FloatArray) -> list[Submap]:
        """Return the old submaps that may contain the newest keyframe, nearest first."""
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
    ) -> _Match | None:
        """Match the cluster to a submap within ``window`` (2,) m, rad of the graph's prediction."""
        config, poses = self._config, self._graph.poses
        predicted = compose(submap.anchor_pose, between(poses[submap.anchor], poses[newest]))
        # Widen the window a little: cells have a size, and the variance may be nearly zero.
        window = np.minimum(
            window + np.array([2.0 * config.grid.resolution_m, 0.04]),
            (config.most_window_m, config.most_window_rad),
        )
        weights = 0.05 / window**2  # 5 % of the score at the edge: the nearest of equals wins
        found, score = submap.grid.search(
            cluster, predicted, window, weights, config.closure_least_score
        )
        if score < 0.0:
            return None
        # A refinement that moves far from the pose on the raster has slid to another place.
        pose, information, _, residual = submap.grid.refine(cluster, found)
        moved = math.dist(pose[:2], found[:2])
        if residual > config.grid.most_residual or moved > 3.0 * config.grid.resolution_m:
            return None
        # Walls fit walls in many wrong places. There, some points lie in the map's free space.
        agreement, overlap = meetings(submap.grid, cluster, pose)
        if agreement < config.agreement or overlap < config.least_overlap:
            return None
        # In a wide window, search again without the neighbourhood of the match. If another place
        # fits nearly as well, the two cannot be told apart.
        if window[0] > _RIVAL_M:
            excluded = np.array([[*found, _RIVAL_M, _RIVAL_RAD]])
            least = config.rival_score * score
            _, rival = submap.grid.search(cluster, predicted, window, weights, least, excluded)
            if rival >= 0.0:
                return None
        covariance = self._covariance(submap, pose, information, residual)
        edge = Edge(submap.anchor, newest, between(submap.anchor_pose, pose), covariance, True)
        return _Match(edge, bool(window[0] <= config.sure_window_m))

    def _covariance(
        self, submap: Submap, pose: FloatArray, information: FloatArray, residual: float
    ) -> FloatArray:
        """Return the covariance (3, 3) of a match, in the axes of the submap's anchor."""
        covariance = match_covariance(information, residual, self._config) + _BENT
        return rotated_covariance(covariance, -submap.anchor_pose[2])

    def _confirm(self, match: _Match, local: list[FloatArray]) -> list[Edge]:
        """Accept a sure match at once; accept another only with a match that confirms it."""
        if match.sure:
            return [match.edge]
        newest = match.edge.second
        self._waiting = [e for e in self._waiting if newest - e.second <= _FORGET_KEYFRAMES]
        poses = self._graph.poses
        place = compose(poses[match.edge.first], match.edge.pose)
        for other in self._waiting:
            if other.second == newest:
                continue
            # Where the earlier match puts the newest keyframe: its pose plus the motion since.
            motion = between(local[other.second], local[newest])
            expected = compose(compose(poses[other.first], other.pose), motion)
            near = math.dist(place[:2], expected[:2]) <= _AGREE_M
            if near and abs(wrap_angle(place[2] - expected[2])) <= _AGREE_RAD:
                self._waiting.remove(other)
                return [other, match.edge]
        self._waiting.append(match.edge)
        return []


def cluster_of(points: list[FloatArray], poses: list[FloatArray], most: int) -> FloatArray:
    """Join several scans into one.

    Args:
        points: hits (n, 2) of each scan in its own base_link, m.
        poses: pose (3,) of base_link at each scan, all in one frame.
        most: about how many points to keep.

    Returns:
        (k, 2) points in base_link at the last scan, m. The newest scan's points come first.
    """
    parts = [
        transform_points(between(poses[-1], pose), some)
        for pose, some in zip(reversed(poses), reversed(points), strict=True)
    ]
    return thinned(np.concatenate(parts), _THIN_M, most)
