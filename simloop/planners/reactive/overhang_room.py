"""Bend a point's trace where the vehicle's front or rear would come too near to an obstacle.

A step-by-step planner moves a point. Where the point walks up to a wall and turns, the vehicle's
front disc, an overhang ahead, comes nearer to the wall than the point. Keeping the point farther
from all obstacles helps, but it also closes gaps that are wide enough. Here only the stretches that
lack clearance are changed: they are drawn taut (each of their points moves to the middle of its
neighbours) and kept at a distance from the obstacles, as an elastic band (Quinlan & Khatib 1993).
The vehicle then turns earlier, and wiggles disappear. The trace passes all obstacles on the same
side as before.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import STACK, Problem, segment_clearance
from simloop.planners.reactive.surface import inside_bounds, nearest_surface

_SPACING_SAFE = 0.4  # distance between the points, in safe distances: a step of the walks
_MARGIN_SHARE = 0.05  # the points keep a little more than the safe distance, for the chords between
_REACH_OVERHANGS = 2.0  # a stretch extends this far beyond the segments that lack clearance
_ROUNDS, _SWEEPS = 30, 4


def with_room(p: Problem, trace: FloatArray) -> FloatArray:
    """Bend a trace that leads from the start to the goal, where the vehicle's ends lack room.

    Args:
        p: The planning problem.
        trace: (n >= 2, 2) the point's positions, m, map frame.

    Returns:
        (k, 2) positions, m, map frame, with the same ends. Nothing proves that they keep the safe
        distance.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trace, axis=0).T))])
    spacing = _SPACING_SAFE * p.safe_m
    count = max(2, 1 + int(np.ceil(arc[-1] / spacing)))
    along = np.linspace(0.0, arc[-1], count)
    points = np.column_stack([np.interp(along, arc, trace[:, i]) for i in range(2)])
    reach = 1 + int(np.ceil(_REACH_OVERHANGS * p.overhang_m / spacing))
    _bend(p, points, reach)
    return points


@njit(cache=True)
def _bend(p: Problem, points: FloatArray, reach: int) -> None:
    """Bend ``points`` (n, 2) in place until no segment lacks clearance, or the rounds are over."""
    n = points.shape[0]
    margin = _MARGIN_SHARE * p.safe_m
    moves, stack, need = np.zeros(n, np.bool_), np.zeros((STACK, 3)), p.safe_m - p.tolerance_m
    for _ in range(_ROUNDS):
        moves[:] = False
        lacks = False
        for i in range(n - 1):
            clear = segment_clearance(
                p, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1], need, need, stack
            )
            if clear < need:
                lacks = True
                moves[max(1, i - reach) : min(n - 1, i + 2 + reach)] = True
        if not lacks:
            return
        for _ in range(_SWEEPS):
            for i in range(1, n - 1):
                if moves[i]:
                    x = 0.5 * (points[i - 1, 0] + points[i + 1, 0])
                    y = 0.5 * (points[i - 1, 1] + points[i + 1, 1])
                    gap, ux, uy = nearest_surface(p, x, y)
                    if gap < margin:
                        x, y = x + (margin - gap) * ux, y + (margin - gap) * uy
                    if inside_bounds(p, x, y):
                        points[i, 0], points[i, 1] = x, y
