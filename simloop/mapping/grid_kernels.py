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
    through: NDArray[np.bool_],
    pose: FloatArray,
    x0: float,
    y0: float,
    resolution: float,
    log_odds: NDArray[np.float32],
    hits: FloatArray,
    stamp: NDArray[np.int32],
    occupied: NDArray[np.bool_],
    scan_number: int,
    hit: float,
    miss: float,
    most: float,
    threshold: float,
) -> tuple[FloatArray, float]:
    """Enter one scan: its hits, then the free cells that its beams crossed.

    points, origins: (n, 2) in base_link at ``pose`` (3,) in map; through: (n,) beams that met
    nothing where they end; (x0, y0): the grid's lower left corner. log_odds: (rows, cols); hits:
    (rows, cols, 3) sums of x and y from (x0, y0), and count; stamp: (rows, cols) the last scan that
    touched a cell; occupied: (rows, cols) log_odds above ``threshold``, kept so. A cell gets one
    vote a scan, and one in which a beam ended is not voted free by the beams that only passed it.
    What is voted free for good forgets its hits.

    The free cells of a beam end two cells short of its own: the near half of the noise about a
    wall must not be voted away, or the wall's hit mean would recede from whoever looks at it.

    Returns the surfaces, (k, 2) hit means in map, of the k cells that became occupied, and their
    share of all cells in which a beam ended.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    # Cells by one running number: a beam's step is an addition.
    cols = log_odds.shape[1]
    odds_of, stamp_of, occupied_of = log_odds.ravel(), stamp.ravel(), occupied.ravel()
    hits_of = hits.reshape(-1, 3)
    ends = np.empty((points.shape[0], 2))
    fresh, count, ended = np.empty(points.shape[0], np.int64), 0, 0
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1] - x0
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1] - y0
        ends[i, 0], ends[i, 1] = x / resolution, y / resolution
        if through[i]:
            continue
        cell = math.floor(ends[i, 1]) * cols + math.floor(ends[i, 0])
        hits_of[cell, 0] += x
        hits_of[cell, 1] += y
        hits_of[cell, 2] += 1.0
        if stamp_of[cell] != scan_number:
            stamp_of[cell] = scan_number
            ended += 1
            odds_of[cell] = min(most, odds_of[cell] + hit)
            if odds_of[cell] > threshold and not occupied_of[cell]:
                occupied_of[cell] = True
                fresh[count] = cell
                count += 1
    for i in range(points.shape[0]):
        ax = (pose[0] + cos * origins[i, 0] - sin * origins[i, 1] - x0) / resolution
        ay = (pose[1] + sin * origins[i, 0] + cos * origins[i, 1] - y0) / resolution
        dx, dy = ends[i, 0] - ax, ends[i, 1] - ay
        length = math.hypot(dx, dy)
        last = length if through[i] else length - 2.0
        if last < 1.0:
            continue
        dx, dy = dx / length, dy / length
        col, row = math.floor(ax), math.floor(ay)
        step_x, step_y = (1 if dx > 0 else -1), (cols if dy > 0 else -cols)
        grow_x = abs(1.0 / dx) if dx != 0.0 else 1e18
        grow_y = abs(1.0 / dy) if dy != 0.0 else 1e18
        to_x = ((col + 1 - ax) if dx > 0 else (ax - col)) * grow_x
        to_y = ((row + 1 - ay) if dy > 0 else (ay - row)) * grow_y
        travelled, cell = 0.0, row * cols + col
        while travelled < last:
            if stamp_of[cell] != scan_number:
                stamp_of[cell] = scan_number
                value = max(-most, odds_of[cell] - miss)
                odds_of[cell] = value
                if value <= threshold:
                    occupied_of[cell] = False
                if value < 0.0 and hits_of[cell, 2] > 0.0:
                    hits_of[cell, :] = 0.0
            if to_x < to_y:
                travelled = to_x
                to_x += grow_x
                cell += step_x
            else:
                travelled = to_y
                to_y += grow_y
                cell += step_y
    places = np.empty((count, 2))
    for i in range(count):
        n = hits_of[fresh[i], 2]
        places[i, 0] = x0 + hits_of[fresh[i], 0] / n
        places[i, 1] = y0 + hits_of[fresh[i], 1] / n
    return places, count / max(1, ended)


@njit(cache=True)
def placed_bounds(points: FloatArray, pose: FloatArray) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max in map of points (n, 2) given in base_link at ``pose`` (3,)."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x_min, y_min, x_max, y_max = np.inf, np.inf, -np.inf, -np.inf
    for i in range(points.shape[0]):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1]
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1]
        x_min, x_max = min(x_min, x), max(x_max, x)
        y_min, y_max = min(y_min, y), max(y_max, y)
    return x_min, y_min, x_max, y_max


@njit(cache=True)
def surface_distance(
    labels: NDArray[np.int32],
    places: FloatArray,
    resolution: float,
    distance: NDArray[np.float32],
) -> None:
    """Distance (rows, cols), m, of each cell's centre to the hit mean of the nearest occupied cell.

    labels: (rows, cols) number of that cell, from 1; places: (n + 1, 2) its hit mean, m from the
    grid's lower left corner.
    """
    for row in range(labels.shape[0]):
        y = (row + 0.5) * resolution
        for col in range(labels.shape[1]):
            x, k = (col + 0.5) * resolution, labels[row, col]
            distance[row, col] = math.hypot(x - places[k, 0], y - places[k, 1])
