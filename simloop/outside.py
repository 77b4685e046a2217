"""What lies about a map is free: a view of it that says so.

Planners take the distances beyond the grid to be those of its nearest cell, so that a wall at the
edge of what has been seen stands, for them, all the way out. Mostly that is as well: what
shines through behind the walls of a room is no way. Where it leaves no other, it may be one.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from simloop.messages import WorldView

RIM_M = 0.8
"""Wide enough for a way around whatever stands at the edge of the grid."""


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
