"""Track the pose from scan to scan: odometry predicts it, a match to a map corrects it.

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

LEAST_POINTS = 10
"""A scan with fewer hits is not matched."""

_WEAK_INFORMATION = 1e-3 * np.eye(3)
"""Information added to a match (about 30 m), because a corridor may give none along its axis."""
_WIDEST_M, _WIDEST_RAD = 1.0, 0.5  # largest half widths of the search window
_NEAR_PENALTY, _WIDE_PENALTY = 0.1, 0.02  # taken off the score at the window's edge
_BETTER = 0.02  # a fit in the wide window must have a score higher by this
_SURPRISE = 9.0  # squared Mahalanobis distance (three sigmas) above which the prior is widened
_LEAST_RESIDUAL = 0.1  # lower bound of the residual: a smaller one is chance


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A match: pose (3,), its information (3, 3), the score of the search, the mean residual."""

    pose: FloatArray
    information: FloatArray
    score: float
    residual: float


def match_covariance(information: FloatArray, residual: float, config: MappingConfig) -> FloatArray:
    """Compute the covariance of a matched pose.

    Points that meet one surface share that surface's error in the map, which does not average out.
    So the covariance of independent points is multiplied by ``config.erring_alike``.

    Args:
        information: (3, 3) of the match in x, y, yaw, as ``GridMap.refine`` returns it.
        residual: mean squared Mahalanobis distance of the matched points, also from ``refine``.
        config: the mapper's settings.

    Returns:
        (3, 3) covariance of x, y, yaw, in the map's axes.
    """
    independent = inverse_3(information + _WEAK_INFORMATION) * max(residual, _LEAST_RESIDUAL)
    return independent * config.erring_alike


class ScanTracker:
    """Filter of the pose of base_link in the map's frame.

    Attributes:
        pose: (3,) map_from_base, m, m, rad.
        covariance: (3, 3) of x, y, yaw.
        score: mean likelihood, 0 to 1, of the last scan's hits at the pose where it was found.
    """

    def __init__(self, config: MappingConfig) -> None:
        """Start at the origin, with zero uncertainty.

        Args:
            config: the mapper's settings.
        """
        self._config = config
        self.pose = np.zeros(3)
        self.covariance = np.zeros((3, 3))
        self.score = 0.0

    def predict(self, motion: FloatArray) -> None:
        """Move the pose by odometry, and increase its uncertainty.

        Args:
            motion: (3,) pose of base_link now in base_link at the last scan, m, m, rad.
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
        # A yaw error at the start moves the end sideways in proportion to the distance.
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance += np.diag(np.square([along, along, yaw]))
        self.pose = moved

    def match(self, grid: GridMap, points: FloatArray, motion: FloatArray) -> bool:
        """Correct the pose with a scan.

        Odometry may be entirely wrong: wheels spin, and some counters cannot tell backwards from
        forwards. So the scan is also searched for in a wider window that covers the whole motion.

        Args:
            grid: the map.
            points: (n, 2) hits in base_link, m.
            motion: (3,) the odometry motion given to ``predict``.

        Returns:
            Whether the scan fits anywhere. If not, the predicted pose is kept.
        """
        if len(points) < LEAST_POINTS:
            return False
        spread = np.sqrt(np.diag(self.covariance))
        near = np.array([3.0 * max(spread[0], spread[1]), 3.0 * spread[2]])
        few = thinned(points, self._config.grid.resolution_m, self._config.search_points)
        found = self._fit(grid, points, few, near, _NEAR_PENALTY)
        # The far fit must be clearly better. Along a corridor the walls fit anywhere; only what
        # stands at its end tells the right place from a wrong one.
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
        """Return the best fit within ``window`` (2,) m, rad around the pose, or None.

        The search uses the points ``few``; the refinement uses all ``points``. At the window's
        edge ``penalty`` is taken off the score, so that the nearest of equal fits wins.
        """
        config = self._config
        window = np.minimum(window, (_WIDEST_M, _WIDEST_RAD))
        found, score = grid.search(few, self.pose, window, penalty / window**2)
        if score < 0.0:
            return None
        pose, information, share, residual = grid.refine(points, found)
        if share < config.least_share or residual > config.grid.most_residual:
            return None
        # A refinement that moves by several cells has slid to another place.
        if math.dist(pose[:2], found[:2]) > 3.0 * config.grid.resolution_m:
            return None
        return _Fit(pose, information, score, residual)

    def _correct_by(self, fit: _Fit) -> None:
        """Correct the predicted pose with the fit (Kalman update)."""
        noise = match_covariance(fit.information, fit.residual, self._config)
        off = fit.pose - self.pose
        off[2] = wrap_angle(off[2])
        weight = inverse_3(self.covariance + noise)
        surprise = float(off @ weight @ off)
        if surprise > _SURPRISE:
            # Odometry was worse than its model, so the prediction gets less weight.
            self.covariance *= surprise / _SURPRISE
            weight = inverse_3(self.covariance + noise)
        gain = self.covariance @ weight
        self.pose = self.pose + gain @ off
        self.pose[2] = wrap_angle(self.pose[2])
        covariance = (np.eye(3) - gain) @ self.covariance
        self.covariance = 0.5 * (covariance + covariance.T)
