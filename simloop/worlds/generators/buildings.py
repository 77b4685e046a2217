"""Draw buildings: rooms with doors, and walls with gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simloop.messages import FloatArray
from simloop.worlds.generators.mazes import spanning_walls
from simloop.worlds.layout import WALL_M, Bounds, box
from simloop.worlds.obstacles import Obstacle

_JAMB_M = 0.3  # least distance from a door to the corner of its room
_HALF = 0.5 * WALL_M


def rooms(
    rng: np.random.Generator, bounds: Bounds, room_m: float, door_m: float, loops: float
) -> list[Obstacle]:
    """Draw a grid of rooms. A random spanning tree decides which rooms have a door between them.

    Args:
        rng: random generator of all draws.
        bounds: x_min, y_min, x_max, y_max of the floor in map, m.
        room_m: approximate length and width of a room, m.
        door_m: width of the doors, m.
        loops: share of the other walls that also have a door, 0 to 1.

    Returns:
        The inner walls.
    """
    x0, y0, x1, y1 = bounds
    columns, rows = (max(1, round(span / room_m)) for span in (x1 - x0, y1 - y0))
    dx, dy = (x1 - x0) / columns, (y1 - y0) / rows
    if columns * rows == 1:
        return []
    east, north = spanning_walls(rng, columns, rows)
    things: list[Obstacle] = []
    for (i, j), closed in np.ndenumerate(east):
        at, low, high = x0 + (i + 1) * dx, y0 + j * dy, y0 + (j + 1) * dy
        whole = closed and rng.random() >= loops
        for a, b in _beside_a_door(rng, low, high, 0.0 if whole else door_m):
            things.append(box(at - _HALF, a, at + _HALF, b))
    for (i, j), closed in np.ndenumerate(north):
        at, low, high = y0 + (j + 1) * dy, x0 + i * dx, x0 + (i + 1) * dx
        whole = closed and rng.random() >= loops
        for a, b in _beside_a_door(rng, low, high, 0.0 if whole else door_m):
            things.append(box(a, at - _HALF, b, at + _HALF))
    return things


def gaps(
    rng: np.random.Generator,
    bounds: Bounds,
    apart_m: float,
    widths_m: Sequence[float],
    ends: FloatArray,
) -> list[Obstacle]:
    """Draw walls across the way from start to goal, each with one gap at a random place.

    Args:
        rng: random generator of all draws.
        bounds: x_min, y_min, x_max, y_max of the floor in map, m.
        apart_m: distance between two walls along x, m.
        widths_m: widths of the gaps, in turn, m.
        ends: (2, 2) start and goal, x, y in map, m; the walls are between them along x.

    Returns:
        The parts of the walls.
    """
    y0, y1 = bounds[1], bounds[3]
    low, high = np.sort(ends[:, 0])
    things: list[Obstacle] = []
    places = np.arange(low + 0.5 * apart_m, high - 0.4 * apart_m, apart_m)
    for number, at in enumerate(places.tolist()):
        width = widths_m[number % len(widths_m)]
        for a, b in _beside_a_door(rng, y0, y1, width):
            things.append(box(at - _HALF, a, at + _HALF, b))
    return things


def _beside_a_door(
    rng: np.random.Generator, low: float, high: float, door_m: float
) -> list[tuple[float, float]]:
    """Compute the parts of a wall from ``low`` to ``high`` beside a door; width 0: no door."""
    if door_m <= 0.0:
        return [(low, high)]
    jamb = min(_JAMB_M, 0.5 * max(0.0, high - low - door_m))
    first = rng.uniform(low + jamb, max(low + jamb, high - jamb - door_m))
    pieces = [(low, float(first)), (float(first) + door_m, high)]
    return [(a, b) for a, b in pieces if b - a > 1e-6]
