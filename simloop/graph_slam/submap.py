"""A submap: the scans of some metres of way, in the frame in which they were matched."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import SlamConfig
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray

_FREE_BELOW = -0.3  # log-odds: seen free more than once, and not a surface


class Submap:
    """A grid in the front end's own smooth frame, and the keyframes that are in it.

    ``anchor``: the number of the first keyframe, ``anchor_pose`` (3,) where it stood in that
    frame: what the graph does to the anchor, it does to the submap.
    """

    def __init__(self, config: SlamConfig, anchor: int, anchor_pose: FloatArray) -> None:
        self.grid = GridMap(config)
        self.anchor, self.anchor_pose = anchor, np.array(anchor_pose, np.float64)
        self.keyframes: list[int] = []
        self.finished = False

    def add(self, keyframe: int, points: FloatArray, origins: FloatArray, pose: FloatArray) -> None:
        """Enter a keyframe's scan at ``pose`` (3,)."""
        self.keyframes.append(keyframe)
        self.grid.insert(points, origins, pose)

    def finish(self) -> None:
        """Nothing more will be entered."""
        self.finished = True
        self.grid.renew_fields()


def meetings(grid: GridMap, points: FloatArray, pose: FloatArray) -> tuple[float, float]:
    """Of points (n, 2) at ``pose`` (3,): (share that meet surfaces among those that meet anything
    known, share that meet anything known).
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
    """How many points lie within a cell of a surface, and how many in the midst of free cells."""
    rows, cols = log_odds.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    met, free = 0, 0
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1]
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1]
        row, col = math.floor((y - y0) / resolution), math.floor((x - x0) / resolution)
        if not (1 <= row < rows - 1 and 1 <= col < cols - 1):
            continue
        near = False
        for r in range(row - 1, row + 2):
            for c in range(col - 1, col + 2):
                near = near or occupied[r, c]
        if near:
            met += 1
        elif log_odds[row, col] < _FREE_BELOW:
            free += 1
    return met, free
