"""Where what moves will be by the time that the robot gets there, as a planner's obstacles.

A robot that sets out at its cruising speed is, t seconds later, on a circle of v t about its start.
A mover is in its way where its own course crosses that circle: earlier the robot is not there yet,
later it has gone by. So each mover stands in the planner's world where it will be about then, and
every planner that keeps clear of obstacles keeps clear of it in time as well. (The time-space view
of moving obstacles is Fujimura & Samet's, 1989; the circle keeps it in the plane.)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray, MoverTracks, WorldView

RIM_M = 0.8
"""Wide enough for a way around whatever stands at the edge of the grid."""


_FORESEEN_S = 4.0  # beyond, a mover has most likely thought better of it
_BEFORE_S, _AFTER_S = 0.3, 0.7  # about the meeting: the robot may turn out slower than it thinks
_STEP_M = 0.05
_GROWS_MPS = 0.05


def meeting_time(
    place: FloatArray, velocity: FloatArray, start: FloatArray, speed_mps: float
) -> float | None:
    """s until a mover at ``place`` (2,) with ``velocity`` (2,) is as far from ``start`` (2+) as a
    robot has come that left it at ``speed_mps``; None if never."""
    x, y = place[0] - start[0], place[1] - start[1]
    vx, vy = float(velocity[0]), float(velocity[1])
    # |p + v t| = s t: (v.v - s.s) t^2 + 2 p.v t + p.p = 0, the first root from now on.
    a, b, c = vx * vx + vy * vy - speed_mps**2, x * vx + y * vy, x * x + y * y
    if abs(a) < 1e-9:
        return -0.5 * c / b if b < 0.0 else None
    inside = b * b - a * c
    if inside < 0.0:
        return None
    roots = sorted(((-b - math.sqrt(inside)) / a, (-b + math.sqrt(inside)) / a))
    return next((t for t in roots if t >= 0.0), None)


def foresee(
    view: WorldView, tracks: MoverTracks | None, start: FloatArray, speed_mps: float
) -> WorldView:
    """The view with what moves in it, seen by a robot that leaves ``start`` (3,) at a speed."""
    if tracks is None or view.distance_m.size == 0:
        return view
    discs: list[tuple[float, float, float]] = []
    for here, velocity, radius in zip(
        tracks.places_at(view.t_ns), tracks.velocity_mps, tracks.radius_m, strict=True
    ):
        when = meeting_time(here, velocity, start, speed_mps)
        if when is None or when > _FORESEEN_S:
            continue
        first, last = max(0.0, when - _BEFORE_S), when + _AFTER_S
        count = 1 + math.ceil(math.hypot(*velocity) * (last - first) / _STEP_M)
        for t in np.linspace(first, last, count):
            x, y = (here + t * velocity).tolist()
            discs.append((x, y, float(radius) + _GROWS_MPS * float(t)))
    if not discs:
        return replace(view, movers=tracks)
    found = np.array(discs)
    distance = view.distance_m.copy()
    put_discs(distance, *view.origin_m.tolist(), view.resolution_m, found)
    return replace(
        view,
        distance_m=distance,
        discs_xyr_m=np.concatenate((view.discs_xyr_m, found)),
        movers=tracks,
    )


@njit(cache=True)
def put_discs(
    distance: NDArray[np.float32], x0: float, y0: float, resolution: float, discs: FloatArray
) -> None:
    """Lower distances (rows, cols) at cells' centres to those from discs (n, 3), in place.

    (x0, y0): the first cell's lower left corner, m.
    """
    for row in range(distance.shape[0]):
        y = y0 + (row + 0.5) * resolution
        for col in range(distance.shape[1]):
            x = x0 + (col + 0.5) * resolution
            for k in range(discs.shape[0]):
                dx, dy = x - discs[k, 0], y - discs[k, 1]
                reach = distance[row, col] + discs[k, 2]
                if dx * dx + dy * dy < reach * reach:
                    distance[row, col] = max(0.0, math.sqrt(dx * dx + dy * dy) - discs[k, 2])


def opened(view: WorldView) -> WorldView:
    """The view with ``RIM_M`` of free space about its grid.

    No obstacle lies outside, and the grid is convex: a place ``a`` m from its nearest cell, which
    is ``d`` m from an obstacle, is at least hypot(a, d) from all of them.
    """
    if not view.distance_m.size:
        return view
    rim = math.ceil(RIM_M / view.resolution_m)
    rows, cols = view.distance_m.shape
    inside = np.pad(view.distance_m, rim, mode="edge")
    away = np.hypot(_beyond(cols, rim)[None, :], _beyond(rows, rim)[:, None]) * view.resolution_m
    distance = np.where(away > 0.0, np.hypot(np.maximum(inside, 0.0), away), inside)
    return replace(
        view,
        origin_m=view.origin_m - rim * view.resolution_m,
        distance_m=distance.astype(np.float32),
    )


def _beyond(cells: int, rim: int) -> np.ndarray:
    """(cells + 2 rim,) how many cells each lies beyond a row of ``cells``."""
    place = np.arange(-rim, cells + rim)
    return np.maximum(0, np.maximum(-place, place - cells + 1)).astype(float)
