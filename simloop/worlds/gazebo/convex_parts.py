"""Cut plane figures of any form into convex polygons."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray

_MOST_EDGES = 1500  # every edge is tested against every other
_MOST_HEIGHTS = 6000
_SAME_M = 1e-7  # heights that differ by less are the same
_THIN_M = 1e-5  # a part that is thinner is left out


class _Open(NamedTuple):
    """A trapezoid that may go on in the next slab."""

    bottom: tuple[float, float, float]  # y, and x at the left and right edge


def convex_parts(edges: FloatArray, *, even_odd: bool = False) -> list[FloatArray] | None:
    """Cut the inside of closed outlines into trapezoids.

    The method sweeps a line upwards over the heights at which edges begin, end or cross. Between
    two such heights edges do not cross, and the inside is a row of trapezoids.

    Args:
        edges: (E, 2, 2) start and end of each edge of all outlines, x, y, m.
        even_odd: whether a point is inside if a ray from it crosses an odd number of edges.
            Otherwise it is inside if the outlines that run counter-clockwise about it outnumber
            those that run clockwise.

    Returns:
        Convex polygons (V, 2), counter-clockwise, that cover the inside without overlap; None if
        there are more than 1500 edges, or too many crossings.
    """
    edges = edges[np.abs(edges[:, 0, 1] - edges[:, 1, 1]) > _SAME_M]
    if not len(edges):
        return []
    if len(edges) > _MOST_EDGES:
        return None
    heights = _heights(edges)
    if len(heights) > _MOST_HEIGHTS:
        return None
    low, high = edges[:, :, 1].min(axis=1), edges[:, :, 1].max(axis=1)
    # An edge that leads down has the inside of a counter-clockwise outline to its right.
    turns = np.where(edges[:, 1, 1] < edges[:, 0, 1], 1, -1)
    parts: list[FloatArray] = []
    going: dict[tuple[int, int], _Open] = {}
    for y0, y1 in pairwise(heights):
        active = np.flatnonzero((low < y0 + _SAME_M) & (high > y1 - _SAME_M))
        active = active[np.argsort(_x_at(edges[active], 0.5 * (y0 + y1)), kind="stable")]
        runs = _runs(active, turns[active], even_odd)
        # A trapezoid between the same two edges goes on; all others end here.
        for pair in [pair for pair in going if pair not in runs]:
            _close(parts, edges, pair, going.pop(pair), y0)
        for pair in runs:
            if pair not in going:
                left, right = _x_at(edges[list(pair)], y0).tolist()
                going[pair] = _Open((y0, left, right))
    for pair, begun in going.items():
        _close(parts, edges, pair, begun, heights[-1])
    return parts


def _heights(edges: FloatArray) -> list[float]:
    """List the heights at which edges begin, end or cross, ascending."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    found = [edges[:, :, 1].ravel()]
    for k in range(len(edges) - 1):
        # Solve start_k + t along_k = start + u along for all later edges.
        other, way = start[k + 1 :], along[k + 1 :]
        cross = along[k, 0] * way[:, 1] - along[k, 1] * way[:, 0]
        gap = other - start[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / cross
            u = (gap[:, 0] * along[k, 1] - gap[:, 1] * along[k, 0]) / cross
        meets = (t > 0.0) & (t < 1.0) & (u > 0.0) & (u < 1.0) & (cross != 0.0)
        found.append(start[k, 1] + t[meets] * along[k, 1])
    heights = np.unique(np.concatenate(found))
    apart = np.concatenate([[True], np.diff(heights) > _SAME_M])
    return list(heights[apart].tolist())


def _x_at(edges: FloatArray, y: float) -> FloatArray:
    """Compute where edges (N, 2, 2) cross a height, (N,)."""
    (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
    return x0 + np.clip((y - y0) / (y1 - y0), 0.0, 1.0) * (x1 - x0)


def _runs(
    active: NDArray[np.intp], turns: NDArray[np.int64], even_odd: bool
) -> list[tuple[int, int]]:
    """Find the left and right edge of each stretch inside, from edges in order of x."""
    wound = np.cumsum(turns)
    inside = wound % 2 != 0 if even_odd else wound > 0
    runs = []
    first = -1
    for edge, within in zip(active.tolist(), inside.tolist(), strict=True):
        if within and first < 0:
            first = edge
        elif not within and first >= 0:
            runs.append((first, edge))
            first = -1
    return runs


def _close(
    parts: list[FloatArray], edges: FloatArray, pair: tuple[int, int], begun: _Open, top: float
) -> None:
    """Add the polygon of a trapezoid that ends at the height ``top``."""
    bottom, left0, right0 = begun.bottom
    left1, right1 = _x_at(edges[list(pair)], top).tolist()
    wide = max(right0 - left0, right1 - left1)
    if wide < _THIN_M or top - bottom < _THIN_M:
        return
    corners = [(left0, bottom), (right0, bottom), (right1, top), (left1, top)]
    if right0 - left0 < _THIN_M:
        corners = [corners[0], corners[2], corners[3]]
    elif right1 - left1 < _THIN_M:
        corners = corners[:3]
    parts.append(np.array(corners))


def closed_edges(loop: FloatArray) -> FloatArray:
    """List the edges of a closed outline.

    Args:
        loop: (V, 2) its corners, x, y, m.

    Returns:
        (V, 2, 2) start and end of each edge.
    """
    return np.stack([loop, np.roll(loop, -1, axis=0)], axis=1)
