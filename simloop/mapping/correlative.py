"""Match a scan by correlation: find the best pose in a window by branch and bound.

The method follows Olson 2009 ("Real-time correlative scan matching") and Hess et al. 2016
("Real-time loop closure in 2D LIDAR SLAM"). A field holds the likelihood of a hit in each cell.
Two coarser fields hold its maxima over blocks of 4 x 4 and of 16 x 16 cells. A coarse sum is an
upper bound of every fine sum under it. So one sum can rule out a whole block of translations, and
the result is still exact.

All three fields are updated when a surface is added to the map: it raises a few cells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

MID, TOP = 4, 16
"""Sides of the coarser fields' blocks, in cells."""

_REACH = 3  # a surface raises the cells up to this many cells away
_FINEST_TURN_RAD = 0.004  # smallest step of the headings in a search
_COARSEST_TURN_RAD = 0.02  # largest step of the headings in a search
NOTHING_EXCLUDED = np.empty((0, 5))
"""What is excluded from a search by default."""

Field = NDArray[np.uint8]


class SearchFields(NamedTuple):
    """Likelihood of a hit at three resolutions; see ``raise_field``.

    Attributes:
        fine: (rows, cols) likelihood of each cell, 0 to 255.
        mid: (rows / 4, cols / 4) maxima of ``fine``.
        top: (rows / 16, cols / 16) maxima of ``fine``.
        corner: (2,) lower left corner of the first cell, m.
        resolution: Side of a cell of ``fine``, m.
        outside: Likelihood outside the fields, 0 to 255.
    """

    fine: Field
    mid: Field
    top: Field
    corner: FloatArray
    resolution: float
    outside: int = 0


