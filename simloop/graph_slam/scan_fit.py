"""Fit a scan to a map within a window: a search on a raster, then a refinement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simloop.geometry.small_matrices import inverse_3
from simloop.graph_slam.evidence import EvidenceField
from simloop.graph_slam.settings import MappingConfig
from simloop.mapping.correlative import thinned
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

LEAST_POINTS = 10
"""A scan with fewer hits is not matched."""

_WEAK_INFORMATION = 1e-3 * np.eye(3)
"""Information added to a match (about 30 m), because a corridor may give none along its axis."""
_LEAST_RAD = 0.02  # least half width of a window
_LEAST_RESIDUAL = 0.1  # lower bound of the residual: a smaller one is chance
_MOST_MOVE_CELLS = 3.0  # a refinement that moves by more has slid to another place


class Window(NamedTuple):
    """Where a scan is searched for.

    Attributes:
        middle: (3,) x, y, yaw, m, m, rad.
        size: (2,) half the size, m and rad.
        weights: (2,) penalties on the squared offsets from the middle, 1/m^2 and 1/rad^2.
        least: the score must exceed this.
    """

    middle: FloatArray
    size: FloatArray
    weights: FloatArray
    least: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A match of a scan to a map.

    Attributes:
        pose: (3,) map_from_base, m, m, rad.
        information: (3, 3) of x, y, yaw, as ``GridMap.refine`` returns it.
        score: mean likelihood of the hits minus the penalty, as the search found it.
        residual: mean squared Mahalanobis distance of the matched points.
    """

    pose: FloatArray
    information: FloatArray
    score: float
    residual: float

    def covariance(self, config: MappingConfig) -> FloatArray:
        """Compute the covariance; see ``match_covariance``.

        Args:
            config: the mapper's settings.

        Returns:
            (3, 3) of x, y, yaw, in the map's axes.
        """
        return match_covariance(self.information, self.residual, config)


class FittedScan:
    """A scan that is fitted to a map in several windows."""

    def __init__(
        self, points: FloatArray, grid: GridMap, field: EvidenceField, config: MappingConfig
    ) -> None:
        """Choose the points that are searched for.

        Args:
            points: (n, 2) hits in base_link, m.
            grid: the map.
            field: the map's evidence.
            config: the mapper's settings.
        """
        self._points, self._grid, self._field, self._config = points, grid, field, config
        self._few = thinned(points, grid.resolution_m, config.search_points)

    def fit(self, window: Window) -> Fit | None:
        """Search a window with some of the points, and refine the pose with all of them.

        Args:
            window: where to search.

        Returns:
            The best fit; None if the scan does not fit in the window.
        """
        config, resolution = self._config, self._grid.resolution_m
        size = np.maximum(window.size, (2.0 * resolution, _LEAST_RAD))
        found, score = self._field.search(
            self._few, window.middle, size, window.weights, window.least
        )
        if score < 0.0:
            return None
        pose, information, share, residual = self._grid.refine(self._points, found)
        known = self._field.known(self._points, pose)[1]
        if share < config.least_share * known or known * len(self._points) < LEAST_POINTS:
            return None
        if residual > config.grid.most_residual:
            return None
        if math.dist(pose[:2], found[:2]) > _MOST_MOVE_CELLS * resolution:
            return None
        return Fit(pose, information, score, residual)


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
