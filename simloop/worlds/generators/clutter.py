"""Rooms drawn from a seed: obstacles that block the straight way and leave a passable one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simloop.config import VehicleConfig
from simloop.messages import FloatArray
from simloop.worlds.floor_plan import (
    FloorPlan,
    Section,
    is_blocked,
    is_passable,
    rasterise,
    to_walls,
)
from simloop.worlds.obstacles import Obstacle, ShapeName

_SHAPES: tuple[ShapeName, ...] = ("box", "cylinder", "ellipse", "polygon", "ell")
_ROOMS = 200
_PLACES = 200
_FULL_ROOMS = 20
_RASTER_M = 0.025
_APART_M = 0.04
_TURNING_ROOM_M = 0.11
_SLACK_M = 0.04


def draw_clutter(
    rng: np.random.Generator,
    start: Sequence[float] | FloatArray,
    goal: Sequence[float] | FloatArray,
    bounds: Sequence[float] | FloatArray,
    count: int = 12,
    vehicle: VehicleConfig | None = None,
    d_safe: float = 0.26,
    standing: Sequence[Section] = (),
) -> list[Obstacle]:
    """Obstacles of different shapes, as large as discs of radius 0.10-0.25 m.

    start, goal: (2,) or (3,), m, in map; bounds: (4,) x_min, y_min, x_max, y_max, m; standing:
    what stands there already and is kept clear of. Drawn again
    until the straight line from start to goal is blocked and a disc 4 cm wider in radius than
    the robot's safety distance can still pass; start and goal keep room for the robot to turn.
    Raises ValueError where that cannot be, or was not found in 200 rooms.
    """
    vehicle = vehicle if vehicle is not None else VehicleConfig()
    ends = np.array([start[:2], goal[:2]], dtype=np.float64)
    walls = np.array(bounds, dtype=np.float64)
    passage_m = max(d_safe, vehicle.footprint_radius_m) + _SLACK_M
    turning_m = math.hypot(0.5 * vehicle.length_m, 0.5 * vehicle.width_m) + _TURNING_ROOM_M
    if np.any(to_walls(ends, walls) < passage_m):
        raise ValueError(f"start and goal must be at least {passage_m:.2f} m inside the walls")
    if math.dist(*ends) < 2.0 * turning_m:
        raise ValueError("start and goal are so near that nothing drawn could stand between them")
    there, full = rasterise(standing, walls, _RASTER_M), 0
    for _ in range(_ROOMS):
        room = _draw_room(rng, ends, walls, count, turning_m, there)
        if room is None:
            full += 1
            if full == _FULL_ROOMS:
                raise ValueError(f"found no place for {count} obstacles: ask for fewer")
            continue
        sections = [s for item in room for s in item.sections()]
        plan = rasterise([*standing, *sections], walls, _RASTER_M)
        if is_blocked(plan, ends[0], ends[1]) and is_passable(plan, ends[0], ends[1], passage_m):
            return room
    raise ValueError(
        f"found no room with {count} obstacles, a blocked line and a passage {passage_m:.2f} m "
        f"either side in {_ROOMS} trials: ask for fewer obstacles or a larger room"
    )


def out_of_plane(
    rng: np.random.Generator, obstacles: Sequence[Obstacle], share: float
) -> list[Obstacle]:
    """The obstacles, about a share of them such as the LiDAR's plane misses.

    In equal parts lower than it, hung up below it, and hung up above it, where the mast alone hits.
    """
    changed = []
    for item in obstacles:
        drawn, kind = rng.random(), rng.integers(3)
        foot, top = rng.uniform((0.05, 0.15), (0.12, 0.18)).tolist()
        bottom = (0.0, foot, 0.21)[kind]
        height = 0.3 if kind == 2 else top - bottom
        hung = replace(item, bottom_m=bottom, height_m=height)
        changed.append(hung if drawn < share else item)
    return changed


def _draw_room(
    rng: np.random.Generator,
    ends: FloatArray,
    walls: FloatArray,
    count: int,
    turning_m: float,
    there: FloorPlan,
) -> list[Obstacle] | None:
    room: list[Obstacle] = []
    for _ in range(_PLACES):
        if len(room) == count:
            return room
        item = draw_obstacle(rng, rng.uniform(walls[:2], walls[2:]))
        alone = rasterise(item.sections(), walls, resolution_m=float(np.max(walls[2:] - walls[:2])))
        if np.any(alone.clearance_m(ends) < turning_m) or np.any(
            to_walls(_outline(item), walls) < _APART_M
        ):
            continue
        if there.sections and np.any(there.clearance_m(_outline(item)) < _APART_M):
            continue
        if all(_apart(alone, other) for other in room):
            room.append(item)
    return room if len(room) == count else None


def _apart(alone: FloorPlan, other: Obstacle) -> bool:
    """Whether another obstacle's outline keeps its distance (neither can swallow the other)."""
    return bool(np.all(alone.clearance_m(_outline(other)) > _APART_M))


def _outline(item: Obstacle) -> FloatArray:
    """(N, 2) points round an obstacle, no more than about 2 cm apart."""
    pieces = []
    for section in item.sections():
        following = np.roll(section.vertices_m, -1, axis=0)
        share = np.linspace(0.0, 1.0, 32, endpoint=False)[:, None, None]
        edges = (section.vertices_m + share * (following - section.vertices_m)).reshape(-1, 2)
        if section.radius_m > 0.0:
            angle = 2.0 * math.pi * np.arange(64) / 64
            ring = section.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            edges = (section.vertices_m[:, None] + ring).reshape(-1, 2)
        pieces.append(edges)
    return np.concatenate(pieces)


def draw_obstacle(rng: np.random.Generator, position: FloatArray) -> Obstacle:
    """One obstacle of a drawn shape, as large as a disc of radius 0.10-0.25 m."""
    shape = _SHAPES[rng.integers(len(_SHAPES))]
    radius = rng.uniform(0.10, 0.25)
    yaw = float(rng.uniform(-math.pi, math.pi))
    height = float(rng.uniform(0.28, 0.45))
    aspect = rng.uniform(1.0, 2.0)
    where = (float(position[0]), float(position[1]))
    if shape == "polygon":
        corners = int(rng.integers(3, 7))
        angle = 2.0 * math.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
        # Corners on an ellipse go round a convex polygon, whatever their angles.
        swell = radius * math.sqrt(2.0 * math.pi / corners / math.sin(2.0 * math.pi / corners))
        axes = np.array([math.sqrt(aspect), 1.0 / math.sqrt(aspect)]) * swell
        ring = axes * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        vertices = tuple((float(x), float(y)) for x, y in ring)
        return Obstacle("polygon", where, (), yaw, height, vertices)
    if shape == "cylinder":
        size: tuple[float, ...] = (2.0 * radius,)
    elif shape == "ell":
        thickness = 0.55 * radius + 0.03
        size = (2.4 * radius, 2.4 * radius / math.sqrt(aspect), thickness)
    else:
        area = radius**2 * (math.pi if shape == "box" else 4.0)
        size = (math.sqrt(area * aspect), math.sqrt(area / aspect))
    return Obstacle(shape, where, tuple(float(s) for s in size), yaw, height)
