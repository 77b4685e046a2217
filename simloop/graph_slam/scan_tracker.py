"""Tracks the pose from scan to scan: odometry predicts it, a match to a map corrects it.

Prediction and correction are those of a Kalman filter whose state is the pose alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.geometry.se2 import compose, wrap_angle
from simloop.geometry.small_matrices import inverse_3
from simloop.graph_slam.settings import MappingConfig
from simloop.mapping.correlative import thinned
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

_WEAK_INFORMATION = 1e-3 * np.eye(3)
"""Added to the information of a match, which may be zero along a corridor: about 30 m."""
_LEAST_POINTS = 10  # a scan with fewer hits is not matched
_WIDEST_M, _WIDEST_RAD = 1.0, 0.5
_NEAR_PENALTY, _WIDE_PENALTY = 0.1, 0.02  # of the score at the window's edge
_BETTER = 0.02  # a fit far from odometry's pose must be better by this score
_SURPRISE = 9.0  # squared Mahalanobis distance, three sigmas
_LEAST_RESIDUAL = 0.1  # a very small one is luck


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A match: pose (3,), its information (3, 3), the search's score, and the mean residual."""

    pose: FloatArray
    information: FloatArray
    score: float
    residual: float


def match_covariance(information: FloatArray, residual: float, config: MappingConfig) -> FloatArray:
    """Compute the covariance of a matched pose.

    Points that meet one surface share the surface's error in the map, which does not average out.
    So all points together count as ``config.erring_alike`` times fewer.

    Args:
        information: (3, 3) of the match in x, y, yaw, as ``GridMap.refine`` returns it.
        residual: mean squared Mahalanobis distance of its matched points, likewise.
        config: the mapper's settings.

    Returns:
        (3, 3) covariance of x, y, yaw, in the map's axes.
    """
    independent = inverse_3(information + _WEAK_INFORMATION) * max(residual, _LEAST_RESIDUAL)
    return independent * config.erring_alike


class ScanTracker:
    """Filters the pose of base_link in the map's frame.

    Attributes:
        pose: (3,) map_from_base, m, m, rad.
        covariance: (3, 3) of x, y, yaw.
        score: mean likelihood, 0 to 1, of the last scan's hits at the pose where it was found.
    """

    def __init__(self, config: MappingConfig) -> None:
        """Start at the origin, without uncertainty.

        Args:
            config: the mapper's settings.
        """
        self._config = config
        self.pose = np.zeros(3)
        self.covariance = np.zeros((3, 3))
        self.score = 0.0

    def predict(self, motion: FloatArray) -> None:
        """Move the pose by odometry, and let its uncertainty grow.

        Args:
            motion: (3,) base_link now as seen from base_link at the last scan.
        """
        config = self._config
        step, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
        along = (
            config.odometry_xy_m
            + config.odometry_xy_per_m * step
            + config.odometry_xy_per_rad * turn
        )
        yaw = (
            config.odometry_yaw_rad
            + config.odometry_yaw_per_m * step
            + config.odometry_yaw_per_rad * turn
        )
        moved = compose(self.pose, motion)
        dx, dy = moved[:2] - self.pose[:2]
        # A yaw error at the start moves the end aside in proportion to the distance.
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance += np.diag(np.square([along, along, yaw]))
        self.pose = moved

    def match(self, grid: GridMap, points: FloatArray, motion: FloatArray) -> bool:
        """Correct the pose by a scan.

        Odometry may be entirely wrong: wheels spin, and some counters do not tell backwards from
        forwards. So the scan is also searched for in a window as wide as the whole motion.

        Args:
            grid: the map.
            points: (n, 2) hits in base_link, m.
            motion: (3,) the odometry by which the pose was predicted.

        Returns:
            Whether the scan fits anywhere; if not, the pose is left as predicted.
        """
        if len(points) < _LEAST_POINTS:
            return False
        spread = np.sqrt(np.diag(self.covariance))
        near = np.array([3.0 * max(spread[0], spread[1]), 3.0 * spread[2]])
        few = thinned(points, self._config.grid.resolution_m, self._config.search_points)
        found = self._fit(grid, points, few, near, _NEAR_PENALTY)
        # The far fit must be clearly better: along a corridor the walls fit anywhere, and only
        # what stands at its end tells a right place from a wrong one.
        step, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
        wide = near + np.array([2.0 * step + 0.1, turn + 0.1])
        far = self._fit(grid, points, few, wide, _WIDE_PENALTY)
        if far is not None and (found is None or far.score > found.score + _BETTER):
            found = far
        if found is None:
            self.score = 0.0
            return False
        self.score = found.score
        self._correct_by(found)
        return True

    def _fit(
        self, grid: GridMap, points: FloatArray, few: FloatArray, window: FloatArray, penalty: float
    ) -> _Fit | None:
        """The best fit within ``window`` (2,) m, rad about the pose, or None.

        ``few`` are the points for the search, ``points`` all of them for the refinement. The
        score is less by ``penalty`` at the window's edge, so that of equals the nearest is taken.
        """
        config = self._config
        window = np.minimum(window, (_WIDEST_M, _WIDEST_RAD))
        found, score = grid.search(few, self.pose, window, penalty / window**2)
        if score < 0.0:
            return None
        pose, information, share, residual = grid.refine(points, found)
        if share < config.least_share or residual > config.grid.most_residual:
            return None
        # A refinement that moves by more than the search's grain has slid along to elsewhere.
        if math.dist(pose[:2], found[:2]) > 3.0 * config.grid.resolution_m:
            return None
        return _Fit(pose, information, score, residual)

    def _correct_by(self, fit: _Fit) -> None:
        """Weigh the fit against the prediction (Kalman update)."""
        noise = match_covariance(fit.information, fit.residual, self._config)
        off = fit.pose - self.pose
        off[2] = wrap_angle(off[2])
        weight = inverse_3(self.covariance + noise)
        surprise = float(off @ weight @ off)
        if surprise > _SURPRISE:
            # Odometry was worse than its model says: the fit counts for more.
            self.covariance *= surprise / _SURPRISE
            weight = inverse_3(self.covariance + noise)
        gain = self.covariance @ weight
        self.pose = self.pose + gain @ off
        self.pose[2] = wrap_angle(self.pose[2])
        covariance = (np.eye(3) - gain) @ self.covariance
        self.covariance = 0.5 * (covariance + covariance.T)
