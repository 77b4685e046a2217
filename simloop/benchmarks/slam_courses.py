"""Courses for measuring the mapper: an arena and the route along which the robot is driven.

Each course is drawn from a seed. Walls are boxes 0.2 m thick. The route is a chain of straight
segments that keeps clear of all obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simloop.config import FrictionZone
from simloop.messages import FloatArray

_WALL_M = 0.2
_HEIGHT_M = 0.5
_CLEAR_M = 0.65  # distance between the route and an obstacle's circumscribed circle
_DOOR_M = 1.5
Box = tuple[float, float, float, float]
"""x, y of the centre, size along x, size along y, m, map frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """An arena and a route through it.

    Attributes:
        name: Name of the course.
        boxes: Walls and obstacles.
        route_m: (n, 2) corners of the route, m, map frame.
        bounds: x_min, y_min, x_max, y_max, m, map frame.
        zones: Areas with other friction.
    """

    name: str
    boxes: tuple[Box, ...]
    route_m: FloatArray
    bounds: tuple[float, float, float, float]
    zones: tuple[FrictionZone, ...] = ()

    def to_mjcf(self) -> str:
        """Write the arena in MuJoCo's format.

        Returns:
            An XML document that `simloop.worlds.arena.build` reads from a file.
        """
        x0, y0, x1, y1 = self.bounds
        geoms = "\n".join(
            f'<geom name="wall_{k}" type="box" pos="{x:.4f} {y:.4f} {0.5 * _HEIGHT_M}" '
            f'size="{0.5 * dx:.4f} {0.5 * dy:.4f} {0.5 * _HEIGHT_M}"/>'
            for k, (x, y, dx, dy) in enumerate(self.boxes)
        )
        reach = 2.0 + max(abs(v) for v in self.bounds)
        return f"""<mujoco model="{self.name}">
<custom><numeric name="bounds" data="{x0} {y0} {x1} {y1}"/></custom>
<worldbody><light pos="0 0 5"/>
<geom name="floor" type="plane" size="{reach} {reach} 0.1"/>
{geoms}
</worldbody></mujoco>"""


def _walls(x0: float, y0: float, x1: float, y1: float) -> list[Box]:
    """Make four walls whose inner faces lie on this rectangle, m."""
    x, y, w = 0.5 * (x0 + x1), 0.5 * (y0 + y1), _WALL_M
    return [
        (x, y0 - 0.5 * w, x1 - x0 + 2 * w, w),
        (x, y1 + 0.5 * w, x1 - x0 + 2 * w, w),
        (x0 - 0.5 * w, y, w, y1 - y0 + 2 * w),
        (x1 + 0.5 * w, y, w, y1 - y0 + 2 * w),
    ]


def _obstacles(
    rng: np.random.Generator, bounds: Box, route: FloatArray, count: int, tries: int = 400
) -> list[Box]:
    """Draw boxes with sides of 0.2 to 0.9 m that keep clear of the route."""
    found: list[Box] = []
    for _ in range(tries):
        if len(found) == count:
            break
        dx, dy = rng.uniform(0.2, 0.9, 2)
        x, y = rng.uniform(bounds[0], bounds[2]), rng.uniform(bounds[1], bounds[3])
        if _distance_to_route(np.array([x, y]), route) > _CLEAR_M + 0.5 * math.hypot(dx, dy):
            found.append((float(x), float(y), float(dx), float(dy)))
    return found


def _distance_to_route(point: FloatArray, route: FloatArray) -> float:
    """Compute the distance from a point (2,) to a polyline (n, 2), m."""
    best = math.inf
    for a, b in pairwise(route):
        along = b - a
        share = np.clip((point - a) @ along / max(1e-12, along @ along), 0.0, 1.0)
        best = min(best, float(np.hypot(*(a + share * along - point))))
    return best


def room(rng: np.random.Generator) -> Course:
    """Make a room of 8 m x 8 m with obstacles; the route goes round it three times.

    Args:
        rng: Random generator for the obstacles.

    Returns:
        The course.
    """
    bounds = (-4.0, -4.0, 4.0, 4.0)
    ring = 2.4 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    route = np.vstack([ring, ring, ring, ring[:1]])
    return Course("room", (*_walls(*bounds), *_obstacles(rng, bounds, route, 8)), route, bounds)


def ice(rng: np.random.Generator) -> Course:
    """Make the course `room` with four slippery patches, one under each side of the route.

    Args:
        rng: Random generator for the obstacles.

    Returns:
        The course.
    """
    plain = room(rng)
    zones = tuple(
        FrictionZone((float(x) - 0.8, float(y) - 0.8), (float(x) + 0.8, float(y) + 0.8), 0.1)
        for x, y in ((2.4, 0.0), (-2.4, 0.5), (0.3, 2.4), (-0.5, -2.4))
    )
    return Course("ice", plain.boxes, plain.route_m, plain.bounds, zones)


def corridor(rng: np.random.Generator) -> Course:
    """Make a corridor of 30 m x 2 m with pillars every three metres, driven there and back.

    The laser's range is 12 m, so neither end is visible from the middle.

    Args:
        rng: Random generator for the pillars.

    Returns:
        The course.
    """
    bounds = (0.0, -1.0, 30.0, 1.0)
    route = np.array([[1.0, 0.0], [29.0, 0.0], [29.0, 0.1], [1.0, 0.1]])
    boxes = [*_walls(*bounds), *_pillars(rng, np.arange(3.0, 29.0, 3.0))]
    return Course("corridor", tuple(boxes), route, bounds)


