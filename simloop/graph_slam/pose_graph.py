"""The graph of keyframes: relative poses between them, and the poses that fit them best.

Optimised by gtsam (Dellaert 2012), Levenberg-Marquardt; loop closures under a robust kernel, so
that one that is wrong is outvoted and not obeyed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from simloop.common.errors import InputError
from simloop.messages import FloatArray

_ROBUST_SIGMAS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """first_from_second (3,) with covariance (3, 3), in the frame of ``first``."""

    first: int
    second: int
    pose: FloatArray
    covariance: FloatArray
    closure: bool


def library() -> Any:
    """gtsam. Raises InputError, which says how to get it, where it is not installed."""
    try:
        import gtsam
    except ImportError:
        raise InputError("the pose graph needs gtsam: pip install 'simloop[slam]'") from None
    return gtsam


class PoseGraph:
    """Keyframes' poses map_from_base, numbered as they come; the first one is held."""

    def __init__(self) -> None:
        self._gtsam = library()
        self.poses: list[FloatArray] = []
        self.edges: list[Edge] = []
        self._fresh = 0

    def add_pose(self, pose: FloatArray) -> int:
        """A new keyframe at ``pose`` (3,); its number."""
        self.poses.append(np.array(pose, np.float64))
        return len(self.poses) - 1

    def add_edge(self, edge: Edge) -> None:
        """Join two keyframes."""
        self.edges.append(edge)
        self._fresh += edge.closure

    @property
    def has_news(self) -> bool:
        """Whether closures have come since the last optimisation."""
        return self._fresh > 0

    def optimise(self) -> float:
        """Move all poses to where they fit the edges best; how far the last one moved, m."""
        graph, values = self._factors()
        result = self._gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        before = self.poses[-1]
        for number in range(len(self.poses)):
            found = result.atPose2(number)
            self.poses[number] = np.array([found.x(), found.y(), found.theta()])
        self._fresh = 0
        return math.dist(before[:2], self.poses[-1][:2])

    def covariances(self) -> list[FloatArray]:
        """(3, 3) of each keyframe in map, the first one being held; slow, for measurements."""
        marginals = self._gtsam.Marginals(*self._factors())
        out = []
        for number, pose in enumerate(self.poses):
            # gtsam's is of an error in the keyframe's own axes.
            out.append(turned(np.array(marginals.marginalCovariance(number)), pose[2]))
        return out

    def _factors(self) -> tuple[Any, Any]:
        """The graph and the poses as they stand, for gtsam."""
        gtsam = self._gtsam
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for number, pose in enumerate(self.poses):
            values.insert(number, gtsam.Pose2(*pose.tolist()))
        hold = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
        graph.add(gtsam.PriorFactorPose2(0, values.atPose2(0), hold))
        kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(_ROBUST_SIGMAS)
        for edge in self.edges:
            # An edge's covariance is in the first keyframe's axes, gtsam's in the second's.
            own = turned(edge.covariance, -edge.pose[2])
            noise = gtsam.noiseModel.Gaussian.Covariance(0.5 * (own + own.T))
            if edge.closure:
                noise = gtsam.noiseModel.Robust.Create(kernel, noise)
            pose = gtsam.Pose2(*edge.pose.tolist())
            graph.add(gtsam.BetweenFactorPose2(edge.first, edge.second, pose, noise))
        return graph, values

    def uncertainty(self, source: int) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n,), (n,) of all keyframes' places and yaws as seen from ``source``.

        An upper bound: that along the best single way through the graph (Olson 2008). A yaw error
        at one of the way's keyframes moves the far end by its distance from there.
        """
        n = len(self.poses)
        first = np.array([edge.first for edge in self.edges])
        second = np.array([edge.second for edge in self.edges])
        along = np.array([edge.covariance[0, 0] + edge.covariance[1, 1] for edge in self.edges])
        turn = np.array([edge.covariance[2, 2] for edge in self.edges])
        # What the way is chosen by: a yaw error counts as if the end lay five metres off.
        cost = along + 25.0 * turn
        # Two edges between the same keyframes: the better one counts.
        order = np.argsort(-cost, kind="stable")
        pairs = {}
        for k in order.tolist():
            pairs[min(first[k], second[k]), max(first[k], second[k])] = k
        chosen = np.array(list(pairs.values()))
        table = csr_matrix((cost[chosen], (first[chosen], second[chosen])), shape=(n, n))
        _, parents = dijkstra(table, directed=False, indices=source, return_predecessors=True)
        return _along_ways(source, parents, pairs, along, turn, np.array(self.poses))


def _along_ways(
    source: int,
    parents: FloatArray,
    pairs: dict[tuple[int, int], int],
    along: FloatArray,
    turn: FloatArray,
    poses: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Sums over the tree of best ways: variances of place and yaw of each end."""
    n = len(parents)
    # sums: var xy, var yaw, and sum of var yaw times (x, y, x^2 + y^2) of where it arose.
    sums = np.full((n, 5), np.nan)
    sums[source] = 0.0
    for start in range(n):
        way, node = [], start
        while np.isnan(sums[node, 0]):
            parent = int(parents[node])
            if parent < 0:
                sums[node] = np.inf
                break
            way.append(node)
            node = parent
        for node in reversed(way):
            parent = int(parents[node])
            k = pairs[min(node, parent), max(node, parent)]
            x, y = poses[parent, 0], poses[parent, 1]
            sums[node] = sums[parent] + (
                along[k],
                turn[k],
                turn[k] * x,
                turn[k] * y,
                turn[k] * (x * x + y * y),
            )
    x, y = poses[:, 0], poses[:, 1]
    lever = sums[:, 4] - 2.0 * (x * sums[:, 2] + y * sums[:, 3]) + (x * x + y * y) * sums[:, 1]
    return np.sqrt(sums[:, 0] + np.maximum(0.0, lever)), np.sqrt(sums[:, 1])


def turned(covariance: FloatArray, yaw: float) -> FloatArray:
    """(3, 3) of x, y, yaw in axes that the old ones are turned by ``yaw`` to."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turn @ covariance @ turn.T
