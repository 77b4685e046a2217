"""Trace beams in the occupancy grid and compute distances finer than its cells (compiled)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_SHORT_OF_HIT = 2.0  # a beam votes no cells free in this distance before its hit, cells


class GridLayers(NamedTuple):
    """Data of each cell of the grid; all arrays are [iy, ix].

    Attributes:
        log_odds: (rows, cols) evidence that the cell is occupied; 0 is unknown.
        hits: (rows, cols, 3) sums of x and y of the hits, m from the grid's lower left corner, and
            the number of hits.
        stamp: (rows, cols) number of the last scan that touched the cell.
        occupied: (rows, cols) whether ``log_odds`` is above the threshold.
    """

    log_odds: NDArray[np.float32]
    hits: FloatArray
    stamp: NDArray[np.int32]
    occupied: NDArray[np.bool_]


class Evidence(NamedTuple):
    """Log-odds that one scan adds to a cell.

    Attributes:
        hit: Added where a beam ended.
        miss: Subtracted where a beam passed.
        most: Bound of the log-odds, positive and negative.
        threshold: A cell with higher log-odds is occupied.
    """

    hit: float
    miss: float
    most: float
    threshold: float


@njit(cache=True)
def trace_scan(
    points: FloatArray,
    origins: FloatArray,
    through: NDArray[np.bool_],
    pose: FloatArray,
    corner: tuple[float, float],
    resolution: float,
    layers: GridLayers,
    scan_number: int,
    evidence: Evidence,
) -> tuple[FloatArray, float]:
    """Add one scan to the grid: its hits, then the free cells that its beams crossed.

    Each cell gets one vote per scan. A cell in which a beam ended gets no free vote from beams
    that passed it. A beam is skipped if it is not finite, or if one of its ends lies in the
    outermost cells or outside the grid. So no index leaves the grid.

    Args:
        points: (n, 2) ends of the beams in base_link, m.
        origins: (n, 2) origins of the beams in base_link, m.
        through: (n,) whether a beam hit nothing at its end.
        pose: (3,) x, y, yaw of base_link in map.
        corner: x, y of the grid's lower left corner in map, m.
        resolution: Side of a cell, m.
        layers: The grid, changed in place.
        scan_number: Number of the scan, from 1.
        evidence: Log-odds of a hit and of a miss.

    Returns:
        The hit means (k, 2) in map, m, of the k cells that became occupied, and their share of all
        cells in which a beam ended.
    """
    ends = _from_corner(points, pose, corner)
    starts = _from_corner(origins, pose, corner)
    valid = _inside(ends, starts, layers.log_odds.shape, resolution)
    # Cells are addressed by one running index. Flat views are made once, not for each beam.
    cols = layers.log_odds.shape[1]
    hits = layers.hits.reshape(-1, 3)
    flat = GridLayers(layers.log_odds.ravel(), hits, layers.stamp.ravel(), layers.occupied.ravel())
    fresh, ended = _vote_hits(ends, valid & ~through, resolution, flat, cols, scan_number, evidence)
    # Free votes come last: by then, all cells in which a beam ended have this scan's stamp.
    for i in range(points.shape[0]):
        if valid[i]:
            _vote_free(
                starts[i], ends[i], through[i], resolution, flat, cols, scan_number, evidence
            )
    places = np.empty((len(fresh), 2))
    for i in range(len(fresh)):
        n = hits[fresh[i], 2]
        places[i, 0] = corner[0] + hits[fresh[i], 0] / n
        places[i, 1] = corner[1] + hits[fresh[i], 1] / n
    return places, len(fresh) / max(1, ended)


@njit(cache=True)
def _from_corner(points: FloatArray, pose: FloatArray, corner: tuple[float, float]) -> FloatArray:
    """Transform points (n, 2) from base_link at ``pose`` to offsets from the corner, m."""
    cos, sin, out = math.cos(pose[2]), math.sin(pose[2]), np.empty((points.shape[0], 2))
    for i in range(points.shape[0]):
        out[i, 0] = pose[0] + cos * points[i, 0] - sin * points[i, 1] - corner[0]
        out[i, 1] = pose[1] + sin * points[i, 0] + cos * points[i, 1] - corner[1]
    return out


@njit(cache=True)
def _inside(
    ends: FloatArray, starts: FloatArray, shape: tuple[int, int], resolution: float
) -> NDArray[np.bool_]:
    """Return (n,) whether both ends of a beam lie inside the border cells; False for NaN.

    A straight beam between two such points stays in the grid even if its steps are rounded.
    """
    rows, cols = shape
    out = np.empty(ends.shape[0], np.bool_)
    for i in range(ends.shape[0]):
        good = True
        for x, y in ((ends[i, 0], ends[i, 1]), (starts[i, 0], starts[i, 1])):
            # A NaN fails these comparisons.
            good &= resolution <= x and x < (cols - 1) * resolution
            good &= resolution <= y and y < (rows - 1) * resolution
        out[i] = good
    return out


@njit(cache=True, forceinline=True)
def _vote_hits(
    ends: FloatArray,
    valid: NDArray[np.bool_],
    resolution: float,
    flat: GridLayers,
    cols: int,
    scan_number: int,
    evidence: Evidence,
) -> tuple[NDArray[np.int64], int]:
    """Add the hits; return the cells (k,) that became occupied, and the number of hit cells."""
    odds, hits, stamp, occupied = flat
    fresh, count, ended = np.empty(ends.shape[0], np.int64), 0, 0
    for i in range(ends.shape[0]):
        if not valid[i]:
            continue
        x, y = ends[i, 0], ends[i, 1]
        cell = math.floor(y / resolution) * cols + math.floor(x / resolution)
        # Every hit counts for the mean, but only the first hit in a cell votes.
        hits[cell, 0] += x
        hits[cell, 1] += y
        hits[cell, 2] += 1.0
        if stamp[cell] != scan_number:
            stamp[cell] = scan_number
            ended += 1
            odds[cell] = min(evidence.most, odds[cell] + evidence.hit)
            if odds[cell] > evidence.threshold and not occupied[cell]:
                occupied[cell] = True
                fresh[count] = cell
                count += 1
    return fresh[:count], ended


@njit(cache=True, forceinline=True)
def _vote_free(
    start: FloatArray,
    end: FloatArray,
    through: bool,
    resolution: float,
    flat: GridLayers,
    cols: int,
    scan_number: int,
    evidence: Evidence,
) -> None:
    """Vote the cells free that a beam crossed (Amanatides & Woo 1987).

    The free votes stop two cells before the hit. Otherwise they would remove the hits on the near
    side of a wall's noise, and the wall's hit mean would move away from the robot.
    """
    odds, hits, stamp, occupied = flat
    ax, ay = start[0] / resolution, start[1] / resolution
    dx, dy = end[0] / resolution - ax, end[1] / resolution - ay
    length = math.hypot(dx, dy)
    last = length if through else length - _SHORT_OF_HIT
    if last < 1.0:
        return
    dx, dy = dx / length, dy / length
    col, row = math.floor(ax), math.floor(ay)
    step_x, step_y = (1 if dx > 0 else -1), (cols if dy > 0 else -cols)
    # Length of the beam between two grid lines, and to the first grid line, for each axis.
    grow_x = abs(1.0 / dx) if dx != 0.0 else 1e18
    grow_y = abs(1.0 / dy) if dy != 0.0 else 1e18
    to_x = ((col + 1 - ax) if dx > 0 else (ax - col)) * grow_x
    to_y = ((row + 1 - ay) if dy > 0 else (ay - row)) * grow_y
    travelled, cell = 0.0, row * cols + col
    while travelled < last:
        if stamp[cell] != scan_number:
            stamp[cell] = scan_number
            value = max(-evidence.most, odds[cell] - evidence.miss)
            odds[cell] = value
            if value <= evidence.threshold:
                occupied[cell] = False
            # A cell that is clearly free loses its hits.
            if value < 0.0 and hits[cell, 2] > 0.0:
                hits[cell, :] = 0.0
        if to_x < to_y:
            travelled = to_x
            to_x += grow_x
            cell += step_x
        else:
            travelled = to_y
            to_y += grow_y
            cell += step_y


@njit(cache=True)
def placed_bounds(points: FloatArray, pose: FloatArray) -> tuple[float, float, float, float]:
    """Compute the bounding box in map of points given in base_link.

    Args:
        points: (n, 2) in base_link, m.
        pose: (3,) x, y, yaw of base_link in map.

    Returns:
        x_min, y_min, x_max, y_max, m. Without points: +inf, +inf, -inf, -inf.
    """
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
    """Compute the distance from each cell's centre to the hit mean of the nearest occupied cell.

    Args:
        labels: (rows, cols) number of the nearest occupied cell, from 1.
        places: (n + 1, 2) hit mean of each number, m from the grid's lower left corner.
        resolution: Side of a cell, m.
        distance: (rows, cols) output, m.
    """
    for row in range(labels.shape[0]):
        y = (row + 0.5) * resolution
        for col in range(labels.shape[1]):
            x, k = (col + 0.5) * resolution, labels[row, col]
            distance[row, col] = math.hypot(x - places[k, 0], y - places[k, 1])
