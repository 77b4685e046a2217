"""Least values of a distance field in windows: which segments certainly keep a clearance.

Unlike the bounds from the clearance at two ends, this holds for any field, because it is taken from
the very values that are interpolated.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.planners.problem.flat_problem import Problem

Windows = NDArray[np.float32]
_LONG_CELLS = 6.0
_MARGIN_M = 1e-9  # more than the rounding error of an interpolated value
_MARGIN_CELLS = 1e-6


@njit(cache=True)
def _widen(low: Windows, step: int) -> None:
    """Take the minimum of each window and the ones ``step`` cells further on, in place."""
    rows, cols = low.shape
    for j in range(rows):
        beyond = min(j + step, rows - 1)
        for i in range(cols):
            low[j, i] = min(low[j, i], low[beyond, i])
    for j in range(rows):
        for i in range(cols):
            low[j, i] = min(low[j, i], low[j, min(i + step, cols - 1)])


@njit(cache=True)
def window_minima(field: Windows) -> Windows:
    """Compute the least value in square windows of a field, of two sizes.

    A straight piece of at most 6 or 3 cells, wherever it lies, depends on the values of at most 9
    or 6 cells in each direction: these are the sides of the windows.

    Args:
        field: (rows, cols) distances, m.

    Returns:
        (2, rows, cols) least value in the window whose first cell is (row, col), m: first that of
        the large windows; cells beyond the field are left out.
    """
    out = np.empty((2, *field.shape), np.float32)
    out[1] = field
    for step in (1, 2, 2):  # windows of 2, 4 and 6 cells
        _widen(out[1], step)
    out[0] = out[1]
    _widen(out[0], 3)
    return out


@njit(cache=True, forceinline=True)
def _least_about(p: Problem, low: Windows, u: float, v: float, du: float, dv: float) -> float:
    """Return the least value that a piece depends on; it leads from (u, v) on by (du, dv) cells."""
    rows, cols = p.field.shape
    i = int(min(max(min(u, u + du) - _MARGIN_CELLS, 0.0), cols - 1.0))
    j = int(min(max(min(v, v + dv) - _MARGIN_CELLS, 0.0), rows - 1.0))
    return low[j, i]


@njit(cache=True)
def surely_keeps(
    p: Problem, lows: Windows, ax: float, ay: float, bx: float, by: float, clearance: float
) -> bool:
    """Tell whether the windows about a segment prove that it keeps a clearance everywhere.

    Args:
        p: The problem, with a field.
        lows: From `window_minima`.
        ax: x of the segment's start, m.
        ay: y of the segment's start, m.
        bx: x of its end, m.
        by: y of its end, m.
        clearance: The clearance, m.

    Returns:
        Whether it is proved; no value of the field on the segment is then less than ``clearance``.
    """
    u, v = (ax - p.field_x) * p.per_m, (ay - p.field_y) * p.per_m
    du, dv = (bx - ax) * p.per_m, (by - ay) * p.per_m
    count = 1 + int(math.sqrt(du * du + dv * dv) / _LONG_CELLS)
    du, dv = du / count, dv / count
    need = clearance + _MARGIN_M
    for k in range(count):
        u0, v0 = u + k * du, v + k * dv
        if _least_about(p, lows[0], u0, v0, du, dv) >= need:
            continue
        half_u, half_v = 0.5 * du, 0.5 * dv
        if _least_about(p, lows[1], u0, v0, half_u, half_v) < need:
            return False
        if _least_about(p, lows[1], u0 + half_u, v0 + half_v, half_u, half_v) < need:
            return False
    return True
