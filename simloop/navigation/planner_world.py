"""The planner's world: the map's view with the predicted movers in it and free space around it.

A robot that starts at its cruising speed v is, after t seconds, on a circle of radius v t about its
start. It meets a mover where the mover's course crosses that circle: before that time the robot has
not yet arrived, after it the robot has passed. Each mover is therefore put where it will be at
about that time. Every planner that keeps clear of obstacles then also keeps clear of movers. (The
time-space view of moving obstacles is Fujimura & Samet's, 1989; the circle reduces it to a plane.)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray, MoverTracks, WorldView

RIM_M = 0.8
"""Width of the free rim, m: room for a way around any obstacle at the edge of the grid."""


_HORIZON_S = 4.0  # a later meeting is ignored: such predictions are mostly wrong
_BEFORE_S, _AFTER_S = 0.3, 0.7  # time span about the meeting: the robot may be slower than expected
_STEP_M = 0.05  # distance between the discs that represent one mover
_GROWS_MPS = 0.05  # growth of the discs' radius with the prediction time


def meeting_time(
    place: FloatArray, velocity: FloatArray, start: FloatArray, speed_mps: float
) -> float | None:
    """Compute when a mover is as far from the robot's start as the robot itself.

    Args:
        place: (2,) position of the mover, in map, m.
        velocity: (2,) velocity of the mover, in map, m/s.
        start: (2+,) start of the robot, in map, m.
        speed_mps: Speed of the robot, m/s.

    Returns:
        Time from now, s; None if that never happens.
    """
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


def add_predicted_movers(
    view: WorldView, tracks: MoverTracks | None, start: FloatArray, speed_mps: float
) -> WorldView:
    """Add the movers to a view, where the robot would meet them.

    Args:
        view: The map's view.
        tracks: The tracked movers; None if no mover is known.
        start: (3,) pose of the robot, in map, m, m, rad.
        speed_mps: Cruising speed of the robot, m/s.

    Returns:
        The view with the movers as discs and in its distance field; the same view without movers.
    """
    if tracks is None or view.distance_m.size == 0:
        return view
    discs: list[tuple[float, float, float]] = []
    for here, velocity, radius in zip(
        tracks.places_at(view.t_ns), tracks.velocity_mps, tracks.radius_m, strict=True
    ):
        when = meeting_time(here, velocity, start, speed_mps)
        if when is None or when > _HORIZON_S:
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
    """Lower the distances of a field to those from discs, in place.

    Args:
        distance: (rows, cols) distances at the cells' centres, m.
        x0: x of the lower left corner of cell (0, 0), in map, m.
        y0: y of that corner, in map, m.
        resolution: Size of a cell, m.
        discs: (n, 3) x, y, radius in map, m.
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


def with_free_rim(view: WorldView) -> WorldView:
    """Surround a view's grid with ``RIM_M`` of free space.

    Planners extend the grid with the distances of its nearest cells, so a wall at the edge of the
    known area continues outwards for them. That is mostly right: free cells seen behind the walls
    of a room are no way. If there is no other way, they may be one.

    No obstacle lies outside the grid, and the grid is convex. A place that is a metres from its
    nearest cell, where that cell is d metres from an obstacle, is therefore at least hypot(a, d)
    from all obstacles.

    Args:
        view: The map's view.

    Returns:
        The wider view; the same view if it has no distance field.
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
    """Return (cells + 2 rim,) how far each cell lies beyond a row of ``cells``, in cells."""
    place = np.arange(-rim, cells + rim)
    return np.maximum(0, np.maximum(-place, place - cells + 1)).astype(float)