@njit(cache=True)
def raise_field(
    places: FloatArray, x0: float, y0: float, resolution: float, fine: Field, mid: Field, top: Field
) -> None:
    """Add surfaces to the fields.

    Each surface adds a Gaussian with a standard deviation of one cell and a peak of 255.

    Args:
        places: (k, 2) the surfaces, m.
        x0: x of the fields' lower left corner, m.
        y0: y of the fields' lower left corner, m.
        resolution: Side of a cell of ``fine``, m.
        fine: (rows, cols), changed in place.
        mid: (rows / 4, cols / 4), changed in place: [i, j] is the maximum of ``fine`` over the
            rows [4 i, 4 i + 8) and the columns [4 j, 4 j + 8). It covers two blocks a side, so
            that it is also a bound for any shift within one block.
        top: (rows / 16, cols / 16), the same with blocks of 16.
    """
    rows, cols = fine.shape
    for k in range(places.shape[0]):
        px, py = (places[k, 0] - x0) / resolution, (places[k, 1] - y0) / resolution
        # Beyond the fields it raises nothing; far beyond, its cell would overflow an integer.
        across, along = -_REACH <= px < cols + _REACH, -_REACH <= py < rows + _REACH
        if not (across and along):
            continue
        col, row = math.floor(px), math.floor(py)
        for r in range(max(0, row - _REACH), min(rows, row + _REACH + 1)):
            for c in range(max(0, col - _REACH), min(cols, col + _REACH + 1)):
                d2 = (c + 0.5 - px) ** 2 + (r + 0.5 - py) ** 2
                value = np.uint8(255.0 * math.exp(-0.5 * d2))
                if value <= fine[r, c]:
                    continue
                fine[r, c] = value
                for level, side in ((mid, MID), (top, TOP)):
                    for i in range(max(0, r // side - 1), r // side + 1):
                        for j in range(max(0, c // side - 1), c // side + 1):
                            level[i, j] = max(level[i, j], value)


@njit(cache=True)
def _sum(
    cells: NDArray[np.int32], row: int, col: int, side: int, level: Field, outside: int
) -> int:
    """Sum a field over the points at ``cells`` (n, 2) row, col, shifted by (row, col)."""
    rows, cols, total = level.shape[0], level.shape[1], 0
    for i in range(cells.shape[0]):
        r, c = (cells[i, 0] + row) // side, (cells[i, 1] + col) // side
        if 0 <= r < rows and 0 <= c < cols:
            total += level[r, c]
        else:
            total += outside
    return total


@njit(cache=True)
def _is_near(x: float, y: float, yaw: float, places: FloatArray) -> bool:
    """Return whether a pose is within the radii of a place (k, 5) x, y, yaw, radius m, rad."""
    for k in range(places.shape[0]):
        if (
            math.hypot(x - places[k, 0], y - places[k, 1]) < places[k, 3]
            and abs(wrap_angle(yaw - places[k, 2])) < places[k, 4]
        ):
            return True
    return False


def heading_step(points: FloatArray, resolution: float) -> float:
    """Choose the step of the headings in a search: it moves the far points by about a cell.

    Args:
        points: (n, 2) hits in base_link, m.
        resolution: Side of a cell, m.

    Returns:
        The step, rad.
    """
    far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.8))
    far = max(far, resolution)  # all points may lie at the robot's centre
    return float(np.clip(resolution / far, _FINEST_TURN_RAD, _COARSEST_TURN_RAD))


def search_map(
    points: FloatArray,
    prior: FloatArray,
    window: FloatArray,
    weights: FloatArray,
    fields: SearchFields,
    least: float = 0.0,
    excluded: FloatArray = NOTHING_EXCLUDED,
) -> tuple[FloatArray, float]:
    """Search as `search` does, with headings by `heading_step`.

    Args:
        points: (n, 2) hits in base_link, m.
        prior: (3,) x, y, yaw of base_link in map, the middle of the window.
        window: (2,) half the size of the window, m and rad.
        weights: (2,) penalties, 1/m^2 and 1/rad^2, on the squared offsets from the prior.
        fields: Search fields of the map.
        least: The score of the pose must exceed this.
        excluded: (k, 5) as in `search`.

    Returns:
        Pose (3,), and its score; -1 if there is none.
    """
    step = heading_step(points, fields.resolution)
    return search(points, prior, window, weights, fields, step, least, excluded)


@njit(cache=True)
def search(
    points: FloatArray,
    prior: FloatArray,
    window: FloatArray,
    weights: FloatArray,
    fields: SearchFields,
    yaw_step: float,
    least: float,
    excluded: FloatArray,
) -> tuple[FloatArray, float]:
    """Find the best pose in a window around a prior.

    The score is the mean likelihood of a hit, 0 to 1, minus
    ``weights[0] d^2 + weights[1] dyaw^2``, where d and dyaw are the offsets from the prior. So the
    nearest pose wins where many poses fit equally well, for instance along a corridor.
    Translations are whole cells, so they are exact to half a cell.

    Args:
        points: (n, 2) hits in the frame of the pose, m.
        prior: (3,) x, y, yaw, the middle of the window.
        window: (2,) half the size of the window, m and rad.
        weights: (2,) penalties, 1/m^2 and 1/rad^2.
        fields: Search fields of the map.
        yaw_step: Step of the headings, rad.
        least: The score of the pose must exceed this.
        excluded: (k, 5) x, y, yaw, radius, m, and radius, rad: poses within both radii of one of
            these places are skipped.

    Returns:
        Pose (3,), and its score; the prior and -1 if no pose scores more than ``least``.
    """
    half = math.ceil(window[0] / fields.resolution)
    turns = math.ceil(window[1] / yaw_step)
    cells = _turned_cells(points, prior, turns, yaw_step, fields)
    bound = _bounds(cells, half, fields.top, fields.outside)
    blocks = (2 * half) // TOP + 1
    scale = 1.0 / (255.0 * max(1, points.shape[0]))
    best, found, hit = least, prior.copy(), False
    # Blocks with the highest bound come first. If one bound is below the best score, all later
    # ones are too.
    for o in np.argsort(-bound):
        if bound[o] * scale <= best:
            break
        k, block = o // (blocks * blocks), o % (blocks * blocks)
        dyaw = (k - turns) * yaw_step
        if bound[o] * scale - weights[1] * dyaw * dyaw <= best:
            continue
        row, col = (block // blocks) * TOP - half, (block % blocks) * TOP - half
        score = _search_block(
            cells[k], row, col, half, prior, dyaw, weights, fields, excluded, best, found
        )
        if score > best:
            best, hit = score, True
    return found, best if hit else -1.0


@njit(cache=True)
def _turned_cells(
    points: FloatArray, prior: FloatArray, turns: int, yaw_step: float, fields: SearchFields
) -> NDArray[np.int32]:
    """Return the cells (2 turns + 1, n, 2) of each point in each heading, at the prior's x, y."""
    n, count = points.shape[0], 2 * turns + 1
    cells = np.empty((count, n, 2), np.int32)
    for k in range(count):
        yaw = prior[2] + (k - turns) * yaw_step
        cos, sin = math.cos(yaw), math.sin(yaw)
        for i in range(n):
            px = prior[0] + cos * points[i, 0] - sin * points[i, 1]
            py = prior[1] + sin * points[i, 0] + cos * points[i, 1]
            cells[k, i, 0] = math.floor((py - fields.corner[1]) / fields.resolution)
            cells[k, i, 1] = math.floor((px - fields.corner[0]) / fields.resolution)
    return cells


@njit(cache=True)
def _bounds(cells: NDArray[np.int32], half: int, top: Field, outside: int) -> FloatArray:
    """Return the upper bounds (headings x blocks x blocks,) of the sums in each block."""
    count, blocks = cells.shape[0], (2 * half) // TOP + 1
    bound = np.empty(count * blocks * blocks)
    for k in range(count):
        for a in range(blocks):
            for b in range(blocks):
                bound[(k * blocks + a) * blocks + b] = _sum(
                    cells[k], a * TOP - half, b * TOP - half, TOP, top, outside
                )
    return bound


@njit(cache=True)
def _search_block(
    cells: NDArray[np.int32],
    row0: int,
    col0: int,
    half: int,
    prior: FloatArray,
    dyaw: float,
    weights: FloatArray,
    fields: SearchFields,
    excluded: FloatArray,
    best: float,
    found: FloatArray,
) -> float:
    """Return the best score of a block, or ``best``; a better pose is written to ``found``."""
    scale = 1.0 / (255.0 * max(1, cells.shape[0]))
    turned = weights[1] * dyaw * dyaw
    for row1 in range(row0, min(row0 + TOP, half + 1), MID):
        for col1 in range(col0, min(col0 + TOP, half + 1), MID):
            # The finer bound rules out most of the small blocks.
            if _sum(cells, row1, col1, MID, fields.mid, fields.outside) * scale - turned <= best:
                continue
            for row in range(row1, min(row1 + MID, half + 1)):
                for col in range(col1, min(col1 + MID, half + 1)):
                    dx, dy = col * fields.resolution, row * fields.resolution
                    way = turned + weights[0] * (dx * dx + dy * dy)
                    if 1.0 - way <= best:
                        continue
                    x, y = prior[0] + dx, prior[1] + dy
                    if _is_near(x, y, prior[2] + dyaw, excluded):
                        continue
                    score = _sum(cells, row, col, 1, fields.fine, fields.outside) * scale - way
                    if score > best:
                        best = score
                        found[0], found[1], found[2] = x, y, wrap_angle(prior[2] + dyaw)
    return best


@njit(cache=True)
def thinned(points: FloatArray, apart: float, most: int) -> FloatArray:
    """Select some of the points, evenly spread.

    Args:
        points: (n, 2) m.
        apart: Side of a square in which at most one point is kept, m.
        most: Largest number of points to keep.

    Returns:
        (k, 2) the selected points, in the given order.
    """
    seen = set()  # the first entry tells numba the type
    out, count = np.empty_like(points), 0
    seen.add((np.int64(2**40), np.int64(0)))
    for i in range(points.shape[0]):
        key = (
            np.int64(math.floor(points[i, 0] / apart)),
            np.int64(math.floor(points[i, 1] / apart)),
        )
        if key not in seen:
            seen.add(key)
            out[count] = points[i]
            count += 1
    stride = max(1, math.ceil(count / most))
    return out[:count:stride].copy()
