"""Search fields that tell unknown space from free space.

A scan that sees new ground has points where the map knows nothing. If such a point counted like
one in free space, the scan would score higher when it is slid back onto the known part of the map:
a corridor would become shorter with each scan. So a point in unknown space counts more than one in
free space, and less than a hit on a surface.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.mapping.correlative import (
    MID,
    TOP,
    Field,
    SearchFields,
    raise_field,
    search_map,
)
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

FREE_BELOW = -0.3
"""A cell with lower log-odds was seen free: by a beam, and not hit as often."""

_BEHIND = 5  # unknown cells so close to a surface count as free: they are behind it, cells


class EvidenceField:
    """Likelihood of a hit in each cell of a map: on a surface, in unknown and in free space."""

    def __init__(self, grid: GridMap, unknown: float) -> None:
        """Make the field of a map. It does not follow later changes of the map.

        Args:
            grid: the map.
            unknown: likelihood of a hit, 0 to 1, in unknown space.
        """
        value = round(255.0 * unknown)
        fine = _three_valued(grid.log_odds, grid.occupied, np.uint8(value))
        corner = grid.origin_m - TOP * grid.resolution_m
        # The maxima of the surfaces alone are not used: unknown space counts too.
        unused = [np.zeros([side // k for side in fine.shape], np.uint8) for k in (MID, TOP)]
        raise_field(grid.surfaces(), *corner.tolist(), grid.resolution_m, fine, *unused)
        coarse = _maxima(fine, MID), _maxima(fine, TOP)
        self._fields = SearchFields(fine, *coarse, corner, grid.resolution_m, value)

    def search(
        self,
        points: FloatArray,
        prior: FloatArray,
        window: FloatArray,
        weights: FloatArray,
        least: float = 0.0,
    ) -> tuple[FloatArray, float]:
        """Search a window for the best pose; see ``correlative.search_map``.

        Args:
            points: (n, 2) hits in base_link, m.
            prior: (3,) x, y, yaw of base_link in map, the middle of the window, m, m, rad.
            window: (2,) half the size of the window, m and rad.
            weights: (2,) penalties on the squared offsets from the prior, 1/m^2 and 1/rad^2.
            least: the score must exceed this.

        Returns:
            Pose (3,), and its score; -1 if there is none.
        """
        return search_map(points, prior, window, weights, self._fields, least)

    def known(self, points: FloatArray, pose: FloatArray) -> tuple[float, float]:
        """Measure how well the points in known space fit.

        Args:
            points: (n, 2) hits in base_link, m.
            pose: (3,) base_link in the map's frame.

        Returns:
            Mean likelihood of the points in known space, and their share of all points.
        """
        fields = self._fields
        total, count = _known(
            points, pose, fields.fine, fields.corner, fields.resolution, fields.outside
        )
        return total / max(1, count), count / max(1, len(points))


@njit(cache=True)
def _three_valued(
    log_odds: NDArray[np.float32], occupied: NDArray[np.bool_], unknown: int
) -> Field:
    """Return the field without surfaces: ``unknown`` or 0, with a margin of TOP cells."""
    rows, cols = log_odds.shape
    fine = np.full((rows + 2 * TOP, cols + 2 * TOP), unknown, np.uint8)
    for r in range(rows):
        for c in range(cols):
            if log_odds[r, c] < FREE_BELOW:
                fine[r + TOP, c + TOP] = 0
            elif occupied[r, c]:
                row, col = r + TOP, c + TOP
                fine[row - _BEHIND : row + _BEHIND + 1, col - _BEHIND : col + _BEHIND + 1] = 0
    return fine


def _maxima(fine: Field, side: int) -> Field:
    """Return the maxima over [side i, side i + 2 side) in both axes; the sides are multiples."""
    rows, cols = fine.shape
    blocks = fine.reshape(rows // side, side, cols // side, side).max(axis=(1, 3))
    out = blocks.copy()
    out[:-1] = np.maximum(out[:-1], blocks[1:])
    out[:, :-1] = np.maximum(out[:, :-1], out[:, 1:])
    return out


@njit(cache=True)
def _known(
    points: FloatArray, pose: FloatArray, fine: Field, corner: FloatArray, resolution: float,
    unknown: int,
) -> tuple[float, int]:  # fmt: skip
    """Return the sum of the likelihoods of the points that are not in unknown space; count."""
    rows, cols = fine.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    total, count = 0.0, 0
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1]
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1]
        row = math.floor((y - corner[1]) / resolution)
        col = math.floor((x - corner[0]) / resolution)
        if 0 <= row < rows and 0 <= col < cols and fine[row, col] != unknown:
            total += fine[row, col] / 255.0
            count += 1
    return total, count
