"""Keep the occupancy grid: log-odds, the sums of the hits in each cell, and search fields.

The grid grows by chunks when needed, up to a largest number of cells. Beams that would exceed this
number are not entered. A cell takes ``BYTES_A_CELL``, so the memory is bounded too.
"""

from __future__ import annotations

import copy

import cv2
import numpy as np
from numpy.typing import NDArray

from simloop.config import SlamConfig
from simloop.geometry.se2 import transform_points
from simloop.mapping.correlative import (
    MID,
    NOTHING_EXCLUDED,
    TOP,
    SearchFields,
    raise_field,
    search_map,
)
from simloop.mapping.echoes import unanswered_surfaces
from simloop.mapping.grid_kernels import (
    Evidence,
    GridLayers,
    placed_bounds,
    surface_distance,
    trace_scan,
)
from simloop.mapping.scan_match import refine
from simloop.messages import FloatArray

BYTES_A_CELL = 4 + 24 + 4 + 1 + 1 + 1.0 / MID**2 + 1.0 / TOP**2
NOWHERE_M = 100.0
"""Distance reported if the map has no surface, m."""

_CHUNK = 64  # the grid grows by this many cells; a multiple of the search fields' blocks
_NO_POINTS = np.empty((0, 2))


class GridMap:
    """Occupancy grid made of scans that are entered at given poses.

    All arrays are [iy, ix]. The lower left corner of the first cell is at ``origin_m``.

    Attributes:
        resolution_m: Side of a cell, m.
        origin_m: (2,) lower left corner of the first cell in map, m.
        log_odds: (rows, cols) float32, 0 is unknown.
        hits: (rows, cols, 3) sums of x and y of the hits, m from ``origin_m``, and their number.
        occupied: (rows, cols) bool, whether ``log_odds`` is above the threshold.
        scans: Number of scans entered.
    """

    def __init__(self, config: SlamConfig) -> None:
        """Make an empty grid without cells."""
        self._config = config
        self.resolution_m = config.resolution_m
        self.origin_m = np.zeros(2)
        self.log_odds = np.zeros((0, 0), np.float32)
        self.hits = np.zeros((0, 0, 3))
        self.occupied = np.zeros((0, 0), np.bool_)
        self._stamp = np.zeros((0, 0), np.int32)
        self._fields = tuple(np.zeros((0, 0), np.uint8) for _ in range(3))
        self._evidence = Evidence(
            config.hit_log_odds,
            config.miss_log_odds,
            config.max_log_odds,
            config.occupied_log_odds,
        )
        self.scans = 0
        self._distance: np.ndarray | None = None

    def insert(
        self,
        points: FloatArray,
        origins: FloatArray,
        pose: FloatArray,
        through: NDArray[np.bool_] | None = None,
    ) -> tuple[FloatArray, float]:
        """Enter a scan.

        Args:
            points: (n, 2) ends of the beams in base_link, m.
            origins: (n, 2) origins of the beams in base_link, m; the laser may be mounted anywhere.
            pose: (3,) x, y, yaw of base_link in map.
            through: (n,) whether a beam hit nothing at its end; None if all beams hit something.

        Returns:
            The hit means (k, 2) in map, m, of the cells that became occupied, and their share of
            all cells in which a beam ended.
        """
        if through is None:
            through = np.zeros(len(points), np.bool_)
        if not self._grow_to_hold(points, origins, pose):
            inside = self._within(points, origins, pose)
            points, origins, through = points[inside], origins[inside], through[inside]
        if len(points) == 0:
            return _NO_POINTS, 0.0
        self.scans += 1
        x0, y0 = self.origin_m.tolist()
        fresh, share = trace_scan(
            points,
            origins,
            through,
            pose,
            (x0, y0),
            self.resolution_m,
            GridLayers(self.log_odds, self.hits, self._stamp, self.occupied),
            self.scans,
            self._evidence,
        )
        raise_field(fresh, x0, y0, self.resolution_m, *self._fields)
        self._distance = None
        return fresh, share

    def refine(
        self, points: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """Refine a pose in this map; see ``scan_match.refine``.

        Args:
            points: (n, 2) hits in base_link, m.
            start: (3,) x, y, yaw of base_link in map, near the solution.

        Returns:
            Pose (3,), information (3, 3), matched share and mean residual.
        """
        return refine(
            points,
            start,
            self.hits,
            *self.origin_m.tolist(),
            self.resolution_m,
            self._config.grain_m,
            self._config.refine_steps,
        )

    def search(
        self,
        points: FloatArray,
        prior: FloatArray,
        window: FloatArray,
        weights: FloatArray,
        least: float = 0.0,
        excluded: FloatArray = NOTHING_EXCLUDED,
    ) -> tuple[FloatArray, float]:
        """Search a window for the best pose in this map; see ``correlative.search_map``.

        Args:
            points: (n, 2) hits in base_link, m.
            prior: (3,) x, y, yaw of base_link in map, the middle of the window.
            window: (2,) half the size of the window, m and rad.
            weights: (2,) penalties, 1/m^2 and 1/rad^2, on the squared offsets from the prior.
            least: The score of the pose must exceed this.
            excluded: (k, 5) x, y, yaw, radius, m, and radius, rad: poses within both radii of one
                of these places are skipped.

        Returns:
            Pose (3,), and its score; -1 if there is none.
        """
        fine, mid, top = self._fields
        fields = SearchFields(fine, mid, top, self.origin_m, self.resolution_m)
        return search_map(points, prior, window, weights, fields, least, excluded)

    def unanswered(
        self, ends: FloatArray, origins: FloatArray, pose: FloatArray, scans: int
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Find the surfaces that beams which did not come back should have measured.

        Args:
            ends: (n, 2) ends of these beams at their greatest range, in base_link, m.
            origins: (n, 2) their origins in base_link, m.
            pose: (3,) x, y, yaw of base_link in map.
            scans: Number of last scans that count as recent.

        Returns:
            The places (k, 2) in map, m, and which of these (k,) recent scans have confirmed.
        """
        x0, y0 = self.origin_m.tolist()
        places, stamps = unanswered_surfaces(
            ends, origins, pose, (x0, y0), self.resolution_m, self.occupied, self._stamp
        )
        return places, stamps > self.scans - scans

    def distances(self) -> np.ndarray:
        """Compute the distance from each cell's centre to the nearest surface.

        The result is cached until the map changes.

        Returns:
            (rows, cols) float32, m, read-only; ``NOWHERE_M`` if the map has no surface.
        """
        if self._distance is None:
            occupied = self.occupied
            distance = np.full(occupied.shape, NOWHERE_M, np.float32)
            rows, cols = np.nonzero(occupied)
            if len(rows):
                free = np.logical_not(occupied).view(np.uint8)
                _, labels = cv2.distanceTransformWithLabels(
                    free, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
                )
                hits = self.hits[rows, cols]
                places = np.zeros((len(rows) + 1, 2))
                places[labels[rows, cols]] = hits[:, :2] / np.maximum(hits[:, 2:], 1.0)
                surface_distance(labels, places, self.resolution_m, distance)
            distance.setflags(write=False)
            self._distance = distance
        return self._distance

    @classmethod
    def of(cls, config: SlamConfig, origin_m: FloatArray, log_odds: np.ndarray) -> GridMap:
        """Make a map from given log-odds, with each surface in the middle of its cell.

        Args:
            config: Settings, with the map's resolution.
            origin_m: (2,) lower left corner of the first cell in map, m.
            log_odds: (rows, cols), [iy, ix].

        Returns:
            The map, padded to a whole number of chunks.
        """
        grid = cls(config)
        rows, cols = log_odds.shape
        grid.origin_m = np.array(origin_m, np.float64)
        grid._pad(((0, rows + -rows % _CHUNK), (0, cols + -cols % _CHUNK)))
        grid.log_odds[:rows, :cols] = np.clip(log_odds, -config.max_log_odds, config.max_log_odds)
        grid.occupied[:] = grid.log_odds > config.occupied_log_odds
        at = np.nonzero(grid.occupied)
        grid.hits[at] = np.stack(
            [(k + 0.5) * config.resolution_m for k in at[::-1]] + [np.ones(len(at[0]))], axis=1
        )
        grid.scans = 1
        grid.renew_fields()
        return grid

    def renew_fields(self) -> None:
        """Rebuild the search fields, so that surfaces removed from the map disappear in them."""
        for field in self._fields:
            field[:] = 0
        raise_field(self.surfaces(), *self.origin_m.tolist(), self.resolution_m, *self._fields)

    def surfaces(self) -> FloatArray:
        """Return the surfaces in the map.

        Returns:
            (k, 2) hit mean of every occupied cell, in map, m.
        """
        hits = self.hits[self.occupied]
        return self.origin_m + hits[:, :2] / np.maximum(hits[:, 2:], 1.0)

    def fade(self, share: float) -> None:
        """Remove a share of all evidence.

        Args:
            share: 0 to 1; all log-odds are reduced by this share.
        """
        self.log_odds *= 1.0 - share
        self.occupied[:] = self.log_odds > self._config.occupied_log_odds
        self._distance = None

    def joined(self, surfaces_m: FloatArray) -> GridMap:
        """Return a read-only copy with additional surfaces.

        Args:
            surfaces_m: (k, 2) in map, m, at least one.

        Returns:
            The copy. It lacks the additional surfaces if the grid would exceed its largest size.
        """
        both = copy.copy(self)
        both.occupied, both.hits = self.occupied.copy(), self.hits.copy()
        both._distance = None
        if both._grow(surfaces_m.min(axis=0), surfaces_m.max(axis=0) + self.resolution_m):
            offsets = surfaces_m - both.origin_m
            cols, rows = np.floor(offsets / self.resolution_m).astype(int).T
            new = ~both.occupied[rows, cols]
            rows, cols = rows[new], cols[new]
            both.hits[rows, cols] = np.column_stack([offsets[new], np.ones(len(rows))])
            both.occupied[rows, cols] = True
        return both

    def _grow_to_hold(self, points: FloatArray, origins: FloatArray, pose: FloatArray) -> bool:
        """Grow the grid around a scan's beams, the robot, and a margin; return False if too large.

        The kernel skips a beam with an end near the border; with this margin it skips none.
        """
        margin = 2.0 * self.resolution_m
        low, high = pose[:2] - 0.5, pose[:2] + 0.5
        for ends in (points, origins):
            x_min, y_min, x_max, y_max = placed_bounds(ends, pose)
            low = np.minimum(low, (x_min, y_min))
            high = np.maximum(high, (x_max, y_max))
        return self._grow(low - margin, high + margin)

    def _grow(self, low: FloatArray, high: FloatArray) -> bool:
        """Grow the grid over the box from ``low`` to ``high`` (2,); return False if too large."""
        if self._holds(low, high):
            return True
        res, size = self.resolution_m, np.array(self.log_odds.shape[::-1])
        origin = self.origin_m if size.any() else np.floor(low / res) * res
        before = np.maximum(0.0, np.ceil((origin - low) / res / _CHUNK)) * _CHUNK
        top = origin + size * res
        after = np.maximum(0.0, np.ceil((high - top) / res / _CHUNK)) * _CHUNK
        # Still in floating point: a place very far away would overflow an integer. NaN is refused,
        # and so is a line without width.
        sides = np.maximum(size + before + after, 1.0)
        if not np.prod(sides) <= self._config.max_cells:
            return False
        before, after = before.astype(int), after.astype(int)
        self.origin_m = origin
        self._pad(((before[1], after[1]), (before[0], after[0])))
        # Hit sums are relative to the grid's corner, which has moved.
        shift = before * res
        self.hits[..., :2] += self.hits[..., 2:] * shift
        self.origin_m = self.origin_m - shift
        return True

    def _pad(self, pads: tuple[tuple[int, int], tuple[int, int]]) -> None:
        self.log_odds = np.pad(self.log_odds, pads)
        self._stamp = np.pad(self._stamp, pads)
        self.occupied = np.pad(self.occupied, pads)
        self.hits = np.pad(self.hits, (*pads, (0, 0)))
        grown = []
        for field, side in zip(self._fields, (1, MID, TOP), strict=True):
            grown.append(np.pad(field, [[p // side for p in pad] for pad in pads]))
        self._fields = tuple(grown)
        self._distance = None  # it has the old extent

    def _within(
        self, points: FloatArray, origins: FloatArray, pose: FloatArray
    ) -> NDArray[np.bool_]:
        """Return (n,) whether both ends of each beam lie inside the grid."""
        inside = np.ones(len(points), np.bool_)
        size = self.resolution_m * np.array(self.log_odds.shape[::-1])
        for ends in (points, origins):
            off = transform_points(pose, ends) - self.origin_m
            inside &= np.all((off > self.resolution_m) & (off < size - self.resolution_m), axis=1)
        return inside

    def _holds(self, low: FloatArray, high: FloatArray) -> bool:
        """Return whether the grid contains the box from ``low`` to ``high``, (2,) each."""
        rows, cols = self.log_odds.shape
        (x0, y0), res = self.origin_m.tolist(), self.resolution_m
        return bool(
            x0 <= low[0]
            and y0 <= low[1]
            and high[0] <= x0 + cols * res
            and high[1] <= y0 + rows * res
        )
