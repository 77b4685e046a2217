"""Track the pose from scan to scan: odometry predicts it, a match to a map corrects it.

Prediction and correction are those of a Kalman filter whose state is the pose alone. Which of the
fits is the right one is decided by comparing hypotheses about odometry: that it was right up to its
noise, that it had the wrong sign, or that it was wrong altogether. How probable each of them is in
this log, and how large the noise is, is learnt from the scans before (``OdometryModel``).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from simloop.geometry.se2 import between, compose, wrap_angle
from simloop.geometry.small_matrices import inverse_3
from simloop.graph_slam.evidence import EvidenceField
from simloop.graph_slam.odometry_model import OdometryModel, Step
from simloop.graph_slam.pose_graph import rotated_covariance
from simloop.graph_slam.scan_fit import LEAST_POINTS, Fit, FittedScan, Window
from simloop.graph_slam.settings import MappingConfig
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

_SIGMAS = 3.5  # half width of a window about a prediction, in its deviations
_WIDEST_M, _WIDEST_RAD = 2.5, 0.6  # largest half widths of a window
_WIDE_PENALTY = 0.02  # taken off the score at its edge: the nearest of equals wins
# Weight of a scan against odometry: log-likelihood per unit of the score. A hit on a surface is
# e^3 times as likely as one in free space, and some twenty of a scan's hits err independently.
_NATS = 60.0
_USUAL_HIT = 0.7  # assumed mean likelihood of the hits in known space
_HIT_SCANS = 100  # it is learnt from so many last scans
# A hit in unknown space, as a share of the usual likelihood. At 0, a scan is slid back onto the
# known part of a corridor; at 1, a scan that fits nowhere flees into the unknown.
_UNKNOWN = 0.35
# After so long a step or turn, most of what a scan sees is new, and its pose has these deviations
# in addition, because what it is matched to was seen by few scans.
_NEW_M, _NEW_RAD = 1.0, 0.5
_NEW_STD_M, _NEW_STD_RAD = 0.03, 0.008
_SURPRISE = 9.0  # squared Mahalanobis distance (three sigmas) above which the prior is widened


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
        self._before = self.pose
        self._odometry = OdometryModel(config)
        self._hits: deque[float] = deque(maxlen=_HIT_SCANS)
        self._field: EvidenceField | None = None
        self._field_of: tuple[GridMap | None, int] = (None, 0)

    def predict(self, motion: FloatArray) -> None:
        """Move the pose by odometry, and increase its uncertainty.

        Args:
            motion: (3,) pose of base_link now in base_link at the last scan, m, m, rad.
        """
        xy, yaw = self._odometry.deviations(motion)
        self._before = self.pose
        moved = compose(self.pose, motion + self._odometry.correction(motion))
        dx, dy = moved[:2] - self.pose[:2]
        # A yaw error at the start moves the end sideways in proportion to the distance.
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance += np.diag(np.square([xy, xy, yaw]))
        self.pose = moved

    def match(self, grid: GridMap, points: FloatArray, motion: FloatArray) -> bool:
        """Correct the pose with a scan.

        Args:
            grid: the map.
            points: (n, 2) hits in base_link, m.
            motion: (3,) the odometry motion given to ``predict``.

        Returns:
            Whether the scan fits anywhere. If not, the predicted pose is kept.
        """
        if len(points) < LEAST_POINTS:
            return False
        field = self._evidence(grid)
        kind, found = self._likeliest(FittedScan(points, grid, field, self._config), motion)
        if found is None:
            self.score = 0.0
            return False
        self.score = found.score
        noise = found.covariance(self._config)
        own = rotated_covariance(noise, -found.pose[2])
        self._odometry.learn(motion, between(self.pose, found.pose), np.sqrt(np.diag(own)), kind)
        self._correct_by(found, noise + _new_ground(motion))
        self._hits.append(field.known(points, self.pose)[0])
        return True

    def _evidence(self, grid: GridMap) -> EvidenceField:
        """Return the field of a map; it is made anew after each scan that was entered."""
        if self._field is None or self._field_of != (grid, grid.scans):
            unknown = _UNKNOWN * float(np.median([*self._hits, _USUAL_HIT]))
            self._field, self._field_of = EvidenceField(grid, unknown), (grid, grid.scans)
        return self._field

    def _likeliest(self, scan: FittedScan, motion: FloatArray) -> tuple[Step, Fit | None]:
        """Return what odometry was in this step, and the scan's fit."""
        best, kind, most = None, Step.RIGHT, -math.inf
        for hypothesis, window, density in self._hypotheses(motion):
            # What the scan must outweigh: that odometry is rarely so, and the size of the window.
            prior = math.log(min(1.0, density * self._odometry.share(hypothesis))) / _NATS
            fit = scan.fit(window._replace(least=max(0.0, most - prior)))
            if fit is not None and fit.score + prior > most:
                best, kind, most = fit, hypothesis, fit.score + prior
        return kind, best

    def _hypotheses(self, motion: FloatArray) -> list[tuple[Step, Window, float]]:
        """Return the hypotheses about a step of odometry, each with where the robot is then.

        The third value is the probability density at the likeliest pose, relative to that of the
        first hypothesis: normal about a prediction, even in the window for anything.
        """
        step, turn = math.hypot(motion[0], motion[1]), abs(float(motion[2]))
        deviations = np.sqrt(np.diag(self.covariance))
        near = np.array([max(deviations[0], deviations[1]), deviations[2]])
        widest = np.array([_WIDEST_M, _WIDEST_RAD])
        size = np.minimum(_SIGMAS * near, widest)
        right = Window(self.pose, size, 0.5 / _NATS / near**2)
        size = np.minimum(size + np.array([2.0 * step + 0.1, turn + 0.1]), widest)
        anything = Window(self.pose, size, _WIDE_PENALTY / size**2)
        hypotheses = [(Step.RIGHT, right, 1.0)]
        if step > 2.0 * near[0]:
            back = compose(self._before, np.array([-motion[0], -motion[1], motion[2]]))
            hypotheses.append((Step.REVERSED, right._replace(middle=back), 1.0))
        hypotheses.append((Step.WRONG, anything, _density_ratio(size, near)))
        return hypotheses

    def _correct_by(self, fit: Fit, noise: FloatArray) -> None:
        """Correct the predicted pose with a fit and its covariance (3, 3) (Kalman update)."""
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


def _density_ratio(window: FloatArray, deviations: FloatArray) -> float:
    """Return the even density in a window over the greatest of a normal distribution."""
    normal = (2.0 * math.pi) ** 1.5 * deviations[0] ** 2 * deviations[1]
    return float(normal / (8.0 * window[0] ** 2 * window[1]))


def _new_ground(motion: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) that a match has because the scan sees new ground."""
    way = math.hypot(motion[0], motion[1]) / _NEW_M + abs(float(motion[2])) / _NEW_RAD
    share = min(1.0, way)
    return np.diag(np.square(share * np.array([_NEW_STD_M, _NEW_STD_M, _NEW_STD_RAD])))
