"""Exact signed distances from points to many convex outlines, with an index for large numbers.

An outline is a convex polygon grown by a radius. The signed distance to one changes by no more than
the way between two points. So in a square block only those outlines can be the nearest whose
distance at the block's centre exceeds the least one by at most the block's diagonal. The index
stores them for each block. Its results are the same to the bit as those of a search through all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_BLOCK = 16  # cells along a side of a block of the index
_COARSE = 8  # blocks along a side of a coarse block
_FINE = 4  # cells along a side of a part of a block
_SLACK_M = 1e-6  # far more than the rounding of a distance
_MOST_ENTRIES = 20_000_000


class Outlines(NamedTuple):
    """Convex outlines in arrays.

    Attributes:
        vertices_m: (sum V, 2) corners of all outlines, x, y, m, each outline counter-clockwise.
        starts: (S + 1,) index of each outline's first vertex, and the number of vertices.
        radii_m: (S,) radius by which each outline is grown, m.
    """

    vertices_m: FloatArray
    starts: NDArray[np.int64]
    radii_m: FloatArray


class Index(NamedTuple):
    """The outlines that can be the nearest in each block of a raster.

    Attributes:
        corner_m: (2,) lower left corner of the raster, m.
        side_m: Side of a block, m.
        shape: Rows and columns of blocks.
        first: (rows * columns + 1,) index of each block's first entry.
        entries: Numbers of outlines, in ascending order within a block.
    """

    corner_m: FloatArray
    side_m: float
    shape: tuple[int, int]
    first: NDArray[np.int64]
    entries: NDArray[np.int32]


def distances(points_m: FloatArray, outlines: Outlines, index: Index | None) -> FloatArray:
    """Compute the least signed distance of each point to the outlines.

    Args:
        points_m: (N, 2) x, y, m.
        outlines: The outlines.
        index: Result of `raster` for these outlines; None: search through all of them.

    Returns:
        (N,) distances, m, negative inside; inf without outlines. Where outlines overlap, the
        deepest one counts.
    """
    if index is None:
        return _searched(points_m, *outlines)
    return _looked_up(points_m, *outlines, *index)


def each_distance(point_m: FloatArray, outlines: Outlines) -> FloatArray:
    """Compute the signed distances of one point to all outlines.

    Args:
        point_m: (2,) x, y, m.
        outlines: The outlines.

    Returns:
        (S,) distances, m, negative inside.
    """
    return _each(float(point_m[0]), float(point_m[1]), *outlines)


def within_reach(points_m: FloatArray, reach_m: float, outlines: Outlines) -> NDArray[np.bool_]:
    """Tell which outlines are hardly farther than the nearest one from any of some points.

    Args:
        points_m: (N, 2) x, y, m.
        reach_m: How much farther they may be, m.
        outlines: The outlines.

    Returns:
        (S,) True if an outline's distance from one of the points is at most ``reach_m`` more than
        the least one, or than 0 if that is negative.
    """
    return _within_reach(np.ascontiguousarray(points_m), reach_m, *outlines)


def raster(
    x_m: FloatArray, y_m: FloatArray, outlines: Outlines
) -> tuple[NDArray[np.float32], Index | None]:
    """Compute the least signed distance at the cells of a raster, and the index of its blocks.

    Args:
        x_m: (columns,) x of the cells' centres, m, evenly spaced.
        y_m: (rows,) y of the cells' centres, m, with the same spacing.
        outlines: The outlines.

    Returns:
        (rows, columns) distances, m, as those of `distances`; and the index. It is None for a
        single cell, without outlines, or if it would be too large.
    """
    out = np.full((len(y_m), len(x_m)), np.inf, np.float32)
    if not len(outlines.radii_m):
        return out, None
    step = float(x_m[1] - x_m[0]) if len(x_m) > 1 else 0.0
    step = max(step, float(y_m[1] - y_m[0]) if len(y_m) > 1 else 0.0)
    if step == 0.0:
        out[0, 0] = _searched(np.array([[x_m[0], y_m[0]]]), *outlines)[0]
        return out, None
    rows, columns = (-(-size // _BLOCK) for size in out.shape)
    first, entries = _fill(x_m, y_m, step, *outlines, rows, columns, out)
    if len(first) == 0:
        return out, None
    corner = np.array([x_m[0] - 0.5 * step, y_m[0] - 0.5 * step])
    return out, Index(corner, _BLOCK * step, (rows, columns), first, entries)


@njit(cache=True)
def _signed(
    x: float, y: float, vertices: FloatArray, first: int, last: int, radius: float
) -> float:
    """Compute the signed distance to the outline with the vertices first to last - 1."""
    inside = last - first > 2  # points and segments have no inside
    nearest = np.inf
    j = last - 1
    for i in range(first, last):
        ax, ay = x - vertices[j, 0], y - vertices[j, 1]
        bx, by = vertices[i, 0] - vertices[j, 0], vertices[i, 1] - vertices[j, 1]
        # A point is inside if it lies to the left of every counter-clockwise edge.
        inside = inside and bx * ay - by * ax >= 0.0
        # The nearest point of the edge, as a share t of its length.
        length2 = bx * bx + by * by
        t = 0.0
        if length2 > 0.0:
            t = min(1.0, max(0.0, (ax * bx + ay * by) / length2))
        nearest = min(nearest, (ax - t * bx) ** 2 + (ay - t * by) ** 2)
        j = i
    distance = -np.sqrt(nearest) if inside else np.sqrt(nearest)
    return distance - radius


@njit(cache=True)
def _each(
    x: float, y: float, vertices: FloatArray, starts: NDArray[np.int64], radii: FloatArray
) -> FloatArray:
    out = np.empty(len(radii))
    for s in range(len(radii)):
        out[s] = _signed(x, y, vertices, starts[s], starts[s + 1], radii[s])
    return out


@njit(cache=True)
def _within_reach(
    points: FloatArray,
    reach: float,
    vertices: FloatArray,
    starts: NDArray[np.int64],
    radii: FloatArray,
) -> NDArray[np.bool_]:
    near = np.zeros(len(radii), np.bool_)
    for n in range(len(points)):
        each = _each(points[n, 0], points[n, 1], vertices, starts, radii)
        limit = max(0.0, each.min()) + reach + _SLACK_M
        for s in range(len(radii)):
            near[s] = near[s] or each[s] <= limit
    return near


@njit(cache=True)
def _least(
    x: float, y: float, vertices: FloatArray, starts: NDArray[np.int64], radii: FloatArray
) -> float:
    least = np.inf
    for s in range(len(radii)):
        least = min(least, _signed(x, y, vertices, starts[s], starts[s + 1], radii[s]))
    return least


@njit(cache=True)
def _searched(
    points: FloatArray, vertices: FloatArray, starts: NDArray[np.int64], radii: FloatArray
) -> FloatArray:
    out = np.empty(len(points))
    for n in range(len(points)):
        out[n] = _least(points[n, 0], points[n, 1], vertices, starts, radii)
    return out


@njit(cache=True)
def _looked_up(
    points: FloatArray,
    vertices: FloatArray,
    starts: NDArray[np.int64],
    radii: FloatArray,
    corner: FloatArray,
    side: float,
    shape: tuple[int, int],
    first: NDArray[np.int64],
    entries: NDArray[np.int32],
) -> FloatArray:
    out = np.full(len(points), np.inf)
    rows, columns = shape
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        column, row = np.floor((x - corner[0]) / side), np.floor((y - corner[1]) / side)
        if 0.0 <= column < columns and 0.0 <= row < rows:
            block = int(row) * columns + int(column)
            for k in range(first[block], first[block + 1]):
                s = entries[k]
                out[n] = min(out[n], _signed(x, y, vertices, starts[s], starts[s + 1], radii[s]))
        else:  # outside of the raster, or not a number
            out[n] = _least(x, y, vertices, starts, radii)
    return out


@njit(cache=True)
def _narrow(
    x: float,
    y: float,
    reach: float,
    vertices: FloatArray,
    starts: NDArray[np.int64],
    radii: FloatArray,
    among: NDArray[np.int32],
    count: int,
    found: NDArray[np.int32],
    distance: FloatArray,
) -> int:
    """Put those of ``among`` into ``found`` that can be the nearest within ``reach`` of a point."""
    least = np.inf
    for k in range(count):
        s = among[k]
        distance[k] = _signed(x, y, vertices, starts[s], starts[s + 1], radii[s])
        least = min(least, distance[k])
    # Rounding grows with the numbers themselves.
    limit = least + 2.0 * reach + _SLACK_M + 1e-9 * (abs(x) + abs(y) + abs(least))
    kept = 0
    for k in range(count):
        if distance[k] <= limit:
            found[kept] = among[k]
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def _fill(
    x: FloatArray,
    y: FloatArray,
    step: float,
    vertices: FloatArray,
    starts: NDArray[np.int64],
    radii: FloatArray,
    rows: int,
    columns: int,
    out: NDArray[np.float32],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Fill the raster, and list the outlines of each block. Both lists are empty if too long."""
    total = len(radii)
    everything = np.arange(total).astype(np.int32)
    coarse, fine = np.empty(total, np.int32), np.empty(total, np.int32)
    block, scratch = np.empty(total, np.int32), np.empty(total)
    counts = np.zeros(rows * columns + 1, np.int64)
    # Coarse blocks come one after the other, so the entries are sorted by block afterwards.
    begun = np.zeros(rows * columns, np.int64)
    entries = np.empty(1024, np.int32)
    used, fits = 0, True
    half = 0.5 * step * np.sqrt(2.0)
    for big_row in range(0, rows, _COARSE):
        for big_column in range(0, columns, _COARSE):
            side = _COARSE * _BLOCK
            middle_x = x[0] + (big_column * _BLOCK + 0.5 * (side - 1)) * step
            middle_y = y[0] + (big_row * _BLOCK + 0.5 * (side - 1)) * step
            near = _narrow(middle_x, middle_y, side * half, vertices, starts, radii,
                           everything, total, coarse, scratch)  # fmt: skip
            for row in range(big_row, min(rows, big_row + _COARSE)):
                for column in range(big_column, min(columns, big_column + _COARSE)):
                    middle_x = x[0] + (column * _BLOCK + 0.5 * (_BLOCK - 1)) * step
                    middle_y = y[0] + (row * _BLOCK + 0.5 * (_BLOCK - 1)) * step
                    here = _narrow(middle_x, middle_y, _BLOCK * half, vertices, starts, radii,
                                   coarse, near, block, scratch)  # fmt: skip
                    fits = fits and used + here <= _MOST_ENTRIES
                    if fits:
                        while used + here > len(entries):
                            more = np.empty(2 * len(entries), np.int32)
                            more[:used] = entries[:used]
                            entries = more
                        begun[row * columns + column] = used
                        counts[row * columns + column + 1] = here
                        entries[used : used + here] = block[:here]
                        used += here
                    _fill_block(x, y, step, row, column, vertices, starts, radii,
                                block, here, fine, scratch, out)  # fmt: skip
    if not fits:
        return np.empty(0, np.int64), np.empty(0, np.int32)
    first = np.cumsum(counts)
    ordered = np.empty(used, np.int32)
    for number in range(rows * columns):
        size = counts[number + 1]
        ordered[first[number] : first[number] + size] = entries[
            begun[number] : begun[number] + size
        ]
    return first, ordered


