"""Draw mazes, and dead ends between start and goal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.worlds.layout import WALL_M, Bounds, box
from simloop.worlds.obstacles import Obstacle


def maze(
    rng: np.random.Generator, bounds: Bounds, corridor_m: float, loops: float
) -> list[Obstacle]:
    """Draw a maze that fills the floor.

    Args:
        rng: random generator of all draws.
        bounds: x_min, y_min, x_max, y_max of the floor in map, m.
        corridor_m: least width of the corridors, m.
        loops: share of a perfect maze's walls that are left out, 0 to 1.

    Returns:
        The inner walls.
    """
    x0, y0, x1, y1 = bounds
    columns, rows = (
        max(2, int(span / (corridor_m + WALL_M) + 1e-9)) for span in (x1 - x0, y1 - y0)
    )
    east, north = spanning_walls(rng, columns, rows)
    east &= rng.random(east.shape) >= loops
    north &= rng.random(north.shape) >= loops
    dx, dy, half = (x1 - x0) / columns, (y1 - y0) / rows, 0.5 * WALL_M
    upright = [
        box(x0 + i * dx - half, y0 + a * dy - half, x0 + i * dx + half, y0 + b * dy + half)
        for i in range(1, columns)
        for a, b in _runs(east[i - 1])
    ]
    level = [
        box(x0 + a * dx - half, y0 + j * dy - half, x0 + b * dx + half, y0 + j * dy + half)
        for j in range(1, rows)
        for a, b in _runs(north[:, j - 1])
    ]
    return upright + level


def spanning_walls(
    rng: np.random.Generator, columns: int, rows: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Draw a perfect maze: walls remain where a random depth-first tree does not join two cells.

    Args:
        rng: random generator of all draws.
        columns: number of cells along x.
        rows: number of cells along y.

    Returns:
        (columns - 1, rows) whether a wall is east of each cell, and (columns, rows - 1) whether
        one is north of it.
    """
    east = np.ones((columns - 1, rows), bool)
    north = np.ones((columns, rows - 1), bool)
    seen = np.zeros((columns, rows), bool)
    stack = [(int(rng.integers(columns)), int(rng.integers(rows)))]
    seen[stack[0]] = True
    while stack:
        i, j = stack[-1]
        around = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        ways = [(a, b) for a, b in around
                if 0 <= a < columns and 0 <= b < rows and not seen[a, b]]  # fmt: skip
        if not ways:
            stack.pop()
            continue
        a, b = ways[int(rng.integers(len(ways)))]
        if a != i:
            east[min(a, i), j] = False
        else:
            north[i, min(b, j)] = False
        seen[a, b] = True
        stack.append((a, b))
    return east, north


def _runs(walls: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """List the start and end of each run of walls. A straight wall then becomes one box."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], walls, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def dead_ends(
    rng: np.random.Generator, depth_m: float, count: int, ends: FloatArray
) -> list[Obstacle]:
    """Draw U-shaped traps on the straight line from start to goal, open towards the start.

    Args:
        rng: random generator of all draws.
        depth_m: greatest depth and width of a trap, m.
        count: number of traps.
        ends: (2, 2) start and goal, x, y in map, m.

    Returns:
        Three walls for each trap.
    """
    way = ends[1] - ends[0]
    heading, length = math.atan2(way[1], way[0]), float(np.hypot(*way))
    things: list[Obstacle] = []
    for number in range(count):
        deep, wide = rng.uniform(0.5, 1.0, 2) * depth_m
        share = (number + rng.uniform(0.6, 1.0)) / (count + 0.6)
        aside = rng.uniform(-0.3, 0.3) * wide
        turn = heading + rng.uniform(-0.4, 0.4)
        middle = ends[0] + share * way + aside * np.array([-way[1], way[0]]) / length
        things += _trap(middle, turn, float(deep), float(wide))
    return things


def _trap(back: FloatArray, turn: float, deep: float, wide: float) -> list[Obstacle]:
    """Make three walls: a back with its middle at ``back`` (2,), and arms against ``turn``."""
    cos, sin = math.cos(turn), math.sin(turn)

    def wall(x: float, y: float, length: float, width: float) -> Obstacle:
        place = (float(back[0] + cos * x - sin * y), float(back[1] + sin * x + cos * y))
        return Obstacle("box", place, (length, width), turn, 0.45)

    arms = [wall(-0.5 * deep, side * 0.5 * (wide - WALL_M), deep, WALL_M) for side in (-1.0, 1.0)]
    return [wall(-0.5 * WALL_M, 0.0, WALL_M, wide), *arms]
