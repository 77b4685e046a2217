"""What stands where, whoever said so: the bounds of a floor and the obstacles on it."""

from __future__ import annotations

from dataclasses import dataclass

from simloop.worlds.obstacles import Obstacle

Bounds = tuple[float, float, float, float]
WALL_M = 0.2
"""Of a wall: both its faces are seen, and must not fall into neighbouring cells of a map."""
HEIGHT_M = 0.45


@dataclass(frozen=True, slots=True)
class Layout:
    """bounds_m: x_min, y_min, x_max, y_max of the free space."""

    bounds_m: Bounds
    obstacles: tuple[Obstacle, ...]


def box(x0: float, y0: float, x1: float, y1: float, height_m: float = HEIGHT_M) -> Obstacle:
    """A box between two corners, m in map."""
    middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    return Obstacle("box", middle, (x1 - x0, y1 - y0), 0.0, height_m)


def walls_about(bounds: Bounds, wall_m: float = WALL_M) -> list[Obstacle]:
    """Four walls whose inner faces are the bounds."""
    x0, y0, x1, y1 = bounds
    return [
        box(x0 - wall_m, y0 - wall_m, x1 + wall_m, y0),
        box(x0 - wall_m, y1, x1 + wall_m, y1 + wall_m),
        box(x0 - wall_m, y0, x0, y1),
        box(x1, y0, x1 + wall_m, y1),
    ]
