"""The force field that a chromosome deforms, and the walk of a point through it.

Source: Mohamed & Abbas 2012, Eqs. 4-18; see `simloop.planners.reactive.ga_apf`.

A walk depends on a gene only from the first step that it deforms on. A walk therefore notes its
state at that step, for each gene. The walk of another chromosome whose first genes are the same
goes on from there, step by step as if it had begun at the start.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.surface import inside_bounds, nearest_surface

STEP_SHARE = 0.5
"""The share of Eq. 17 (printed there as a partial derivative sign)."""
MU = 10.0
"""mu of Eq. 18: weight of the distance to the goal in an invalid path."""
MOST_STEPS = 4000
"""Largest number of points of a walk (the paper: "the maximum number of iterations")."""
NOTES = 6
"""Numbers that describe a walk at one step: the step, x, y, the length so far, and x, y of the
position that the next check for progress compares with."""
_MOST_OF_GAP = 0.9
_STILL_STEPS = 64  # after this many steps without progress, the forces cancel
# A walk is ended early only if it is too long by more than the rounding errors of its length.
_TOO_LONG = 1.0 + 1e-9


class Field(NamedTuple):
    """The force field that a point follows.

    Attributes:
        p: The planning problem, with the obstacles that repel.
        along: (F,) distances from the start at which the frontal lines cross the direct line, m.
        epsilon: Strength of the repulsion (Eq. 13), m^2.
        strip: Largest distance from the direct line, m.
    """

    p: Problem
    along: FloatArray
    epsilon: float
    strip: float


@njit(cache=True, forceinline=True)
def _direction(p: Problem) -> tuple[float, float]:
    """Return the unit vector of the direct line."""
    dx, dy = p.goal_x - p.start_x, p.goal_y - p.start_y
    reach = math.hypot(dx, dy)
    return dx / reach, dy / reach


@njit(cache=True, forceinline=True)
def _distance_left(p: Problem, x: float, y: float) -> float:
    """Return the distance from a place to the goal, m."""
    return math.hypot(p.goal_x - x, p.goal_y - y)


@njit(cache=True, forceinline=True)
def _begin(
    p: Problem, notes: FloatArray, known: int
) -> tuple[int, float, float, float, float, float]:
    """Return the state that a walk begins with: at the start, or as the note of a gene says."""
    if known == 0:
        return 1, p.start_x, p.start_y, 0.0, p.start_x, p.start_y
    row = notes[known]
    return int(row[0]), row[1], row[2], row[3], row[4], row[5]


@njit(cache=True, forceinline=True)
def _note(
    row: FloatArray, n: int, x: float, y: float, length: float, back_x: float, back_y: float
) -> None:
    """Write the state of a walk into the note of a gene."""
    row[0], row[1], row[2], row[3], row[4], row[5] = n, x, y, length, back_x, back_y


@njit(cache=True, forceinline=True)
def _step(f: Field, theta: float, gap: float, nx: float, ny: float) -> tuple[float, float, float]:
    """Return one step along x and y, and its length, m; theta: direction of the attraction."""
    # Attraction of unit size (Eqs. 7, 8) plus repulsion from the nearest surface (Eq. 14).
    push = f.epsilon / (gap * gap)
    fx, fy = math.cos(theta) + push * nx, math.sin(theta) + push * ny
    # Eq. 17, shortened so that the step does not end in the obstacle.
    step, force = STEP_SHARE * gap, math.hypot(fx, fy)
    if step * force > _MOST_OF_GAP * gap:
        step *= _MOST_OF_GAP * gap / (step * force)
    return step * fx, step * fy, step * force


@njit(cache=True)
def walk(
    f: Field, genes: FloatArray, notes: FloatArray, known: int, limit: float, path: FloatArray
) -> tuple[int, float, bool, int]:
    """Follow the field that a chromosome deforms (Mohamed 2012, Eqs. 4-17).

    A path that leaves the strip or the bounds ends there.

    Args:
        f: The field.
        genes: (F,) turns of the attraction, rad, one for each frontal obstacle.
        notes: (F, NOTES) receives the state of the walk just before each gene is first used. Row
            ``known`` holds the state to go on from, unless ``known`` is 0.
        known: Number of leading genes whose walk is known.
        limit: The walk may end as soon as its cost (length, plus mu times the distance left if it
            is invalid) is certain to be greater, m.
        path: (MOST_STEPS, 2) receives the points, m, map frame; (0, 2) if nobody needs them.

    Returns:
        Number of points; cost, m, infinite if it is greater than the limit; whether the path ends
        at the goal; number of genes that have a note.
    """
    p, count = f.p, f.along.size
    ux, uy = _direction(p)
    first, x, y, length, back_x, back_y = _begin(p, notes, known)
    noted, keeps, limit = known, path.shape[0] > 0, limit * _TOO_LONG
    if keeps:
        path[0, 0], path[0, 1] = x, y
    for n in range(first, MOST_STEPS):
        left = _distance_left(p, x, y)
        # No way to the goal is shorter than the straight one, and mu is more than 1.
        if length + left > limit:
            return n, np.inf, False, noted
        gap, nx, ny = nearest_surface(p, x, y)
        # If the goal is nearer than any obstacle, the straight way to it is free.
        if left <= gap or left < 1e-9:
            if keeps:
                path[n, 0], path[n, 1] = p.goal_x, p.goal_y
            return n + 1, length + left, True, noted
        s = ux * (x - p.start_x) + uy * (y - p.start_y)
        # The gene of the next frontal line applies; there is no deformation beyond the last line.
        gene = 0
        while gene < count and s >= f.along[gene]:
            gene += 1
        while noted <= gene and noted < count:
            _note(notes[noted], n, x, y, length, back_x, back_y)
            noted += 1
        turn = genes[gene] if gene < count else 0.0
        theta, gap = math.atan2(p.goal_y - y, p.goal_x - x) + turn, max(gap, 1e-3 * p.safe_m)
        step_x, step_y, moved = _step(f, theta, gap, nx, ny)
        x, y, length = x + step_x, y + step_y, length + moved
        across = abs(uy * (x - p.start_x) - ux * (y - p.start_y))
        if across > f.strip or not inside_bounds(p, x, y):
            return n, length + MU * left, False, noted
        if keeps:
            path[n, 0], path[n, 1] = x, y
        if n % _STILL_STEPS == 0:
            if math.hypot(x - back_x, y - back_y) < math.sqrt(f.epsilon):
                return n + 1, length + MU * _distance_left(p, x, y), False, noted
            back_x, back_y = x, y
    return MOST_STEPS, length + MU * _distance_left(p, x, y), False, noted
