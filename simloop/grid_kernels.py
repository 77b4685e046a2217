"""Compiled kernels of the occupancy grid: tracing beams, and distances finer than its cells."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray


@njit(cache=True)
def trace_scan(
    points: FloatArray,
    origins: FloatArray,
    pose: FloatArray,
    x0: float,
    y0: float,
    resolution: float,
    log_odds: NDArray[np.float32],
    hits: FloatArray,
    stamp: NDArray[np.int32],
    scan_number: int,
    hit: float,
    miss: float,
    most: float,
) -> None:
    """Enter one scan: its hits, then the free cells that its beams crossed.

    points, origins: (n, 2) in base_link at ``pose`` (3,) in map; (x0, y0): the grid's lower left
    corner. log_odds: (rows, cols); hits: (rows, cols, 3) sums of x and y from (x0, y0), and count;
    stamp: (rows, cols) the last scan that touched a cell. A cell gets one vote a scan, and one in
    which a beam ended is not voted free by the beams that only passed it. What is voted free for
    good forgets its hits.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1] - x0
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1] - y0
        row, col = math.floor(y / resolution), math.floor(x / resolution)
        hits[row, col, 0] += x
        hits[row, col, 1] += y
        hits[row, col, 2] += 1.0
        if stamp[row, col] != scan_number:
            stamp[row, col] = scan_number
            log_odds[row, col] = min(most, log_odds[row, col] + hit)
    for i in range(points.shape[0]):
        ax = (pose[0] + cos * origins[i, 0] - sin * origins[i, 1] - x0) / resolution
        ay = (pose[1] + sin * origins[i, 0] + cos * origins[i, 1] - y0) / resolution
        bx = (pose[0] + cos * points[i, 0] - sin * points[i, 1] - x0) / resolution
        by = (pose[1] + sin * points[i, 0] + cos * points[i, 1] - y0) / resolution
        # Stop a cell short: a beam that ends in a wall says nothing of the wall's own edge.
        dx, dy = bx - ax, by - ay
        length = math.hypot(dx, dy)
        if length < 2.0:
            continue
        dx, dy = dx / length, dy / length
        col, row = math.floor(ax), math.floor(ay)
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        grow_x = abs(1.0 / dx) if dx != 0.0 else 1e18
        grow_y = abs(1.0 / dy) if dy != 0.0 else 1e18
        to_x = ((col + 1 - ax) if dx > 0 else (ax - col)) * grow_x
        to_y = ((row + 1 - ay) if dy > 0 else (ay - row)) * grow_y
        travelled = 0.0
        while travelled < length - 1.0:
            if stamp[row, col] != scan_number:
                stamp[row, col] = scan_number
                value = max(-most, log_odds[row, col] - miss)
                log_odds[row, col] = value
                if value < 0.0:
                    hits[row, col, :] = 0.0
            if to_x < to_y:
                travelled = to_x
                to_x += grow_x
                col += step_x
            else:
                travelled = to_y
                to_y += grow_y
                row += step_y


@njit(cache=True)
def surface_distance(
    labels: NDArray[np.int32],
    places: FloatArray,
    resolution: float,
    distance: NDArray[np.float32],
) -> None:
    """Distance (rows, cols), m, of each cell's centre to the hit mean of the occupied cell nearest it.

    labels: (rows, cols) number of that cell, from 1; places: (n + 1, 2) its hit mean, m from the
    grid's lower left corner.
    """
    for row in range(labels.shape[0]):
        y = (row + 0.5) * resolution
        for col in range(labels.shape[1]):
            x, k = (col + 0.5) * resolution, labels[row, col]
            distance[row, col] = math.hypot(x - places[k, 0], y - places[k, 1])
