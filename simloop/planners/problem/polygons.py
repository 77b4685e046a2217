"""Convex polygons as obstacles: exact clearance of a segment."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from simloop.geometry.distance_field import FREE_M
from simloop.messages import FloatArray

_TOUCH_M = 1e-9


def flatten_polygons(
    polygons: Sequence[FloatArray],
) -> FloatArray:
    """Put the corners of all polygons into one array, one polygon after the other.

    A single array is faster, because each array in a `Problem` adds time to every kernel call.

    Args:
        polygons: Corners (n, 2) of each polygon, in either direction, m.

    Returns:
        (N, 3) counter-clockwise: x, y, m, and the row where the corner's polygon ends.

    Raises:
        ValueError: If a polygon is not convex or has no area.
    """
    turned = []
    for number, polygon in enumerate(polygons):
        corners = np.asarray(polygon, dtype=np.float64).reshape(-1, 2)
        edges = np.roll(corners, -1, axis=0) - corners
        onward = np.roll(edges, -1, axis=0)
        cross = edges[:, 0] * onward[:, 1] - edges[:, 1] * onward[:, 0]
        around = np.abs(np.arctan2(cross, (edges * onward).sum(axis=1))).sum()
        convex = (cross >= 0.0).all() or (cross <= 0.0).all()
        if len(corners) < 3 or not cross.any() or not convex or around > 6.5:
            raise ValueError(f"polygon {number} is not convex, or has no area")
        keep = np.hypot(edges[:, 0], edges[:, 1]) > 0.0
        turned.append(corners[keep] if cross.sum() > 0.0 else corners[keep][::-1])
    sizes = [len(corners) for corners in turned]
    flat = np.concatenate(turned) if turned else np.zeros((0, 2))
    return np.column_stack([flat, np.repeat(np.cumsum(sizes), sizes)])


@njit(cache=True)
def _outline_distance(
    corners: FloatArray,
    first: int,
    last: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
) -> float:
    """Compute the distance of segment a-b to the edges of polygon [first, last); 0 if they meet."""
    least = np.inf
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    for i in range(first, last):
        k = i + 1 if i + 1 < last else first
        px, py, qx, qy = corners[i, 0], corners[i, 1], corners[k, 0], corners[k, 1]
        ex, ey = qx - px, qy - py
        sa = ex * (ay - py) - ey * (ax - px)
        sb = ex * (by - py) - ey * (bx - px)
        sp = dx * (py - ay) - dy * (px - ax)
        sq = dx * (qy - ay) - dy * (qx - ax)
        if sa * sb < 0.0 and sp * sq < 0.0:
            return 0.0
        edge = ex * ex + ey * ey
        for x, y in ((ax, ay), (bx, by)):
            t = min(max(((x - px) * ex + (y - py) * ey) / edge, 0.0), 1.0)
            least = min(least, math.hypot(x - px - t * ex, y - py - t * ey))
        t = min(max(((px - ax) * dx + (py - ay) * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
        least = min(least, math.hypot(ax + t * dx - px, ay + t * dy - py))
    return least


@njit(cache=True)
def _depth_at(corners: FloatArray, first: int, last: int, x: float, y: float) -> tuple[float, int]:
    """Return the signed distance to a polygon's nearest edge line (negative inside), and the edge.

    The edge is given by its row in ``corners``.
    """
    most, which = -np.inf, first
    for i in range(first, last):
        k = i + 1 if i + 1 < last else first
        ex, ey = corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1]
        out = (ey * (x - corners[i, 0]) - ex * (y - corners[i, 1])) / math.hypot(ex, ey)
        if out > most:
            most, which = out, i
    return most, which


@njit(cache=True)
def _box_apart(
    corners: FloatArray, first: int, last: int, ax: float, ay: float, bx: float, by: float
) -> float:
    """Compute a lower bound for a segment's distance to a polygon, from their bounding boxes."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for i in range(first, last):
        low_x, high_x = min(low_x, corners[i, 0]), max(high_x, corners[i, 0])
        low_y, high_y = min(low_y, corners[i, 1]), max(high_y, corners[i, 1])
    dx = max(low_x - max(ax, bx), min(ax, bx) - high_x, 0.0)
    dy = max(low_y - max(ay, by), min(ay, by) - high_y, 0.0)
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True)
def _deepest(
    corners: FloatArray, first: int, last: int, ax: float, ay: float, bx: float, by: float
) -> float:
    """Compute the least `_depth_at` along a segment.

    The depth is convex along the segment, so bisection on its slope finds the deepest point.
    """
    low, high = 0.0, 1.0
    for _ in range(50):
        t = 0.5 * (low + high)
        _, i = _depth_at(corners, first, last, ax + t * (bx - ax), ay + t * (by - ay))
        k = i + 1 if i + 1 < last else first
        ex, ey = corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1]
        if ey * (bx - ax) - ex * (by - ay) > 0.0:
            high = t
        else:
            low = t
    t = 0.5 * (low + high)
    deepest, _ = _depth_at(corners, first, last, ax + t * (bx - ax), ay + t * (by - ay))
    return deepest


@njit(cache=True)
def polygon_clearance(
    corners: FloatArray,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    most: float = FREE_M,
) -> float:
    """Compute the exact clearance of a segment among polygons.

    Args:
        corners: (N, 3) from `flatten_polygons`.
        ax: x of the segment's start, m.
        ay: y of the segment's start, m.
        bx: x of its end, m.
        by: y of its end, m.
        most: Clearance above which the exact value does not matter, m.

    Returns:
        The clearance, m, at most ``most``; if the segment cuts a polygon, minus the depth at its
        deepest point.
    """
    clearance = most
    first = 0
    while first < corners.shape[0]:
        last = int(corners[first, 2])
        room = max(clearance, _TOUCH_M)  # the next polygon may be cut deeper
        if _box_apart(corners, first, last, ax, ay, bx, by) < room:
            apart = _outline_distance(corners, first, last, ax, ay, bx, by)
            inside, _ = _depth_at(corners, first, last, ax, ay)
            if apart < _TOUCH_M or inside <= 0.0:
                apart = _deepest(corners, first, last, ax, ay, bx, by)
            clearance = min(clearance, apart)
        first = last
    return clearance
