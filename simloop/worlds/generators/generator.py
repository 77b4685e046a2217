"""The table ``[generator]``: a kind of world, drawn from the scenario's seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.limits import SHAPES, check_limit
from simloop.common.quantities import STRICT, Fraction, reject
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import (
    clearances_m,
    distance_to_bounds,
    is_passable,
    rasterise,
)
from simloop.worlds.generators import buildings, fields, mazes
from simloop.worlds.layout import WALL_M, Bounds, Layout, walls_about
from simloop.worlds.obstacles import Obstacle

_TRIALS = 200  # worlds drawn before the generator gives up
_RASTER_M = 0.025
_SLACK_M = 0.02  # room beside the robot in addition to half its width
_TURNING_ROOM_M = 0.08  # room that barn and forest leave at the ends beside the turning radius
Metres = Annotated[float, Field(gt=0.0, le=100.0)]


@dataclass(frozen=True, slots=True, config=STRICT)
class Generator:
    """A floor from (0, 0) to ``size_m`` with walls around it, and a kind of world inside.

    Attributes:
        kind: ``barn``: clumps of cylinders of 0.15 m, after the BARN data set; ``forest``: round
            trunks of 0.1 to 0.4 m; ``rooms``: rooms joined by doors; ``maze``: corridors;
            ``gaps``: walls across the way, with one gap each; ``utrap``: U-shaped dead ends.
        size_m: length along x and along y, m.
        width_m: least distance between trunks, width of doors or width of corridors, m.
        cell_m: size of rooms, distance between the walls with gaps, or depth of dead ends, m.
        gaps_m: widths of the gaps, in turn, m.
        density: for a barn, share of the cells that are filled before clumping; for a forest, share
            of the trunks that would fill the ground.
        loops: share of the walls of a tree of rooms that get a door, or of a perfect maze that are
            left out.
        count: number of dead ends.
    """

    kind: Literal["barn", "forest", "rooms", "maze", "gaps", "utrap"]
    size_m: tuple[Metres, Metres] = (10.0, 10.0)
    width_m: Annotated[float, Field(gt=0.0, le=20.0)] = 0.8
    cell_m: Annotated[float, Field(ge=0.5, le=50.0)] = 3.0
    gaps_m: tuple[Metres, ...] = (0.8, 0.65, 0.55)
    density: Fraction = 0.2
    loops: Fraction = 0.0
    count: Annotated[int, Field(ge=1, le=50)] = 2

    @model_validator(mode="after")
    def _fits(self) -> Generator:
        if self.kind == "gaps" and (not self.gaps_m or max(self.gaps_m) >= self.size_m[1]):
            raise reject("generator.gaps_m: give one gap or more, each narrower than size_m in y")
        if self.kind == "maze" and min(self.size_m) < 2.0 * (self.width_m + WALL_M):
            raise reject("generator.size_m: too small for two corridors of width_m")
        return self

    @property
    def bounds_m(self) -> Bounds:
        """x_min, y_min, x_max, y_max of the floor in map, m."""
        return (0.0, 0.0, *self.size_m)


def draw_world(
    generator: Generator,
    rng: np.random.Generator,
    start: Sequence[float],
    goal: Sequence[float],
    body: Body,
) -> Layout:
    """Draw worlds until the robot can get from start to goal, with room to turn at both.

    Args:
        generator: the kind of world and its sizes.
        rng: random generator of all draws.
        start: (2,) or (3,) x, y, ... of the robot in map, m.
        goal: (2,) x, y in map, m.
        body: the robot's true outline.

    Returns:
        The floor's bounds and its obstacles, including the walls.

    Raises:
        ValueError: the start or the goal is outside or too near to a wall, the world has too many
            obstacles, or none of 200 worlds can be crossed.
    """
    ends, bounds = np.array([start[:2], goal[:2]], float), generator.bounds_m
    turning_m = body.turning_radius_m + _TURNING_ROOM_M
    half_m = 0.5 * body.width_m + _SLACK_M
    _check_ends(ends, bounds, turning_m - _TURNING_ROOM_M)
    for _ in range(_TRIALS):
        things = _DRAW[generator.kind](generator, rng, ends)
        check_limit(len(things), SHAPES, f"generator: obstacles of this {generator.kind}")
        if generator.kind in ("barn", "forest"):
            things = [one for one in things if _clear(one, ends, turning_m)]
        obstacles = [*walls_about(bounds), *things]
        if not _roomy(obstacles, ends, turning_m - _TURNING_ROOM_M):
            continue
        plan = rasterise([s for one in obstacles for s in one.sections()], bounds, _RASTER_M)
        if is_passable(plan, ends[0], ends[1], half_m):
            return Layout(bounds, tuple(obstacles))
    raise ValueError(
        f"generator: no passable {generator.kind} in {_TRIALS} trials; ask for more room, "
        "or move start or goal"
    )


def _check_ends(ends: np.ndarray, bounds: Bounds, room_m: float) -> None:
    """Raise ValueError for ends (2, 2) that no world can have, before any is drawn."""
    for key, end, gap in zip(
        ("start", "goal"), ends, distance_to_bounds(ends, np.array(bounds)), strict=True
    ):
        place = f"generator: {key} ({end[0]:g}, {end[1]:g})"
        if not gap >= 0.0:
            raise ValueError(f"{place} is outside the floor")
        if gap < room_m:
            raise ValueError(
                f"{place} is {gap:.2f} m from a wall; the robot needs {room_m:.2f} m to turn there"
            )


def _roomy(obstacles: Sequence[Obstacle], ends: np.ndarray, room_m: float) -> bool:
    """Tell whether all obstacles leave enough room at both ends (2, 2)."""
    places = np.array([one.position_m for one in obstacles])
    reach = np.array([math.hypot(*one.size_m) for one in obstacles]) + room_m
    near = np.zeros(len(obstacles), np.bool_)
    for end in ends:
        near |= np.hypot(*(places - end).T) <= reach
    sections = [s for index in np.flatnonzero(near).tolist() for s in obstacles[index].sections()]
    return bool(np.all(clearances_m(sections, ends) >= room_m))


def _clear(one: Obstacle, ends: np.ndarray, room_m: float) -> bool:
    """Tell whether a round obstacle leaves enough room at both ends (2, 2)."""
    off = np.hypot(*(ends - np.array(one.position_m)).T) - 0.5 * one.size_m[0]
    return bool(np.all(off >= room_m))


def _barn(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return fields.barn(rng, g.bounds_m, g.density)


def _forest(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return fields.forest(rng, g.bounds_m, g.width_m, g.density)


def _rooms(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return buildings.rooms(rng, g.bounds_m, g.cell_m, g.width_m, g.loops)


def _maze(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return mazes.maze(rng, g.bounds_m, g.width_m, g.loops)


def _gaps(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return buildings.gaps(rng, g.bounds_m, g.cell_m, g.gaps_m, ends)


def _utrap(g: Generator, rng: np.random.Generator, ends: np.ndarray) -> list[Obstacle]:
    return mazes.dead_ends(rng, g.cell_m, g.count, ends)


_DRAW: dict[str, Callable[[Generator, np.random.Generator, np.ndarray], list[Obstacle]]] = {
    "barn": _barn,
    "forest": _forest,
    "rooms": _rooms,
    "maze": _maze,
    "gaps": _gaps,
    "utrap": _utrap,
}
