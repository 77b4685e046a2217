"""Find the tangents that leave a circle without touching an obstacle, compiled.

See `shortest_path` for the circles. The index of the floor plan lists, for each block, the outlines
that can be the nearest there. So a segment is free if it keeps its distance from the outlines of
the blocks that it crosses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.outline_distance import Index, Outlines
from simloop.messages import FloatArray

_FACING = 1e-9  # tolerance of a normal's position between those of two edges


class Circles(NamedTuple):
    """The circles that a path can follow, one around each vertex of an outline.

    Attributes:
        centre_m: (N, 2) centres in map, m.
        radius_m: (N,) radii, m.
        to_next: (N, 2) vector to the next vertex of the outline, m; zero if there is none. With
            ``to_previous`` it bounds the part of the circle that is free.
        to_previous: (N, 2) vector to the previous vertex, m.
    """

    centre_m: FloatArray
    radius_m: FloatArray
    to_next: FloatArray
    to_previous: FloatArray


@njit(cache=True, nogil=True)
def leaving(
    tail: int,
    tail_sense: float,
    heads: NDArray[np.int64],
    circles: Circles,
    outlines: Outlines,
    index: Index,
    near: float,
    slack: float,
) -> tuple[NDArray[np.int64], FloatArray]:
    """Find the free common tangents from one circle to others.

    Args:
        tail: Circle that the tangents leave.
        tail_sense: Direction of the path on it: 1.0 counter-clockwise, -1.0 clockwise.
        heads: (H,) circles that they may reach; 1 is the goal, which has no sense.
        circles: The circles.
        outlines: The outlines of the floor plan.
        index: Their index.
        near: Least distance that a tangent keeps from every outline, m.
        slack: Tolerance for circles that touch from inside, m.

    Returns:
        (T, 2) circle and sense that each tangent reaches, and (T, 4) its ends x, y, x, y, m.
    """
    found = np.empty((2 * len(heads), 2), np.int64)
    ends = np.empty((2 * len(heads), 4))
    count = 0
    for head in heads:
        for sense in (1, -1):
            if head == tail or (head == 1 and sense < 0):
                continue
            touches, x0, y0, x1, y1 = _tangent(tail, tail_sense, head, float(sense), circles, slack)
            if touches and is_free(x0, y0, x1, y1, outlines, index, near):
                found[count, 0], found[count, 1] = head, sense
                ends[count, 0], ends[count, 1], ends[count, 2], ends[count, 3] = x0, y0, x1, y1
                count += 1
    return found[:count], ends[:count]


@njit(cache=True)
def _tangent(
    tail: int, tail_sense: float, head: int, head_sense: float, circles: Circles, slack: float
) -> tuple[bool, float, float, float, float]:
    """Compute the tangent of two circles with given senses, and whether it touches both outlines.

    Let u be the tangent's direction and n the normal to its right. A circle (c, r) that the
    path follows with sense s is touched at c + s r n. Both touching points are on one line
    along u if |c2 - c1| sin(angle of u against c2 - c1) = s1 r1 - s2 r2.
    """
    centres = circles.centre_m
    reach, other = tail_sense * circles.radius_m[tail], head_sense * circles.radius_m[head]
    dx, dy = centres[head, 0] - centres[tail, 0], centres[head, 1] - centres[tail, 1]
    distance, offset = np.hypot(dx, dy), reach - other
    # Circles that touch from inside (for example a start on an arc) have a tangent of length 0.
    if distance <= 0.0 or distance <= abs(offset) - slack:
        return False, 0.0, 0.0, 0.0, 0.0
    lean = np.arcsin(max(-1.0, min(1.0, offset / distance)))
    heading = np.arctan2(dy, dx) + lean
    x, y = np.sin(heading), -np.cos(heading)
    # A touching point is on the outline only if its normal is between those of the two edges.
    touches = _faces(tail, tail_sense * x, tail_sense * y, circles)
    touches = touches and _faces(head, head_sense * x, head_sense * y, circles)
    x0, y0 = centres[tail, 0] + reach * x, centres[tail, 1] + reach * y
    return touches, x0, y0, centres[head, 0] + other * x, centres[head, 1] + other * y


@njit(cache=True)
def _faces(circle: int, x: float, y: float, circles: Circles) -> bool:
    """Tell whether a normal points away from both edges of a circle's vertex."""
    ahead = x * circles.to_next[circle, 0] + y * circles.to_next[circle, 1]
    behind = x * circles.to_previous[circle, 0] + y * circles.to_previous[circle, 1]
    return bool(ahead <= _FACING and behind <= _FACING)


