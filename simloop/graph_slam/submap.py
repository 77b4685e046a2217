"""Keep a submap: the scans of a few metres of travel, in the frame of the scan matching."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import SlamConfig
from simloop.graph_slam.densify import densified
from simloop.graph_slam.evidence import FREE_BELOW
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray


class Submap:
    """Grid in the smooth frame of the front end, with the keyframes that were entered in it.

    The submap moves with its first keyframe, the anchor: when the graph moves the anchor in map,
    the whole submap moves with it.

    A finished submap may forget its grid, because the grids of a long way take gigabytes. It is
    made again from the scans when it is needed.

    Attributes:
        anchor: number of the anchor.
        anchor_pose: (3,) base_link at the anchor, in the front end's frame.
        keyframes: numbers of all keyframes in the grid.
        finished: whether it is complete. Only finished submaps are searched for loop closures.
    """

    def __init__(self, config: SlamConfig, anchor: int, anchor_pose: FloatArray) -> None:
        """Make an empty submap.

        Args:
            config: settings of the grid.
            anchor: number of the first keyframe.
            anchor_pose: (3,) its base_link in the front end's frame.
        """
        self._config = config
        self._grid: GridMap | None = GridMap(config)
        self._entered: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        self.anchor, self.anchor_pose = anchor, np.array(anchor_pose, np.float64)
        self.keyframes: list[int] = []
        self.finished = False

    def add(self, keyframe: int, points: FloatArray, origins: FloatArray, pose: FloatArray) -> None:
        """Enter a keyframe's scan.

        Args:
            keyframe: its number.
            points: (n, 2) hits in base_link, m.
            origins: (n, 2) origin of each beam in base_link, m.
            pose: (3,) base_link in the front end's frame.
        """
        self.keyframes.append(keyframe)
        self._entered.append((points, origins, pose.copy()))
        _enter(self.grid, points, origins, pose)

    @property
    def grid(self) -> GridMap:
        """The occupancy grid, in the front end's frame."""
        if self._grid is None:
            self._grid = GridMap(self._config)
            for points, origins, pose in self._entered:
                _enter(self._grid, points, origins, pose)
            self._grid.renew_fields()
        return self._grid

    def finish(self) -> None:
        """Mark the submap as complete, and prepare it for searches."""
        self.finished = True
        self.grid.renew_fields()

    def forget_grid(self) -> None:
        """Free the memory of the grid of a finished submap."""
        if self.finished:
            self._grid = None


def _enter(grid: GridMap, points: FloatArray, origins: FloatArray, pose: FloatArray) -> None:
    """Enter a scan, with the gaps between its hits filled."""
    hits, starts = densified(points, origins, grid.resolution_m)
    grid.insert(hits, starts, pose)


def meetings(grid: GridMap, points: FloatArray, pose: FloatArray) -> tuple[float, float]:
    """Measure how well a scan agrees with a map.

    Points in free cells count against a pose. The score of the scan matcher does not see them,
    because it only rewards points on surfaces.

    Args:
        grid: the map.
        points: (n, 2) hits in base_link, m.
        pose: (3,) base_link in the grid's frame.

    Returns:
        The share of points on surfaces among those in known cells, and the share of points in
        known cells.
    """
    met, free = _meetings(
        points,
        pose,
        *grid.origin_m.tolist(),
        grid.resolution_m,
        grid.log_odds,
        grid.occupied,
    )
    return met / max(1, met + free), (met + free) / max(1, len(points))


@njit(cache=True)
def _meetings(
    points: FloatArray,
    pose: FloatArray,
    x0: float,
    y0: float,
    resolution: float,
    log_odds: NDArray[np.float32],
    occupied: NDArray[np.bool_],
) -> tuple[int, int]:
    """Count the points on or next to a surface, and the points among free cells."""
    rows, cols = log_odds.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    met, free = 0, 0
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1]
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1]
        row, col = math.floor((y - y0) / resolution), math.floor((x - x0) / resolution)
        # Points in the border cells are skipped, so that every cell has eight neighbours.
        if not (1 <= row < rows - 1 and 1 <= col < cols - 1):
            continue
        # A point beside a surface does not contradict the map: poses and surfaces have errors of
        # about a cell.
        near = False
        for r in range(row - 1, row + 2):
            for c in range(col - 1, col + 2):
                near = near or occupied[r, c]
        if near:
            met += 1
        elif log_odds[row, col] < FREE_BELOW:
            free += 1
    return met, free
