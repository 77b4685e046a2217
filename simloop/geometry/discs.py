"""Represent obstacles as discs.

Each connected component of the occupied cells becomes a disc. Long components are cut into tiles.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray

_PIECE_M = 0.5  # a component at least this long is cut into tiles of this size


def discs_of(occupied: np.ndarray, origin_m: FloatArray, resolution_m: float) -> FloatArray:
    """Cover the occupied cells of a grid with discs.

    Args:
        occupied: (rows, cols) bool [iy, ix].
        origin_m: (2,) lower left corner of cell (0, 0), in map, m.
        resolution_m: Side of a cell, m.

    Returns:
        (k, 3) x, y, radius in map, m. The discs cover every occupied cell.
    """
    if not occupied.size:
        return np.empty((0, 3))
    count, labels = cv2.connectedComponents(occupied.view(np.uint8), connectivity=8)
    if count <= 1:
        return np.empty((0, 3))
    cells = np.argwhere(occupied)
    group = _groups(labels[occupied], cells, max(1, round(_PIECE_M / resolution_m)))
    order = np.argsort(group, kind="stable")
    centres = (cells[order, ::-1] + 0.5).astype(np.float32)
    ends = np.flatnonzero(np.diff(group[order], append=-1)) + 1
    discs, first = np.empty((len(ends), 3)), 0
    for disc, end in zip(discs, ends.tolist(), strict=True):
        (disc[0], disc[1]), disc[2] = cv2.minEnclosingCircle(centres[first:end])
        first = end
    discs[:, 2] += math.sqrt(0.5)  # reach the cells' corners
    discs *= resolution_m
    discs[:, :2] += origin_m
    return discs


def on_discs(points: FloatArray, discs: FloatArray) -> NDArray[np.bool_]:
    """Find the points that lie on a disc.

    Args:
        points: (n, 2) x, y, m.
        discs: (k, 3) x, y, radius in the same frame, m.

    Returns:
        (n,) bool, whether each point lies on any of the discs.
    """
    apart = np.hypot(*np.moveaxis(points[:, None] - discs[:, :2], -1, 0)) - discs[:, 2]
    return np.asarray((apart <= 0.0).any(axis=1))


def _groups(label: np.ndarray, cells: np.ndarray, tile: int) -> np.ndarray:
    """Number each of cells (n, 2) by its component, or by its tile in a long component.

    ``label`` (n,) is the number of the component, from 1. ``tile`` is the side of a tile in cells.
    """
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.diff(label[order], prepend=0))
    low = np.minimum.reduceat(cells[order], first, axis=0)
    high = np.maximum.reduceat(cells[order], first, axis=0)
    long = ((high - low).max(axis=1) >= tile)[label - 1]
    row, col = (cells // tile).T
    tiles = (row.max() + 1) * (col.max() + 1)
    return label * tiles + long * (row * (col.max() + 1) + col)
