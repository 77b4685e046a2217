"""Keep the graph of keyframes: measured relative poses, and the poses that fit them best.

gtsam (Dellaert 2012) optimises the graph by Levenberg-Marquardt. Loop closures have a robust
(Cauchy) kernel, so that the other edges outvote a wrong closure.
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

_ROBUST_SIGMAS = 3.0  # scale of the Cauchy kernel: a larger residual has a reduced weight
_LEVER_M = 5.0  # lever arm that turns a yaw error into a distance when the best path is chosen


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A measured relative pose between two keyframes.

    Attributes:
        first: number of the first keyframe.
        second: number of the second keyframe.
        pose: (3,) first_from_second, m, m, rad.
        covariance: (3, 3) of x, y, yaw, in the axes of ``first``.
        closure: whether the edge is a loop closure.
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
        InputError: gtsam is not installed. The text says how to install it.
    """
    try:
        import gtsam
    except ImportError:
        raise InputError("the pose graph needs gtsam: pip install 'simloop[slam]'") from None
    return gtsam


class PoseGraph:
    """Graph of keyframes and the edges between them. The first keyframe is held fixed.

    Keyframes are numbered from 0 in the order in which they are added.

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
            Number of the keyframe.
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
        """Move all poses so that they fit the edges best.

        Returns:
            Distance by which the last keyframe moved, m.
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
        """Compute the marginal covariance of every keyframe.

        This is slow, so it is used for measurements only.

        Returns:
            (3, 3) of x, y, yaw of each keyframe, in the axes of map. The first keyframe is held
            fixed.
        """
        marginals = self._gtsam.Marginals(*self._factors())
        out = []
        for number, pose in enumerate(self.poses):
            # gtsam gives the covariance in the keyframe's own axes.
            out.append(rotated_covariance(np.array(marginals.marginalCovariance(number)), pose[2]))
        return out

    def _factors(self) -> tuple[Any, Any]:
        """Return the graph and its present poses as gtsam objects."""
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
        """Compute an upper bound of the uncertainty of all keyframes relative to one of them.

        The bound is the uncertainty along the best single path through the graph (Olson 2008). A
        yaw error at one keyframe of the path moves the far end in proportion to its distance.

        Args:
            source: number of the keyframe to which the others are relative.

        Returns:
            Standard deviations of all keyframes' positions (n,), m, and yaws (n,), rad; inf for a
            keyframe that no path joins to the source.
        """
        n = len(self.poses)
        first = np.array([edge.first for edge in self.edges])
        second = np.array([edge.second for edge in self.edges])
        along = np.array([edge.covariance[0, 0] + edge.covariance[1, 1] for edge in self.edges])
        turn = np.array([edge.covariance[2, 2] for edge in self.edges])
        # The cost of an edge assumes that the far end lies _LEVER_M from each yaw error.
        cost = along + _LEVER_M**2 * turn
        # If several edges join two keyframes, the best one counts: it is written last.
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
    """Return the standard deviations of position and yaw along the tree of best paths."""
    n = len(parents)
    # Sums along each path: var xy, var yaw, and var yaw times (x, y, x^2 + y^2) of the keyframe
    # where the yaw error arises. They give the effect on any far end in one formula.
    sums = np.full((n, 5), np.nan)
    sums[source] = 0.0
    for start in range(n):
        # Walk back towards the source, to the first keyframe whose sums are known.
        path, node = [], start
        while np.isnan(sums[node, 0]):
            parent = int(parents[node])
            if parent < 0:
                sums[node] = np.inf
                break
            path.append(node)
            node = parent
        # Walk out again and add edge by edge. An edge's yaw error arises at its near end.
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
    """Rotate the covariance of a pose into other axes.

    Args:
        covariance: (3, 3) of x, y, yaw in the axes of frame b.
        yaw: yaw of b in frame a, rad.

    Returns:
        (3, 3) the same covariance in the axes of a: R C R^T.
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turn @ covariance @ turn.T
