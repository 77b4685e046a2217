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
from numpy.typing import NDArray
from scipy import ndimage

from simloop.common.limits import ARENA_SIDE_M, CELLS, check_limit
from simloop.geometry.outline_distance import (
    Index,
    Outlines,
    distances,
    each_distance,
    raster,
)
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
        outlines: the same in arrays.
        index: the outlines that can be the nearest in each block of the raster, if there are any.
    """

    origin_m: FloatArray
    resolution_m: float
    distance_m: NDArray[np.float32]
    bounds_m: FloatArray
    sections: tuple[Section, ...] = field(repr=False)
    outlines: Outlines = field(init=False, repr=False)
    index: Index | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "outlines", _packed(self.sections))
        object.__setattr__(self, "index", None)
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
        return distances(points, self.outlines, self.index)

    def nearest(self, point_m: Sequence[float] | FloatArray) -> tuple[float, str]:
        """Find the obstacle nearest to a point.

        Args:
            point_m: (2,) x, y in map, m.

        Returns:
            The signed distance, m, negative inside, and the obstacle's name; inf and "nothing" if
            there are no obstacles.
        """
        if not self.sections:
            return math.inf, "nothing"
        each = each_distance(np.asarray(point_m, dtype=np.float64), self.outlines)
        least = float(each.min())
        return least, min(self.sections[s].name for s in np.flatnonzero(each == least))

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
        resolution_m: size of a cell of the raster, m. A floor that would have more than
            ``limits.CELLS`` of them gets larger cells.

    Returns:
        The floor plan.

    Raises:
        ValueError: the bounds have no area, or a side is longer than ``limits.ARENA_SIDE_M``.
    """
    bounds = np.array(bounds_m, dtype=np.float64)
    span = bounds[2:] - bounds[:2]
    if bounds.shape != (4,) or not np.all(span > 0.0):
        raise ValueError(
            f"bounds must be x_min, y_min, x_max, y_max with a positive area: {bounds}"
        )
    check_floor(bounds)
    resolution_m = max(resolution_m, math.sqrt(float(np.prod(span)) / CELLS))
    columns, rows = np.maximum(1, np.ceil(span / resolution_m - 1e-9).astype(int))
    x = bounds[0] + (np.arange(columns) + 0.5) * resolution_m
    y = bounds[1] + (np.arange(rows) + 0.5) * resolution_m
    distance, index = raster(x, y, _packed(sections))
    plan = FloorPlan(bounds[:2].copy(), resolution_m, distance, bounds, tuple(sections))
    # A copy with other sections must not keep the index, so it is no argument of the constructor.
    object.__setattr__(plan, "index", index)
    return plan


def clearances_m(sections: Sequence[Section], points_m: FloatArray) -> FloatArray:
    """Compute exact signed distances to outlines without making a floor plan.

    Args:
        sections: the outlines.
        points_m: (N, 2) x, y in map, m.

    Returns:
        (N,) distances, m, as `FloorPlan.clearance_m`.
    """
    return distances(np.ascontiguousarray(points_m, dtype=np.float64), _packed(sections), None)


def check_floor(bounds_m: Sequence[float] | FloatArray) -> None:
    """Check that a floor is not too large, before memory is taken for it.

    Args:
        bounds_m: (4,) x_min, y_min, x_max, y_max in map, m.

    Raises:
        InputError: a side is longer than ``limits.ARENA_SIDE_M``. The text has one line.
    """
    x_min, y_min, x_max, y_max = bounds_m
    check_limit(max(x_max - x_min, y_max - y_min), ARENA_SIDE_M, "a side of the floor", "m")


def _packed(sections: Sequence[Section]) -> Outlines:
    outlines = [section.vertices_m for section in sections]
    starts = np.cumsum([0, *(len(outline) for outline in outlines)], dtype=np.int64)
    vertices = np.concatenate(outlines) if outlines else np.zeros((0, 2))
    radii = np.array([section.radius_m for section in sections], dtype=np.float64)
    return Outlines(vertices, starts, radii)


def outline_edges(sections: Sequence[Section]) -> tuple[FloatArray, FloatArray]:
    """List all edges of outlines.

    Args:
        sections: the outlines.

    Returns:
        (E, 2, 2) start and end of each edge, x, y in map, m, and (E,) the radius by which its
        outline is grown, m.
    """
    ends, swell = [np.zeros((0, 2, 2))], [np.zeros(0)]
    for section in sections:
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
    # In double precision, as a float32 limit could be on the other side of a cell's distance.
    least = np.float64(radius_m + 0.5 * plan.resolution_m)
    free = plan.distance_m > least
    x_min, y_min, x_max, y_max = plan.bounds_m
    free &= (np.minimum(x - x_min, x_max - x) > least)[None, :]
    free &= (np.minimum(y - y_min, y_max - y) > least)[:, None]
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
