"""Compute the outline of a mesh between two heights, as convex polygons.

The outline of a solid between two heights is the union of two things: its cut at any height
between them, and all of its surface between them, seen from above. A mesh whose surface is not
closed has no inside there, so its surface alone is in the way.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from simloop.messages import FloatArray
from simloop.worlds.gazebo.convex_parts import closed_edges, convex_parts

_CUT_AT = 0.4876  # share of the height of the cut; at a plain number many meshes have vertices
_FLAT_M2 = 1e-9  # a triangle that is smaller seen from above stands upright
_JOIN_M = 1e-5  # ends of cuts that are nearer are joined
_NEAR_M = 1e-4  # a line that is nearer to a filled outline is part of it
_SHEET_M = 0.01  # thickness of an open surface
_PIXEL_M = 0.005
_MOST_PIXELS = 4000  # along a side of the picture
_LINE_PIXELS = 3  # thickness of an open surface; its outline is then 1 cm thick
_COARSEST = 64.0  # largest factor of rounding, in pixels


def outline_between(triangles: FloatArray, low_m: float, high_m: float) -> list[FloatArray] | None:
    """Compute the outline of a mesh between two heights.

    It is exact if the surface is closed there and has few edges. Otherwise it is drawn with pixels
    of 5 mm, or 1/4000 of the mesh if that is more.

    Args:
        triangles: (N, 3, 3) corners, x, y, z, m. Those of a closed surface run counter-clockwise
            seen from outside.
        low_m: the lower height, m.
        high_m: the upper height, m.

    Returns:
        Convex polygons (V, 2), counter-clockwise; None if the outline is too intricate.
    """
    heights = triangles[:, :, 2]
    near = (heights.max(axis=1) > low_m) & (heights.min(axis=1) < high_m)
    faces, upright = _surfaces(triangles[near], low_m, high_m)
    cut = _cut(triangles[near], low_m + _CUT_AT * (high_m - low_m))
    loops, open_cut = _loops(cut)
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    edges = np.concatenate([sides, *map(closed_edges, loops)])
    lines = np.concatenate([open_cut, upright])
    parts = convex_parts(edges)
    if parts is not None:
        sheets = [_thick(line) for line in lines[~_covered(parts, lines)]]
        if not sheets:
            return (
                [loops[0]] if len(loops) == 1 and not len(faces) and _is_convex(loops[0]) else parts
            )
        parts = convex_parts(np.concatenate([edges, *map(closed_edges, sheets)]))
        if parts is not None:
            return parts
    return _drawn(loops, faces, lines)


def _surfaces(triangles: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Cut triangles (N, 3, 3) to a band of heights, and look at them from above.

    Returns polygons (F, 9, 2), counter-clockwise with doubled corners, and those without area as
    lines (L, 2, 2).
    """
    after = np.roll(triangles, -1, axis=1)
    z, z_after = triangles[..., 2], after[..., 2]
    points, valid = [triangles], [(z >= low) & (z <= high)]
    for level in (low, high):
        crosses = (z < level) != (z_after < level)
        rise = np.where(crosses, z_after - z, 1.0)
        points.append(triangles + ((level - z) / rise)[..., None] * (after - triangles))
        valid.append(crosses)
    corners, known = np.concatenate(points, axis=1)[..., :2], np.concatenate(valid, axis=1)
    corners, known = corners[known.any(axis=1)], known[known.any(axis=1)]
    rows = np.arange(len(corners))
    # What is no corner becomes a double of one that is.
    corners = np.where(known[..., None], corners, corners[rows, known.argmax(axis=1)][:, None])
    gap = corners - corners.mean(axis=1, keepdims=True)
    order = np.argsort(np.arctan2(gap[..., 1], gap[..., 0]), axis=1)
    corners = corners[rows[:, None], order]
    flat = _area(corners) < _FLAT_M2
    lines = corners[flat]
    along = np.where(np.ptp(lines[..., 0], axis=1) >= np.ptp(lines[..., 1], axis=1), 0, 1)
    rows = np.arange(len(lines))
    reach = lines[rows, :, along]
    ends = [lines[rows, reach.argmin(axis=1)], lines[rows, reach.argmax(axis=1)]]
    return corners[~flat], np.stack(ends, axis=1)


def _area(polygons: FloatArray) -> FloatArray:
    """Compute the area (N,) of polygons (N, V, 2), positive if they run counter-clockwise."""
    x, y = polygons[..., 0], polygons[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)


def _cut(triangles: FloatArray, level: float) -> FloatArray:
    """Cut triangles (N, 3, 3) at a height; segments (S, 2, 2) with the inside on their left."""
    above = triangles[:, :, 2] >= level
    crossing = above.any(axis=1) & ~above.all(axis=1)
    triangles, above = triangles[crossing], above[crossing]
    if not len(triangles):
        return np.zeros((0, 2, 2))
    # Turn each triangle so that the corner alone on its side comes first.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    rows = np.arange(len(triangles))[:, None]
    first, second, third = triangles[rows, order].transpose(1, 0, 2)
    ends = []
    for other in (second, third):
        share = (level - first[:, 2]) / (other[:, 2] - first[:, 2])
        ends.append(first[:, :2] + share[:, None] * (other - first)[:, :2])
    segments = np.stack(ends, axis=1)
    up = above[np.arange(len(above)), alone]
    # Seen from outside, a corner on top has its second neighbour on the right side.
    segments[~up] = segments[~up][:, ::-1]
    return segments


