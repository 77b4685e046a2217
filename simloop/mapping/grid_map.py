"""The occupancy grid: log-odds, the sums of the hits in each cell, and fields to search in.

It grows as needed, by chunks, up to a bound in cells; what lies beyond is not entered. A cell takes
``BYTES_A_CELL``, so that the bound is one of memory too.
"""

from __future__ import annotations

import copy

import cv2
import numpy as np
from numpy.typing import NDArray

from simloop.config import SlamConfig
from simloop.geometry.se2 import transform_points
from simloop.mapping.correlative import MID, TOP, raise_field, search
from simloop.mapping.grid_kernels import placed_bounds, surface_distance, trace_scan
from simloop.mapping.scan_match import refine
from simloop.messages import FloatArray

BYTES_A_CELL = 4 + 24 + 4 + 1 + 1 + 1.0 / MID**2 + 1.0 / TOP**2
NOWHERE_M = 100.0
"""Distance reported where the map holds nothing."""

_CHUNK = 64  # cells by which the grid grows; a multiple of the search fields' blocks
_NONE = np.empty((0, 2))
_ANYWHERE = np.empty((0, 5))
_FINEST_TURN_RAD = 0.004
_COARSEST_TURN_RAD = 0.02


class GridMap:
    """Scans entered at given poses. All arrays are [iy, ix], the first cell at ``origin_m``."""

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self.resolution_m = config.resolution_m
        self.origin_m = np.zeros(2)
        self.log_odds = np.zeros((0, 0), np.float32)
        self.hits = np.zeros((0, 0, 3))
        self.occupied = np.zeros((0, 0), np.bool_)
        self._stamp = np.zeros((0, 0), np.int32)
        self._fields = tuple(np.zeros((0, 0), np.uint8) for _ in range(3))
        self.scans = 0
        self._distance: np.ndarray | None = None

    def insert(
        self,
        points: FloatArray,
        origins: FloatArray,
        pose: FloatArray,
        through: NDArray[np.bool_] | None = None,
    ) -> tuple[FloatArray, float]:
        """Enter a scan, points and origins (n, 2) in base_link at ``pose`` (3,).

        through: (n,) beams that met nothing where they end. Returns where, (k, 2) in map, cells
        became occupied by it, and their share of all cells in which its beams ended.
        """
        if through is None:
            through = np.zeros(len(points), np.bool_)
        if not self._grow_to_hold(points, pose):
            inside = self._within(points, origins, pose)
            points, origins, through = points[inside], origins[inside], through[inside]
        if len(points) == 0:
            return _NONE, 0.0
        self.scans += 1
        config = self._config
        fresh, share = trace_scan(
            points,
            origins,
            through,
            pose,
            *self.origin_m.tolist(),
            self.resolution_m,
            self.log_odds,
            self.hits,
            self._stamp,
            self.occupied,
            self.scans,
            config.hit_log_odds,
            config.miss_log_odds,
            config.max_log_odds,
            config.occupied_log_odds,
        )
        raise_field(fresh, *self.origin_m.tolist(), self.resolution_m, *self._fields)
        self._distance = None
        return fresh, share

    def refine(
        self, points: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """``scan_match.refine`` in this map."""
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
        but: FloatArray = _ANYWHERE,
    ) -> tuple[FloatArray, float]:
        """``correlative.search`` in this map; the turns step by about a cell at the points."""
        far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.8))
        step = float(np.clip(self.resolution_m / far, _FINEST_TURN_RAD, _COARSEST_TURN_RAD))
        return search(
            points,
            prior,
            window,
            weights,
            *self._fields,
            self.origin_m,
            self.resolution_m,
            step,
            least,
            but,
        )

    def distances(self) -> np.ndarray:
        """(rows, cols) float32, m, to the nearest surface; cached until the map changes."""
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
        """A map that begins with given log-odds (rows, cols): each surface in its cell's middle.

        origin_m: (2,) of the first cell's lower left corner.
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
        """Make the search's fields anew, without surfaces that have gone from the map since."""
        for field in self._fields:
            field[:] = 0
        raise_field(self.surfaces(), *self.origin_m.tolist(), self.resolution_m, *self._fields)

    def surfaces(self) -> FloatArray:
        """(k, 2) m, the hit mean of every occupied cell."""
        hits = self.hits[self.occupied]
        return self.origin_m + hits[:, :2] / np.maximum(hits[:, 2:], 1.0)

    def fade(self, share: float) -> None:
        """Forget a share of all evidence."""
        self.log_odds *= 1.0 - share
        self.occupied[:] = self.log_odds > self._config.occupied_log_odds
        self._distance = None

    def joined(self, surfaces_m: FloatArray) -> GridMap:
        """A copy, to be looked at only, in which further surfaces (k, 2), in map, stand too."""
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

    def _grow_to_hold(self, points: FloatArray, pose: FloatArray) -> bool:
        """Make the grid hold all points of the scan, the robot, and a margin; False: it may not."""
        margin = 2.0 * self.resolution_m
        x_min, y_min, x_max, y_max = placed_bounds(points, pose)
        low = np.array((min(x_min, pose[0] - 0.5) - margin, min(y_min, pose[1] - 0.5) - margin))
        high = np.array((max(x_max, pose[0] + 0.5) + margin, max(y_max, pose[1] + 0.5) + margin))
        return self._grow(low, high)

    def _grow(self, low: FloatArray, high: FloatArray) -> bool:
        """Make the grid reach over the box from ``low`` to ``high``, (2,) each; False: it may
        not."""
        if self._holds(low, high):
            return True
        res, size = self.resolution_m, np.array(self.log_odds.shape[::-1])
        origin = self.origin_m if size.any() else np.floor(low / res) * res
        before = np.maximum(0, np.ceil((origin - low) / res / _CHUNK)).astype(int) * _CHUNK
        top = origin + size * res
        after = np.maximum(0, np.ceil((high - top) / res / _CHUNK)).astype(int) * _CHUNK
        if np.prod(size + before + after, dtype=float) > self._config.max_cells:
            return False
        self.origin_m = origin
        self._pad(((before[1], after[1]), (before[0], after[0])))
        # Hit sums are taken from the grid's corner, which moves.
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

    def _within(
        self, points: FloatArray, origins: FloatArray, pose: FloatArray
    ) -> NDArray[np.bool_]:
        """(n,) which beams, points and origins, lie wholly inside the grid."""
        inside = np.ones(len(points), np.bool_)
        size = self.resolution_m * np.array(self.log_odds.shape[::-1])
        for ends in (points, origins):
            off = transform_points(pose, ends) - self.origin_m
            inside &= np.all((off > self.resolution_m) & (off < size - self.resolution_m), axis=1)
        return inside

    def _holds(self, low: FloatArray, high: FloatArray) -> bool:
        """Whether the grid reaches over the box from ``low`` to ``high``, (2,) each."""
        rows, cols = self.log_odds.shape
        (x0, y0), res = self.origin_m.tolist(), self.resolution_m
        return bool(
            x0 <= low[0]
            and y0 <= low[1]
            and high[0] <= x0 + cols * res
            and high[1] <= y0 + rows * res
        )
