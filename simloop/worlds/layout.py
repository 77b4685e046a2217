"""The description of a world before it is built: obstacles, ground, loose bodies and movers."""

from __future__ import annotations

from dataclasses import dataclass

from simloop.worlds.movers.settings import Mover
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import Loose, Terrain

Bounds = tuple[float, float, float, float]
WALL_M = 0.2
"""Thickness of a wall. The LiDAR sees both faces, and they must not fall into neighbouring cells
of the robot's map."""
HEIGHT_M = 0.45
OPEN_GROUND = "field"


@dataclass(frozen=True, slots=True)
class Layout:
    """A whole world without the vehicle.

    Attributes:
        bounds_m: x_min, y_min, x_max, y_max of the free space in map; None: the arena's own.
        obstacles: obstacles in addition to the arena's own.
        arena: name or file of the MJCF arena to which the rest is added.
        terrain: ground that is not flat.
        loose: movable bodies.
        movers: things that move by themselves.
        notes: what was left out or assumed when the world was read, each in a line.
    """

    bounds_m: Bounds | None = None
    obstacles: tuple[Obstacle, ...] = ()
    arena: str = OPEN_GROUND
    terrain: Terrain | None = None
    loose: tuple[Loose, ...] = ()
    movers: tuple[Mover, ...] = ()
    notes: tuple[str, ...] = ()


def box(x0: float, y0: float, x1: float, y1: float, height_m: float = HEIGHT_M) -> Obstacle:
    """Make a box obstacle between two corners.

    Args:
        x0: least x in map, m.
        y0: least y, m.
        x1: greatest x, m.
        y1: greatest y, m.
        height_m: height of the box, m.

    Returns:
        The obstacle. It stands on the floor.
    """
    middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    return Obstacle("box", middle, (x1 - x0, y1 - y0), 0.0, height_m)


def walls_about(bounds: Bounds, wall_m: float = WALL_M) -> list[Obstacle]:
    """Make four walls around a floor.

    Args:
        bounds: x_min, y_min, x_max, y_max of the walls' inner faces, m.
        wall_m: thickness of the walls, m.

    Returns:
        The walls: south, north, west, east.
    """
    x0, y0, x1, y1 = bounds
    return [
        box(x0 - wall_m, y0 - wall_m, x1 + wall_m, y0),
        box(x0 - wall_m, y1, x1 + wall_m, y1 + wall_m),
        box(x0 - wall_m, y0, x0, y1),
        box(x1, y0, x1 + wall_m, y1),
    ]
