"""The true floor plan of a world: exact distances to the obstacles at the robot's heights.

It is ground truth for metrics and for the generators of worlds. The robot's software never sees
it. Each static geom is represented by its convex outline between two heights. An outline is a
convex polygon grown by a radius: a disc is one vertex and a radius, a box is four vertices and no
radius.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from simloop.messages import FloatArray

BAND_M = (0.02, 0.25)
"""Heights, m, at which something can touch the robot: from above what its tracks drive over to the
top of its mast."""


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A convex outline on the floor: a polygon grown by a radius.

    Attributes:
        name: name of the obstacle.
        vertices_m: (V, 2) x, y in map, m, counter-clockwise, read-only.
        radius_m: radius by which the polygon is grown, m.
    """

    name: str
    vertices_m: FloatArray
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        self.vertices_m.setflags(write=False)


_Packed = tuple[FloatArray, NDArray[np.int64], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """Signed distances to the nearest obstacle or wall, negative inside one.

    Outside of obstacles the distances are exact. Where obstacles overlap, the deepest one counts.

    Attributes:
        origin_m: (2,) lower left corner of cell (0, 0), x, y in map, m.
        resolution_m: size of a cell, m.
        distance_m: (rows, cols) float32, [iy, ix], at the centres of the cells, m; inf if there
            are no obstacles.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the free space in map, m.
        sections: the outlines.
    """

    origin_m: FloatArray
    resolution_m: float
    distance_m: NDArray[np.float32]
    bounds_m: FloatArray
    sections: tuple[Section, ...] = field(repr=False)
    _outlines: _Packed = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_outlines", _packed(self.sections))
        for array in (self.origin_m, self.distance_m, self.bounds_m):
            array.setflags(write=False)

    def clearance_m(self, points_m: FloatArray) -> FloatArray:
        """Compute exact signed distances to the obstacles, from outlines and not from the raster.

        Args:
            points_m: (N, 2) or (2,) x, y in map, m.

        Returns:
            (N,) distances, m, negative inside; inf if there are no obstacles.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        return _distances(points, *self._outlines)

    def contains(self, point_m: Sequence[float] | FloatArray) -> bool:
        """Tell whether a point is within the bounds.

        Args:
            point_m: (2,) x, y in map, m.

        Returns:
            True inside or on the border.
        """
        x, y = float(point_m[0]), float(point_m[1])
        x_min, y_min, x_max, y_max = self.bounds_m
        return bool(x_min <= x <= x_max and y_min <= y <= y_max)


def rasterise(
    sections: Sequence[Section], bounds_m: Sequence[float] | FloatArray, resolution_m: float = 0.02
) -> FloorPlan:
    """Make the floor plan of convex outlines.

    Args:
        sections: the outlines.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the free space in map, m.
        resolution_m: size of a cell of the raster, m.

    Returns:
        The floor plan.

    Raises:
        ValueError: the bounds have no area.
    """
    bounds = np.array(bounds_m, dtype=np.float64)
    span = bounds[2:] - bounds[:2]
    if bounds.shape != (4,) or not np.all(span > 0.0):
        raise ValueError(
            f"bounds must be x_min, y_min, x_max, y_max with a positive area: {bounds}"
        )
    columns, rows = np.maximum(1, np.ceil(span / resolution_m - 1e-9).astype(int))
    x = bounds[0] + (np.arange(columns) + 0.5) * resolution_m
    y = bounds[1] + (np.arange(rows) + 0.5) * resolution_m
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    distance = _distances(centres, *_packed(sections)).reshape(rows, columns)
    return FloorPlan(
        bounds[:2].copy(), resolution_m, distance.astype(np.float32), bounds, tuple(sections)
    )


def _packed(sections: Sequence[Section]) -> _Packed:
    """Pack all vertices (sum V, 2), the start of each section (S + 1,), and the radii (S,)."""
    outlines = [section.vertices_m for section in sections]
    starts = np.cumsum([0, *(len(outline) for outline in outlines)], dtype=np.int64)
    vertices = np.concatenate(outlines) if outlines else np.zeros((0, 2))
    return vertices, starts, np.array([section.radius_m for section in sections], dtype=np.float64)


@njit(cache=True)
def _distances(
    points: FloatArray, vertices: FloatArray, starts: NDArray[np.int64], radii: FloatArray
) -> FloatArray:
    """Compute the least signed distance (N,) of each point to the outlines of ``_packed``."""
    out = np.full(len(points), np.inf)
    for n in range(len(points)):
        for s in range(len(radii)):
            inside = starts[s + 1] - starts[s] > 2  # points and segments have no inside
            nearest = np.inf
            j = starts[s + 1] - 1
            for i in range(starts[s], starts[s + 1]):
                ax, ay = points[n, 0] - vertices[j, 0], points[n, 1] - vertices[j, 1]
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
            out[n] = min(out[n], distance - radii[s])
    return out


def outline_edges(plan: FloorPlan) -> tuple[FloatArray, FloatArray]:
    """List all edges of all outlines.

    Args:
        plan: the floor plan.

    Returns:
        (E, 2, 2) start and end of each edge, x, y in map, m, and (E,) the radius by which its
        outline is grown, m.
    """
    ends, swell = [np.zeros((0, 2, 2))], [np.zeros(0)]
    for section in plan.sections:
        vertices = section.vertices_m
        ends.append(np.stack([vertices, np.roll(vertices, -1, axis=0)], axis=1))
        swell.append(np.full(len(vertices), section.radius_m))
    return np.concatenate(ends), np.concatenate(swell)


def segment_distances(
    start_m: FloatArray, end_m: FloatArray, other_start_m: FloatArray, other_end_m: FloatArray
) -> FloatArray:
    """Compute the distances between two sets of segments.

    Args:
        start_m: (N, 2) starts of the first segments, m.
        end_m: (N, 2) their ends, m.
        other_start_m: (M, 2) starts of the second segments, m.
        other_end_m: (M, 2) their ends, m.

    Returns:
        (N, M) distances, m; 0 where two segments cross.
    """
    # If two segments do not cross, one of the four ends is nearest to the other segment.
    a, b = start_m[:, None], end_m[:, None]
    c, d = other_start_m[None], other_end_m[None]
    distance = np.minimum(
        np.minimum(_point_to_segment(a, c, d), _point_to_segment(b, c, d)),
        np.minimum(_point_to_segment(c, a, b), _point_to_segment(d, a, b)),
    )
    crossing = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.where(crossing, 0.0, distance)


def _side(a: FloatArray, b: FloatArray, point: FloatArray) -> FloatArray:
    """Compute a number that is positive where the point is to the left of a -> b."""
    ab, ap = b - a, point - a
    return ab[..., 0] * ap[..., 1] - ab[..., 1] * ap[..., 0]


def _point_to_segment(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Compute the distances of points (..., 2) to segments from a to b (..., 2)."""
    ab, ap = b - a, point - a
    length2 = np.sum(ab * ab, axis=-1)
    share = np.sum(ap * ab, axis=-1) / np.where(length2 > 0.0, length2, 1.0)
    off = ap - np.clip(share, 0.0, 1.0)[..., None] * ab
    return np.hypot(off[..., 0], off[..., 1])


def is_blocked(plan: FloorPlan, start: FloatArray, goal: FloatArray) -> bool:
    """Tell whether an obstacle is on the straight line from start to goal.

    Args:
        plan: the floor plan.
        start: (2,) x, y in map, m.
        goal: (2,) x, y in map, m.

    Returns:
        True if one of the line's points, one every centimetre, is inside an obstacle.
    """
    steps = max(2, math.ceil(math.dist(start, goal) / 0.01))
    share = np.linspace(0.0, 1.0, steps)[:, None]
    return bool(np.any(plan.clearance_m(start + share * (goal - start)) < 0.0))


def is_passable(plan: FloorPlan, start: FloatArray, goal: FloatArray, radius_m: float) -> bool:
    """Tell whether a disc can move from start to goal within the plan's bounds.

    The search is on the raster, with the disc grown by half a cell. So True is always right.

    Args:
        plan: the floor plan.
        start: (2,) x, y in map, m.
        goal: (2,) x, y in map, m.
        radius_m: radius of the disc, m.

    Returns:
        False if there is no passage, or only one too narrow for the raster.
    """
    rows, columns = plan.distance_m.shape
    x = plan.origin_m[0] + (np.arange(columns) + 0.5) * plan.resolution_m
    y = plan.origin_m[1] + (np.arange(rows) + 0.5) * plan.resolution_m
    centres = np.stack(np.meshgrid(x, y), axis=-1)
    clearance = np.minimum(plan.distance_m, distance_to_bounds(centres, plan.bounds_m))
    free = clearance > radius_m + 0.5 * plan.resolution_m
    # Start and goal are joined if their cells are in the same connected region of free cells.
    labels = np.asarray(ndimage.label(free)[0])
    cells = ((np.array([start, goal]) - plan.origin_m) / plan.resolution_m).astype(int)
    if np.any(cells < 0) or np.any(cells >= [columns, rows]):
        return False
    first, last = labels[cells[:, 1], cells[:, 0]]
    return bool(first == last and first != 0)


def distance_to_bounds(points: FloatArray, bounds: FloatArray) -> FloatArray:
    """Compute the distances of points to the nearest side of the bounds.

    Args:
        points: (..., 2) x, y, m.
        bounds: (4,) x_min, y_min, x_max, y_max, m.

    Returns:
        (...,) distances, m, negative outside.
    """
    return np.minimum(points - bounds[:2], bounds[2:] - points).min(axis=-1)
