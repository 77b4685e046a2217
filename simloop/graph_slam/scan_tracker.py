"""The pose by odometry and by where each scan fits a map, weighed against each other."""

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

NEXT_TO_NOTHING = 1e-3 * np.eye(3)
"""Information where a match has none at all, as along a corridor: 30 m."""

_FIRST_POINTS = 10  # a scan with fewer hits is not matched
_WIDEST_M, _WIDEST_RAD = 1.0, 0.5
_NEAR_PENALTY, _FAR_PENALTY = 0.1, 0.02  # of the score at the window's edge
_BETTER = 0.02  # by which a fit far from where odometry has it must be better
_SURPRISE = 9.0  # squared Mahalanobis distance


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    pose: FloatArray
    information: FloatArray
    score: float
    residual: float


def match_covariance(information: FloatArray, residual: float, config: MappingConfig) -> FloatArray:
    """(3, 3) of a match's x, y, yaw: the inverse of its information, by what its points missed.

    Points that meet one surface share its error in the map, which no number of them averages away:
    all of them are worth ``erring_alike`` times fewer.
    """
    independent = inverse_3(information + NEXT_TO_NOTHING) * max(residual, 0.1)
    return independent * config.erring_alike


class ScanTracker:
    """pose (3,) of base_link in the map's frame, and its covariance (3, 3).

    ``score``: mean likelihood of the last scan's hits where it was found, 0 to 1.
    """

    def __init__(self, config: MappingConfig) -> None:
        self._config = config
        self.pose = np.zeros(3)
        self.covariance = np.zeros((3, 3))
        self.score = 0.0

    def predict(self, motion: FloatArray) -> None:
        """Move by ``motion`` (3,), odometry since the last scan."""
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
        moved = compose(self.pose, motion)
        dx, dy = moved[:2] - self.pose[:2]
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance += np.diag(np.square([along, along, yaw]))
        self.pose = moved

    def match(self, grid: GridMap, points: FloatArray, motion: FloatArray) -> bool:
        """Correct the pose by where the scan, points (n, 2), fits the map; False: nowhere.

        motion: (3,) since the last scan by odometry, which may be wrong altogether
        (wheels that spin, counters that take backwards for forwards): where the scan
        does not fit about where odometry has it, it is looked for as far as that on either side.
        """
        if len(points) < _FIRST_POINTS:
            return False
        spread = np.sqrt(np.diag(self.covariance))
        near = np.array([3.0 * max(spread[0], spread[1]), 3.0 * spread[2]])
        few = thinned(points, self._config.grid.resolution_m, self._config.search_points)
        found = self._fit(grid, points, few, near, _NEAR_PENALTY)
        # Along a corridor the walls fit anywhere, and only what ends it tells a lie.
        step, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
        wide = near + np.array([2.0 * step + 0.1, turn + 0.1])
        far = self._fit(grid, points, few, wide, _FAR_PENALTY)
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

        penalty: of the score at the window's edge, so that of equals the nearest is taken.
        """
        config = self._config
        window = np.minimum(window, (_WIDEST_M, _WIDEST_RAD))
        found, score = grid.search(few, self.pose, window, penalty / window**2)
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
        noise = match_covariance(fit.information, fit.residual, self._config)
        off = fit.pose - self.pose
        off[2] = wrap_angle(off[2])
        weight = inverse_3(self.covariance + noise)
        surprise = float(off @ weight @ off)
        if surprise > _SURPRISE:  # odometry was not what it is thought to be
            self.covariance *= surprise / _SURPRISE
            weight = inverse_3(self.covariance + noise)
        gain = self.covariance @ weight
        self.pose = self.pose + gain @ off
        self.pose[2] = wrap_angle(self.pose[2])
        covariance = (np.eye(3) - gain) @ self.covariance
        self.covariance = 0.5 * (covariance + covariance.T)