@njit(cache=True)
def is_free(
    x0: float, y0: float, x1: float, y1: float, outlines: Outlines, index: Index, near: float
) -> bool:
    """Tell whether a segment keeps its distance from every outline.

    Args:
        x0: x of its start, m.
        y0: y of its start, m.
        x1: x of its end, m.
        y1: y of its end, m.
        outlines: The outlines.
        index: Their index.
        near: The distance, m.

    Returns:
        False if a point of the segment is nearer than that to an outline, or inside one.
    """
    rows, columns = index.shape
    side = index.side_m
    # In units of blocks from the corner of the raster.
    u, v = (x0 - index.corner_m[0]) / side, (y0 - index.corner_m[1]) / side
    du, dv = (x1 - x0) / side, (y1 - y0) / side
    column, row = np.floor(u), np.floor(v)
    step_u, step_v = np.sign(du), np.sign(dv)
    # Share of the segment at which it next enters another column or row, and between two of them.
    next_u = ((column + (du > 0.0)) - u) / du if du != 0.0 else np.inf
    next_v = ((row + (dv > 0.0)) - v) / dv if dv != 0.0 else np.inf
    while True:
        if not (0.0 <= column < columns and 0.0 <= row < rows):
            return _is_free_of_all(x0, y0, x1, y1, outlines, near)
        block = int(row) * columns + int(column)
        for k in range(index.first[block], index.first[block + 1]):
            if not _is_clear(x0, y0, x1, y1, outlines, index.entries[k], near):
                return False
        if min(next_u, next_v) > 1.0:
            return True
        if next_u < next_v:
            column += step_u
            next_u += abs(1.0 / du)
        else:
            row += step_v
            next_v += abs(1.0 / dv)


@njit(cache=True)
def _is_free_of_all(
    x0: float, y0: float, x1: float, y1: float, outlines: Outlines, near: float
) -> bool:
    free = True
    for s in range(len(outlines.radii_m)):
        free = free and _is_clear(x0, y0, x1, y1, outlines, s, near)
    return free


@njit(cache=True)
def _is_clear(
    x0: float, y0: float, x1: float, y1: float, outlines: Outlines, s: int, near: float
) -> bool:
    """Tell whether a segment keeps a distance from one outline."""
    vertices = outlines.vertices_m
    first, last = outlines.starts[s], outlines.starts[s + 1]
    wide = near + outlines.radii_m[s]
    inside = last - first > 2  # whether the start is to the left of all edges
    j = last - 1
    for i in range(first, last):
        ax, ay, bx, by = vertices[j, 0], vertices[j, 1], vertices[i, 0], vertices[i, 1]
        inside = inside and (bx - ax) * (y0 - ay) - (by - ay) * (x0 - ax) >= 0.0
        apart = min(
            min(_to_segment(x0, y0, ax, ay, bx, by), _to_segment(x1, y1, ax, ay, bx, by)),
            min(_to_segment(ax, ay, x0, y0, x1, y1), _to_segment(bx, by, x0, y0, x1, y1)),
        )
        if apart < wide:
            return False
        # If two segments do not cross, one of the four ends is the nearest to the other segment.
        if (
            _side(x0, y0, x1, y1, ax, ay) * _side(x0, y0, x1, y1, bx, by) < 0.0
            and _side(ax, ay, bx, by, x0, y0) * _side(ax, ay, bx, by, x1, y1) < 0.0
        ):
            return False
        j = i
    return not inside


@njit(cache=True)
def _side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Compute a number that is positive where a point is to the left of a -> b."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@njit(cache=True)
def _to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Compute the distance of a point from a segment."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    share = 0.0
    if length2 > 0.0:
        share = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / length2))
    return float(np.hypot(x - ax - share * dx, y - ay - share * dy))
