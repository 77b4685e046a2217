"""Obstacles as discs: connected components of the occupied cells, long ones cut into pieces."""

from __future__ import annotations

import cv2
import numpy as np

from simloop.messages import FloatArray

_PIECE_M = 0.5  # a component longer than this is cut into tiles of this size


def discs_of(occupied: np.ndarray, origin_m: FloatArray, resolution_m: float) -> FloatArray:
    """(k, 3) x, y, r of discs in map that together cover every occupied cell of (rows, cols)."""
    if not occupied.size:
        return np.empty((0, 3))
    count, labels = cv2.connectedComponents(occupied.view(np.uint8), connectivity=8)
    if count <= 1:
        return np.empty((0, 3))
    rows, cols = np.nonzero(occupied)
    label = labels[rows, cols]
    discs = []
    for k in range(1, count):
        mine = label == k
        discs.extend(_cover(cols[mine], rows[mine], resolution_m))
    found = np.array(discs)
    found[:, :2] += origin_m
    return found


def _cover(cols: np.ndarray, rows: np.ndarray, resolution_m: float) -> list[tuple[float, ...]]:
    """Discs, from the grid's corner, m, about the cells of one component."""
    tile = max(1, round(_PIECE_M / resolution_m))
    if max(np.ptp(cols), np.ptp(rows)) < tile:
        groups = [np.ones(len(cols), bool)]
    else:
        key = (rows // tile) * (cols.max() + tile) + cols // tile
        groups = [key == value for value in np.unique(key)]
    discs: list[tuple[float, ...]] = []
    for group in groups:
        centres = (np.column_stack((cols[group], rows[group])) + 0.5).astype(np.float32)
        (x, y), radius = cv2.minEnclosingCircle(centres)
        reach = radius + np.sqrt(0.5)  # to the cells' corners
        discs.append((x * resolution_m, y * resolution_m, reach * resolution_m))
    return discs
