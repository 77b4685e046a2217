"""The graph of keyframes: measured relative poses, and the poses that fit them best.

gtsam (Dellaert 2012) optimises it by Levenberg-Marquardt. Loop closures have a robust (Cauchy)
kernel, so that the other edges outvote a wrong one.
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

_ROBUST_SIGMAS = 3.0  # a closure off by more pulls with less than its full weight
_LEVER_M = 5.0  # distance at which a yaw error counts when the best way is chosen


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A measured relative pose between two keyframes.

    Attributes:
        first: number of the first keyframe.
        second: number of the second keyframe.
        pose: (3,) first_from_second, m, m, rad.
        covariance: (3, 3) of x, y, yaw, in the axes of ``first``.
        closure: whether it closes a loop.
    """

    first: int
    second: int
    pose: FloatArray
    covariance: FloatArray
    closure: bool


def load_gtsam() -> Any:
    """Import gtsam, which is an optional dependency.

    Returns:
        The module.

    Raises:
        InputError: if it is not installed; the text says how to install it.
    """
    try:
        import gtsam
    except ImportError:
        raise InputError("the pose graph needs gtsam: pip install 'simloop[slam]'") from None
    return gtsam


class PoseGraph:
    """Keyframes numbered as they come, and the edges between them; the first one is held fixed.

    Attributes:
        poses: map_from_base (3,) of each keyframe, m, m, rad.
        edges: the measured relative poses.
    """

    def __init__(self) -> None:
        self._gtsam = load_gtsam()
        self.poses: list[FloatArray] = []
        self.edges: list[Edge] = []
        self._new_closures = 0

    def add_pose(self, pose: FloatArray) -> int:
        """Add a keyframe.

        Args:
            pose: (3,) map_from_base, a first guess.

        Returns:
            Its number.
        """
        self.poses.append(np.array(pose, np.float64))
        return len(self.poses) - 1

    def add_edge(self, edge: Edge) -> None:
        """Add a measurement between two keyframes.

        Args:
            edge: the measurement; both keyframes must have been added.
        """
        self.edges.append(edge)
        self._new_closures += edge.closure

    @property
    def has_new_closures(self) -> bool:
        """Whether closures were added since the last optimisation."""
        return self._new_closures > 0

    def optimise(self) -> float:
        """Move all poses to where they fit the edges best.

        Returns:
            How far the last keyframe moved, m.
        """
        graph, values = self._factors()
        result = self._gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        before = self.poses[-1]
        for number in range(len(self.poses)):
            found = result.atPose2(number)
            self.poses[number] = np.array([found.x(), found.y(), found.theta()])
        self._new_closures = 0
        return math.dist(before[:2], self.poses[-1][:2])

    def covariances(self) -> list[FloatArray]:
        """Compute the marginal covariance of every keyframe. Slow: for measurements only.

        Returns:
            (3, 3) of x, y, yaw of each keyframe in the axes of map, the first one held fixed.
        """
        marginals = self._gtsam.Marginals(*self._factors())
        out = []
        for number, pose in enumerate(self.poses):
            # gtsam gives it in the keyframe's own axes.
            out.append(rotated_covariance(np.array(marginals.marginalCovariance(number)), pose[2]))
        return out

    def _factors(self) -> tuple[Any, Any]:
        """The graph and its present poses in gtsam's terms."""
        gtsam = self._gtsam
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for number, pose in enumerate(self.poses):
            values.insert(number, gtsam.Pose2(*pose.tolist()))
        hold = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
        graph.add(gtsam.PriorFactorPose2(0, values.atPose2(0), hold))
        kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(_ROBUST_SIGMAS)
        for edge in self.edges:
            # An edge's covariance is in the first keyframe's axes; gtsam wants the second's.
            own = rotated_covariance(edge.covariance, -edge.pose[2])
            noise = gtsam.noiseModel.Gaussian.Covariance(0.5 * (own + own.T))
            if edge.closure:
                noise = gtsam.noiseModel.Robust.Create(kernel, noise)
            pose = gtsam.Pose2(*edge.pose.tolist())
            graph.add(gtsam.BetweenFactorPose2(edge.first, edge.second, pose, noise))
        return graph, values

    def uncertainty(self, source: int) -> tuple[FloatArray, FloatArray]:
        """Bound the uncertainty of all keyframes relative to one of them.

        It is an upper bound: that along the best single path through the graph (Olson 2008). A yaw
        error at one keyframe of the path moves the far end in proportion to its distance.

        Args:
            source: number of the keyframe from which the others are seen.

        Returns:
            Standard deviations of all keyframes' positions (n,), m, and yaws (n,), rad; inf for a
            keyframe that no edges join to the source.
        """
        n = len(self.poses)
        first = np.array([edge.first for edge in self.edges])
        second = np.array([edge.second for edge in self.edges])
        along = np.array([edge.covariance[0, 0] + edge.covariance[1, 1] for edge in self.edges])
        turn = np.array([edge.covariance[2, 2] for edge in self.edges])
        # The path is chosen as if the far end lay five metres from each yaw error.
        cost = along + _LEVER_M**2 * turn
        # Of several edges between two keyframes the best one counts: it is written last.
        order = np.argsort(-cost, kind="stable")
        pairs = {}
        for k in order.tolist():
            pairs[min(first[k], second[k]), max(first[k], second[k])] = k
        chosen = np.array(list(pairs.values()))
        table = csr_matrix((cost[chosen], (first[chosen], second[chosen])), shape=(n, n))
        _, parents = dijkstra(table, directed=False, indices=source, return_predecessors=True)
        return _path_deviations(source, parents, pairs, along, turn, np.array(self.poses))


def _path_deviations(
    source: int,
    parents: FloatArray,
    pairs: dict[tuple[int, int], int],
    along: FloatArray,
    turn: FloatArray,
    poses: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of position and yaw of each keyframe, along the tree of best paths."""
    n = len(parents)
    # Sums along each path: var xy, var yaw, and var yaw times (x, y, x^2 + y^2) of the keyframe
    # where it arises. From these the effect on any end follows without walking the path again.
    sums = np.full((n, 5), np.nan)
    sums[source] = 0.0
    for start in range(n):
        # Back towards the source, to the first keyframe whose sums are known ...
        path, node = [], start
        while np.isnan(sums[node, 0]):
            parent = int(parents[node])
            if parent < 0:
                sums[node] = np.inf
                break
            path.append(node)
            node = parent
        # ... and out again, adding edge by edge. An edge's yaw error arises at its near end.
        for node in reversed(path):
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
    # Sum over the path of var yaw * |end - origin|^2, multiplied out.
    x, y = poses[:, 0], poses[:, 1]
    lever = sums[:, 4] - 2.0 * (x * sums[:, 2] + y * sums[:, 3]) + (x * x + y * y) * sums[:, 1]
    return np.sqrt(sums[:, 0] + np.maximum(0.0, lever)), np.sqrt(sums[:, 1])


def rotated_covariance(covariance: FloatArray, yaw: float) -> FloatArray:
    """Express a pose's covariance in other axes.

    Args:
        covariance: (3, 3) of x, y, yaw in frame b.
        yaw: the yaw of b in frame a, rad.

    Returns:
        (3, 3) the same covariance in the axes of a: R C R^T.
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turn @ covariance @ turn.T