@njit(cache=True)
def _fill_block(
    x: FloatArray,
    y: FloatArray,
    step: float,
    row: int,
    column: int,
    vertices: FloatArray,
    starts: NDArray[np.int64],
    radii: FloatArray,
    among: NDArray[np.int32],
    count: int,
    fine: NDArray[np.int32],
    scratch: FloatArray,
    out: NDArray[np.float32],
) -> None:
    """Fill one block of the raster, part by part, from the outlines ``among``."""
    half = 0.5 * step * np.sqrt(2.0)
    last_row, last_column = out.shape
    for low_row in range(row * _BLOCK, min(last_row, (row + 1) * _BLOCK), _FINE):
        for low_column in range(column * _BLOCK, min(last_column, (column + 1) * _BLOCK), _FINE):
            kept = _narrow(
                x[0] + (low_column + 0.5 * (_FINE - 1)) * step,
                y[0] + (low_row + 0.5 * (_FINE - 1)) * step,
                _FINE * half, vertices, starts, radii, among, count, fine, scratch,
            )  # fmt: skip
            for r in range(low_row, min(last_row, low_row + _FINE)):
                for c in range(low_column, min(last_column, low_column + _FINE)):
                    least = np.inf
                    for k in range(kept):
                        s = fine[k]
                        one = _signed(x[c], y[r], vertices, starts[s], starts[s + 1], radii[s])
                        least = min(least, one)
                    out[r, c] = least