def _pillars(rng: np.random.Generator, places: FloatArray) -> list[Box]:
    """Place pillars at the sides of a 2 m wide corridor along +x, near these positions, m."""
    sides = rng.choice([-1.0, 1.0], len(places))
    sizes = rng.uniform(0.15, 0.3, len(places))
    off = rng.uniform(-0.8, 0.8, len(places))
    return [
        (float(x + o), float(side * (1.0 - 0.5 * size)), 0.3, float(size))
        for x, o, side, size in zip(places, off, sides, sizes, strict=True)
    ]


def loop(rng: np.random.Generator) -> Course:
    """Make a ring of corridors, 60 m long and 2 m wide; the route goes round once and 6 m more.

    Args:
        rng: Random generator for the pillars.

    Returns:
        The course.
    """
    half = 7.5
    bounds = (-half - 1.0, -half - 1.0, half + 1.0, half + 1.0)
    inner = half - 1.0
    ring = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    route = np.vstack([[0.0, -half], ring[1:], ring[0], [6.0, -half]])
    boxes = [*_walls(*bounds), (0.0, 0.0, 2.0 * inner, 2.0 * inner)]
    # Quarter turns rotate the pillars of the lower corridor onto the four sides.
    for side in range(4):
        turn = 0.5 * math.pi * side
        for x, y, dx, dy in _pillars(rng, np.arange(-5.5, 6.0, 2.75)):
            cos, sin = round(math.cos(turn)), round(math.sin(turn))
            px, py = x, y - half
            size = (dx, dy) if side % 2 == 0 else (dy, dx)
            boxes.append((cos * px - sin * py, sin * px + cos * py, *size))
    return Course("loop", tuple(boxes), route, bounds)


def office(rng: np.random.Generator) -> Course:
    """Make an office of 20 m x 20 m: sixteen rooms with doors along a random tree, all visited.

    Args:
        rng: Random generator for the doors and the obstacles.

    Returns:
        The course.
    """
    count, size = 4, 5.0
    half = 0.5 * count * size
    bounds = (-half, -half, half, half)
    doors, room_sequence = _tree(rng, count)
    centre = {
        (i, j): np.array([(i + 0.5) * size - half, (j + 0.5) * size - half])
        for i in range(count)
        for j in range(count)
    }
    corners = [centre[room_sequence[0]]]
    for a, b in pairwise(room_sequence):
        corners += [doors[frozenset((a, b))] * size - half, centre[b]]
    route = np.array(corners)
    boxes = [*_walls(*bounds)]
    for i in range(count):
        for j in range(count):
            for other in ((i + 1, j), (i, j + 1)):
                if max(other) < count:
                    door = doors.get(frozenset(((i, j), other)))
                    boxes += _wall_between((i, j), other, door, size, half)
    boxes += _obstacles(rng, bounds, route, 70, 1500)
    return Course("office", tuple(boxes), route, bounds)


_Room = tuple[int, int]


def _tree(
    rng: np.random.Generator, count: int
) -> tuple[dict[frozenset[_Room], FloatArray], list[_Room]]:
    """Draw a random spanning tree: its doors, in room sizes, and a sequence through all rooms."""
    doors: dict[frozenset[_Room], FloatArray] = {}
    start = (0, 0)
    visits, stack, seen = [start], [start], {start}  # depth-first search
    while stack:
        i, j = stack[-1]
        options = [
            (i + di, j + dj)
            for di, dj in ((1, 0), (0, 1), (-1, 0), (0, -1))
            if 0 <= i + di < count and 0 <= j + dj < count and (i + di, j + dj) not in seen
        ]
        if not options:  # back to the previous room
            stack.pop()
            if stack:
                visits.append(stack[-1])
            continue
        to = options[int(rng.integers(len(options)))]
        place = 0.5 * (np.array([i, j]) + np.array(to)) + 0.5
        place[1 if to[0] != i else 0] += rng.uniform(-0.2, 0.2)
        doors[frozenset(((i, j), to))] = place
        seen.add(to)
        visits.append(to)
        stack.append(to)
    return doors, visits


def _wall_between(
    a: _Room, b: _Room, door: FloatArray | None, size: float, half: float
) -> list[Box]:
    """Make the wall between two rooms, with a gap at the door if there is one."""
    across = 0 if a[0] != b[0] else 1
    along = 1 - across
    at = b[across] * size - half
    low, high = a[along] * size - half, (a[along] + 1) * size - half
    pieces = [(low, high)]
    if door is not None:
        middle = door[along] * size - half
        pieces = [(low, middle - 0.5 * _DOOR_M), (middle + 0.5 * _DOOR_M, high)]
    boxes = []
    for start, end in pieces:
        place, extent = 0.5 * (start + end), end - start
        boxes.append((at, place, _WALL_M, extent) if across == 0 else (place, at, extent, _WALL_M))
    return boxes


COURSES: dict[str, Callable[[np.random.Generator], Course]] = {
    "room": room,
    "ice": ice,
    "corridor": corridor,
    "loop": loop,
    "office": office,
}
