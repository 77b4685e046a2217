"""Walk through a distance field: a clearance bound for a segment, and steps from cell to cell.

The border is ``"edge"`` (`simloop.geometry.distance_field`): outside the grid the field continues
with the values at its edge.
"""

from __future__ import annotations

import math

from numba import njit

from simloop.geometry.distance_field import FREE_M


@njit(cache=True, forceinline=True)
def lens_bound(a: float, b: float, s: float) -> float:
    """Compute the least clearance that a segment can have, given the clearances of its ends.

    The two discs about the ends hold no obstacle, so the nearest possible obstacle is where their
    circles meet. The height of that point above the segment is the bound.

    Args:
        a: Clearance of one end, m.
        b: Clearance of the other end, m.
        s: Length of the segment, m.

    Returns:
        The bound, m.
    """
    if a + b <= s:
        return 0.0
    h = (a * a - b * b + s * s) / (2.0 * s)
    if h <= 0.0 or h >= s:
        return min(a, b)
    return math.sqrt(max(0.0, a * a - h * h))


@njit(cache=True, forceinline=True)
def cell_at(u: float, du: float, count: int) -> tuple[int, float, float]:
    """Compute the cell that a step enters, along one axis.

    Args:
        u: Start of the step, in cells from the first centre.
        du: Direction and speed of the step, in cells per metre.
        count: Number of cells along the axis.

    Returns:
        Index of the cell; du in the field (0 outside the grid, where the field is constant);
        distance to the cell's edge, m.
    """
    edge = 1e-12 if du > 0.0 else -1e-12
    at = u + edge
    if at < 0.0:
        return 0, 0.0, (-u / du if du > 0.0 else FREE_M)
    if at >= count - 1.0:
        return max(count - 2, 0), 0.0, ((count - 1.0 - u) / du if du < 0.0 else FREE_M)
    i = int(at)
    if du > 0.0:
        return i, du, (i + 1.0 - u) / du
    if du < 0.0:
        return i, du, (i - u) / du
    return i, 0.0, FREE_M
