"""Correlative scan matching: the best of all poses in a window, found by branch and bound.

After Olson 2009 ("Real-time correlative scan matching") and Hess et al. 2016 ("Real-time loop
closure in 2D LIDAR SLAM"). A field holds how likely a hit is in each cell. Two coarser fields hold
its maxima over blocks of 4 x 4 and of 16 x 16 cells, so that a coarse sum bounds every fine one
under it: whole blocks of translations are passed over with one sum, and nothing is lost.

All three are kept up as surfaces come into the map, not made anew: a new surface raises a few
cells.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

MID, TOP = 4, 16
"""Sides of the coarser fields' blocks, in cells."""

_REACH = 3  # cells about a surface in which a hit is likely at all
Field = NDArray[np.uint8]


@njit(cache=True)
def raise_field(
    places: FloatArray, x0: float, y0: float, resolution: float, fine: Field, mid: Field, top: Field
) -> None:
    """Enter surfaces (k, 2), m: a Gaussian of one cell about each, 255 at its middle.

    fine: (rows, cols); mid, top: (rows / 4, cols / 4), (rows / 16, cols / 16), of which [i, j] is
    the maximum of fine over rows [b i, b i + 2 b), with b the block's side, and columns alike.
    """
    rows, cols = fine.shape
    for k in range(places.shape[0]):
        px, py = (places[k, 0] - x0) / resolution, (places[k, 1] - y0) / resolution
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
def _sum(cells: NDArray[np.int32], row: int, col: int, side: int, level: Field) -> int:
    """Sum over points at ``cells`` (n, 2) row, col, moved by (row, col), of a field of blocks."""
    rows, cols, total = level.shape[0], level.shape[1], 0
    for i in range(cells.shape[0]):
        r, c = (cells[i, 0] + row) // side, (cells[i, 1] + col) // side
        if 0 <= r < rows and 0 <= c < cols:
            total += level[r, c]
    return total


@njit(cache=True)
def _is_near(x: float, y: float, yaw: float, places: FloatArray) -> bool:
    """Whether a pose is nearer than m, rad to one of the places (k, 5) x, y, yaw, m, rad."""
    for k in range(places.shape[0]):
        if (
            math.hypot(x - places[k, 0], y - places[k, 1]) < places[k, 3]
            and abs(wrap_angle(yaw - places[k, 2])) < places[k, 4]
        ):
            return True
    return False


@njit(cache=True)
def search(
    points: FloatArray,
    prior: FloatArray,
    window: FloatArray,
    weights: FloatArray,
    fine: Field,
    mid: Field,
    top: Field,
    corner: FloatArray,
    resolution: float,
    yaw_step: float,
    least: float,
    but: FloatArray,
) -> tuple[FloatArray, float]:
    """Best pose (3,) within ``window`` (2,), m, rad, about ``prior`` (3,), and its score.

    points: (n, 2) in the frame of the pose. The score is the mean likelihood of a hit, 0 to 1, less
    ``weights[0] d^2 + weights[1] dyaw^2`` of the way from the prior: where many poses fit alike, as
    along a corridor, the nearest is taken. Poses nearer than ``but`` (k, 5) x, y, yaw, m, rad to
    one of k places are left out. Below ``least`` nothing is found: the
    score is then -1. corner: (2,) of the grid.

    Translations step by cells, exact to half of one; yaw by ``yaw_step``.
    """
    n = points.shape[0]
    half = math.ceil(window[0] / resolution)
    turns = math.ceil(window[1] / yaw_step)
    count = 2 * turns + 1
    cells = np.empty((count, n, 2), np.int32)
    blocks = (2 * half) // TOP + 1
    bound = np.empty(count * blocks * blocks)
    for k in range(count):
        yaw = prior[2] + (k - turns) * yaw_step
        cos, sin = math.cos(yaw), math.sin(yaw)
        for i in range(n):
            px = prior[0] + cos * points[i, 0] - sin * points[i, 1]
            py = prior[1] + sin * points[i, 0] + cos * points[i, 1]
            cells[k, i, 0] = math.floor((py - corner[1]) / resolution)
            cells[k, i, 1] = math.floor((px - corner[0]) / resolution)
        for a in range(blocks):
            for b in range(blocks):
                bound[(k * blocks + a) * blocks + b] = _sum(
                    cells[k], a * TOP - half, b * TOP - half, TOP, top
                )
    scale = 1.0 / (255.0 * max(1, n))
    best, found = least, prior.copy()
    hit = False
    order = np.argsort(-bound)
    for o in order:
        if bound[o] * scale <= best:
            break
        k, block = o // (blocks * blocks), o % (blocks * blocks)
        dyaw = (k - turns) * yaw_step
        turned = weights[1] * dyaw * dyaw
        if bound[o] * scale - turned <= best:
            continue
        row0, col0 = (block // blocks) * TOP - half, (block % blocks) * TOP - half
        for row1 in range(row0, min(row0 + TOP, half + 1), MID):
            for col1 in range(col0, min(col0 + TOP, half + 1), MID):
                if _sum(cells[k], row1, col1, MID, mid) * scale - turned <= best:
                    continue
                for row in range(row1, min(row1 + MID, half + 1)):
                    for col in range(col1, min(col1 + MID, half + 1)):
                        dx, dy = col * resolution, row * resolution
                        way = turned + weights[0] * (dx * dx + dy * dy)
                        if 1.0 - way <= best:
                            continue
                        x, y = prior[0] + dx, prior[1] + dy
                        if _is_near(x, y, prior[2] + dyaw, but):
                            continue
                        score = _sum(cells[k], row, col, 1, fine) * scale - way
                        if score > best:
                            best, hit = score, True
                            found[0], found[1] = x, y
                            found[2] = wrap_angle(prior[2] + dyaw)
    return found, best if hit else -1.0


@njit(cache=True)
def thinned(points: FloatArray, apart: float, most: int) -> FloatArray:
    """Some of ``points`` (n, 2), in order, no two in a square of side ``apart``; about ``most``."""
    seen = set()
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
