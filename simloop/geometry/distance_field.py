"""Look up distances in a distance field, with an explicit rule for its border.

The area outside the field is unknown. The caller chooses the distance there:

- ``"edge"``: the distance at the nearest point of the field. A wall that reaches the border
  continues outside, so a path cannot go around its seen end.
- ``"free"``: `FREE_M`.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray, WorldView

FREE_M = 1e3
"""Distance where no obstacle is known, m."""

Border = Literal["edge", "free"]
"""The rule for a look-up outside the field."""


class Field(NamedTuple):
    """Distance field in the form that compiled kernels take.

    Attributes:
        distance: (rows, cols) float32 [iy, ix], distance of each cell's centre to the nearest
            obstacle, m.
        x0: x of the centre of cell (0, 0), in map, m.
        y0: y of the centre of cell (0, 0), in map, m.
        resolution: Side of a cell, m.
        free_outside: Whether the border rule is ``"free"``; otherwise it is ``"edge"``.
    """

    distance: NDArray[np.float32]
    x0: float
    y0: float
    resolution: float
    free_outside: bool


def field_of(view: WorldView, *, outside: Border) -> Field:
    """Return the distance field of a view.

    Args:
        view: The view, in map. Without a distance field everything is free.
        outside: The rule for a look-up outside the field.

    Returns:
        The field, for `distance_at` and `footprint_clearance`.
    """
    half = 0.5 * view.resolution_m
    x0, y0 = view.origin_m.tolist()
    free_outside = outside == "free" or view.distance_m.size == 0
    return Field(view.distance_m, x0 + half, y0 + half, view.resolution_m, free_outside)


@njit(cache=True, forceinline=True)
def interpolate(distance: NDArray[np.float32], u: float, v: float, free_outside: bool) -> float:
    """Interpolate a distance field bilinearly between the centres of its cells.

    Args:
        distance: (rows, cols) [iy, ix], m; at least one cell, unless ``free_outside``.
        u: Column with its fraction; 0 is the centre of the first column.
        v: Row with its fraction; 0 is the centre of the first row.
        free_outside: Whether everything beyond the outermost centres is free. Otherwise the value
            of the nearest point inside is used there.

    Returns:
        The distance, m; `FREE_M` outside the field if ``free_outside``.
    """
    rows, cols = distance.shape
    if free_outside and not (0.0 <= u < cols - 1.0 and 0.0 <= v < rows - 1.0):
        return FREE_M
    # A NaN fails the comparison, so that no index is made of it.
    u = min(u, cols - 1.0) if u > 0.0 else 0.0
    v = min(v, rows - 1.0) if v > 0.0 else 0.0
    # On the last row or column, start from the one before it. A single one is its own neighbour.
    i = min(int(u), cols - 2) if cols > 1 else 0
    j = min(int(v), rows - 2) if rows > 1 else 0
    i1 = min(i + 1, cols - 1)
    j1 = min(j + 1, rows - 1)
    a = u - i
    b = v - j
    low = distance[j, i] * (1.0 - a) + distance[j, i1] * a
    high = distance[j1, i] * (1.0 - a) + distance[j1, i1] * a
    return low * (1.0 - b) + high * b


@njit(cache=True)
def distance_at(field: Field, x: float, y: float) -> float:
    """Look up the distance of a point to the nearest obstacle.

    Args:
        field: The field, with the rule for its border.
        x: x of the point in map, m.
        y: y of the point in map, m.

    Returns:
        The distance, m.
    """
    u, v = (x - field.x0) / field.resolution, (y - field.y0) / field.resolution
    return interpolate(field.distance, u, v, field.free_outside)


@njit(cache=True)
def footprint_clearance(field: Field, x: float, y: float, yaw: float, offsets: FloatArray) -> float:
    """Look up the least distance from the centres of the footprint's discs to an obstacle.

    Args:
        field: The field, with the rule for its border.
        x: x of base_link in map, m.
        y: y of base_link in map, m.
        yaw: Yaw of base_link in map, rad.
        offsets: (n,) offsets of the discs' centres along the robot's heading, m.

    Returns:
        The least distance over all centres, m.
    """
    least = FREE_M
    cos, sin = math.cos(yaw), math.sin(yaw)
    for k in range(offsets.shape[0]):
        least = min(least, distance_at(field, x + offsets[k] * cos, y + offsets[k] * sin))
    return least
