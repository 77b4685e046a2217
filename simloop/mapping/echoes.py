"""Find the surfaces of the map that a scan should have measured and did not (compiled).

A beam that comes back proves that the LiDAR works. A beam that does not come back proves nothing:
there may be nothing within range, or the sensor may be blind. The map can tell, because a beam that
meets a known surface must come back.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_SHORT_CELLS = 2.0  # a surface so near the greatest range may or may not be measured


@njit(cache=True)
def unanswered_surfaces(
    ends: FloatArray,
    origins: FloatArray,
    pose: FloatArray,
    corner: tuple[float, float],
    resolution: float,
    occupied: NDArray[np.bool_],
    stamp: NDArray[np.int32],
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Walk along beams that did not come back, to the first surface of the map on each.

    Args:
        ends: (n, 2) ends of the beams at their greatest range, in base_link, m.
        origins: (n, 2) origins of the beams in base_link, m.
        pose: (3,) x, y, yaw of base_link in map.
        corner: x, y of the grid's lower left corner in map, m.
        resolution: Side of a cell, m.
        occupied: (rows, cols) whether there is a surface in a cell.
        stamp: (rows, cols) number of the last scan that touched the cell.

    Returns:
        Places (k, 2) in map, m, where k beams met a surface, and the stamps (k,) of these cells.
    """
    rows, cols = occupied.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    places, stamps, count = np.empty(ends.shape), np.empty(ends.shape[0], np.int32), 0
    for i in range(ends.shape[0]):
        ax = (pose[0] + cos * origins[i, 0] - sin * origins[i, 1] - corner[0]) / resolution
        ay = (pose[1] + sin * origins[i, 0] + cos * origins[i, 1] - corner[1]) / resolution
        bx = (pose[0] + cos * ends[i, 0] - sin * ends[i, 1] - corner[0]) / resolution
        by = (pose[1] + sin * ends[i, 0] + cos * ends[i, 1] - corner[1]) / resolution
        length = math.hypot(bx - ax, by - ay)
        # A NaN ends the loop at once.
        steps = math.floor(2.0 * (length - _SHORT_CELLS)) if length < 1e9 else 0
        for k in range(1, steps + 1):
            x, y = ax + 0.5 * k / length * (bx - ax), ay + 0.5 * k / length * (by - ay)
            col, row = math.floor(x), math.floor(y)
            if 0 <= row < rows and 0 <= col < cols and occupied[row, col]:
                places[count, 0] = corner[0] + x * resolution
                places[count, 1] = corner[1] + y * resolution
                stamps[count] = stamp[row, col]
                count += 1
                break
    return places[:count].copy(), stamps[:count].copy()