def _loops(segments: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Join segments (S, 2, 2) to closed outlines (V, 2); the rest of them is open."""
    if not len(segments):
        return [], segments
    cells = np.round(segments.reshape(-1, 2) / _JOIN_M).astype(np.int64)
    _, first, points = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    places, (start, end) = segments.reshape(-1, 2)[first], points.reshape(-1, 2).T
    count = len(places)
    balance = np.bincount(start, minlength=count) - np.bincount(end, minlength=count)
    graph = coo_matrix((np.ones(len(start)), (start, end)), (count, count))
    _, label = connected_components(graph, directed=False)
    is_open = np.zeros(count, bool)
    is_open[label[balance != 0]] = True
    is_open = is_open[label[start]]
    following: dict[int, list[int]] = {}
    for a, b in zip(start[~is_open].tolist(), end[~is_open].tolist(), strict=True):
        if a != b:
            following.setdefault(a, []).append(b)
    loops = []
    while following:
        at = begun = next(iter(following))
        way = []
        while at in following:  # as many segments end at a point as begin there
            way.append(at)
            onward = following[at]
            after = onward.pop()
            if not onward:
                del following[at]
            at = after
            if at == begun:
                break
        loop = _without_straight_corners(places[way])
        if len(loop) > 2:
            loops.append(loop)
    return loops, segments[is_open]


def _without_straight_corners(loop: FloatArray) -> FloatArray:
    """Leave out the corners (V, 2) that lie on a straight side."""
    while len(loop) > 2:
        before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
        cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        chord = np.linalg.norm(before + after, axis=1)
        on_side = (cross <= 0.1 * _JOIN_M * chord) & (np.sum(before * after, axis=1) >= 0.0)
        # Of neighbours only one goes at a time, or a fine arc would vanish.
        on_side &= ~np.roll(on_side, 1) | (np.arange(len(loop)) % 2 == 0)
        if not on_side.any():
            break
        loop = loop[~on_side]
    return loop


def _is_convex(loop: FloatArray) -> bool:
    """Tell whether an outline (V, 2) is convex and runs counter-clockwise once."""
    sides = np.roll(loop, -1, axis=0) - loop
    onward = np.roll(sides, -1, axis=0)
    turns = np.arctan2(
        sides[:, 0] * onward[:, 1] - sides[:, 1] * onward[:, 0], np.sum(sides * onward, axis=1)
    )
    return bool(turns.min() > 0.0 and abs(turns.sum() - 2.0 * math.pi) < 1e-6)


def _thick(line: FloatArray) -> FloatArray:
    """Make the rectangle (4, 2) of a line (2, 2) that is an open surface seen from above."""
    along = line[1] - line[0]
    length = float(np.linalg.norm(along))
    along = along / length if length > 0.0 else np.array([1.0, 0.0])
    ahead, left = 0.5 * _SHEET_M * along, 0.5 * _SHEET_M * np.array([-along[1], along[0]])
    a, b = line[0] - ahead, line[1] + ahead
    return np.array([a - left, b - left, b + left, a + left])


def _covered(parts: list[FloatArray], segments: FloatArray) -> NDArray[np.bool_]:
    """Tell which segments (S, 2, 2) lie inside convex polygons or on their borders, (S,)."""
    points = np.concatenate([segments[:, 0], segments[:, 1], segments.mean(axis=1)])
    left = np.ones(len(points), bool)
    for part in parts:
        if not left.any():
            break
        along = np.roll(part, -1, axis=0) - part
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        gap = points[left][:, None] - part
        depth = along[:, 0] * gap[..., 1] - along[:, 1] * gap[..., 0]
        left[left] = depth.min(axis=1) < -_NEAR_M
    return ~np.asarray(left.reshape(3, -1).any(axis=0))


def _drawn(
    loops: list[FloatArray], faces: FloatArray, lines: FloatArray
) -> list[FloatArray] | None:
    """Draw the outline as a picture and cut that into convex polygons; None if too intricate."""
    points = np.concatenate([faces.reshape(-1, 2), lines.reshape(-1, 2), *loops])
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    step = max(_PIXEL_M, float(size.max()) / _MOST_PIXELS)
    rim = _LINE_PIXELS + 1
    columns, rows = (np.ceil(size / step).astype(int) + 2 * rim + 1).tolist()
    wound = np.zeros((rows, columns), np.int16)  # outlines about a pixel

    def pixels(polygon: FloatArray) -> NDArray[np.int32]:
        return np.round((polygon - low) / step + rim).astype(np.int32)

    for loop in loops:
        corners = pixels(loop)
        x, y, wide, high = cv2.boundingRect(corners)
        inside = np.zeros((high, wide), np.uint8)
        cv2.fillPoly(inside, [corners - [x, y]], 1)
        turn = 1 if _area(loop[None])[0] > 0.0 else -1
        wound[y : y + high, x : x + wide] += turn * inside.astype(np.int16)
    picture = (wound > 0).astype(np.uint8)
    cv2.polylines(picture, [pixels(loop) for loop in loops], True, 1)
    for face in faces:
        cv2.fillConvexPoly(picture, pixels(face), 1)
    for line in map(pixels, lines):
        cv2.line(picture, line[0].tolist(), line[1].tolist(), 1, _LINE_PIXELS)
    contours, _ = cv2.findContours(picture, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    coarse = 1.0
    while coarse <= _COARSEST:
        smooth = [cv2.approxPolyDP(one, coarse, True).reshape(-1, 2) for one in contours]
        edges = [closed_edges((loop - rim) * step + low) for loop in smooth if len(loop) > 2]
        parts = convex_parts(np.concatenate([np.zeros((0, 2, 2)), *edges]), even_odd=True)
        if parts is not None:
            return parts
        coarse *= math.sqrt(2.0)
    return None
