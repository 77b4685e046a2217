"""Draw random obstacles that block the straight line and leave a passable way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simloop.messages import FloatArray
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import (
    FloorPlan,
    Section,
    distance_to_bounds,
    is_blocked,
    is_passable,
    rasterise,
)
from simloop.worlds.obstacles import Obstacle, ShapeName

_SHAPES: tuple[ShapeName, ...] = ("box", "cylinder", "ellipse", "polygon", "ell")
_ROOMS = 200  # trials of a whole room
_PLACES = 200  # trials of a single obstacle in a room
_FULL_ROOMS = 20  # the search stops after this many rooms without a place for all obstacles
_RASTER_M = 0.025
_APART_M = 0.04  # least distance between two obstacles, and from an obstacle to a wall
_TURNING_ROOM_M = 0.11  # room at start and goal in addition to the turning radius
_SLACK_M = 0.04  # room beside the path in addition to the safe distance
# Heights as shares of the LiDAR's height: with the LiDAR at 0.2 m, feet are at 0.05 to 0.12 m.
_FOOT = (0.25, 0.6)  # lower edge of an obstacle that hangs below the LiDAR's plane
_TOP = (0.75, 0.9)  # upper edge of an obstacle that stands or hangs below the plane
_SHELF = 1.05  # lower edge of an obstacle that hangs above the plane, below the top of the mast
_SHELF_HEIGHT_M = 0.3


def draw_clutter(
    rng: np.random.Generator,
    start: Sequence[float] | FloatArray,
    goal: Sequence[float] | FloatArray,
    bounds: Sequence[float] | FloatArray,
    body: Body,
    count: int = 12,
    clearance_m: float = 0.26,
    standing: Sequence[Section] = (),
) -> list[Obstacle]:
    """Draw obstacles of different shapes, each as large as a disc of radius 0.10 to 0.25 m.

    Rooms are drawn until two conditions hold. The straight line from start to goal is blocked, and
    a disc with a radius 4 cm larger than the safe distance can pass. At start and goal the robot
    has room to turn.

    Args:
        rng: random generator of all draws.
        start: (2,) or (3,) x, y, ... of the robot in map, m.
        goal: (2,) or (3,) x, y, ... in map, m.
        bounds: (4,) x_min, y_min, x_max, y_max of the room in map, m.
        body: the robot's true outline.
        count: number of obstacles.
        clearance_m: half width of the way from start to goal that stays free, m.
        standing: obstacles that are already there; new ones keep a distance from them.

    Returns:
        The obstacles.

    Raises:
        ValueError: start or goal have too little room, or 200 trials found no room.
    """
    ends = np.array([start[:2], goal[:2]], dtype=np.float64)
    walls = np.array(bounds, dtype=np.float64)
    passage_m = max(clearance_m, body.footprint_radius_m) + _SLACK_M
    turning_m = body.turning_radius_m + _TURNING_ROOM_M
    if np.any(distance_to_bounds(ends, walls) < passage_m):
        raise ValueError(f"start and goal must be at least {passage_m:.2f} m inside the walls")
    if math.dist(*ends) < 2.0 * turning_m:
        raise ValueError("start and goal are so near that no obstacle can stand between them")
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


def hide_from_lidar(
    rng: np.random.Generator, obstacles: Sequence[Obstacle], share: float, lidar_height_m: float
) -> list[Obstacle]:
    """Move some obstacles out of the LiDAR's plane to heights where the robot still touches them.

    There are three kinds, equally often: lower than the plane, hanging below it, and hanging above
    it. Only the mast can touch the last kind.

    Args:
        rng: random generator of all draws; each obstacle uses the same number of them.
        obstacles: the obstacles to choose from.
        share: mean share of the obstacles that is moved, 0 to 1.
        lidar_height_m: height of the plane, m.

    Returns:
        All obstacles in their order, changed or not.
    """
    # Rounded to the micrometre, so that a height of 0.21 m is exactly the number 0.21.
    foot_low, foot_high, top_low, top_high, shelf = (
        round(factor * lidar_height_m, 6) for factor in (*_FOOT, *_TOP, _SHELF)
    )
    changed = []
    for item in obstacles:
        drawn, kind = rng.random(), rng.integers(3)
        foot, top = rng.uniform((foot_low, top_low), (foot_high, top_high)).tolist()
        bottom = (0.0, foot, shelf)[kind]
        height = _SHELF_HEIGHT_M if kind == 2 else top - bottom
        hidden = replace(item, bottom_m=bottom, height_m=height)
        changed.append(hidden if drawn < share else item)
    return changed


def _draw_room(
    rng: np.random.Generator,
    ends: FloatArray,
    walls: FloatArray,
    count: int,
    turning_m: float,
    there: FloorPlan,
) -> list[Obstacle] | None:
    """Draw ``count`` obstacles that keep a distance; None if not all found a place."""
    room: list[Obstacle] = []
    for _ in range(_PLACES):
        if len(room) == count:
            return room
        item = draw_obstacle(rng, rng.uniform(walls[:2], walls[2:]))
        # Only exact distances are used, so a raster of one cell is enough.
        alone = rasterise(item.sections(), walls, resolution_m=float(np.max(walls[2:] - walls[:2])))
        if np.any(alone.clearance_m(ends) < turning_m) or np.any(
            distance_to_bounds(_outline(item), walls) < _APART_M
        ):
            continue
        if there.sections and np.any(there.clearance_m(_outline(item)) < _APART_M):
            continue
        if all(_apart(alone, other) for other in room):
            room.append(item)
    return room if len(room) == count else None


def _apart(alone: FloorPlan, other: Obstacle) -> bool:
    """Tell whether another obstacle keeps its distance. Neither can contain the other."""
    return bool(np.all(alone.clearance_m(_outline(other)) > _APART_M))


def _outline(item: Obstacle) -> FloatArray:
    """Compute points (N, 2) around an obstacle, at most about 2 cm apart."""
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
    """Draw one obstacle of a random shape, as large as a disc of radius 0.10 to 0.25 m.

    Args:
        rng: random generator of all draws.
        position: (2,) x, y of its centre in map, m.

    Returns:
        The obstacle, standing on the floor.
    """
    shape = _SHAPES[rng.integers(len(_SHAPES))]
    radius = rng.uniform(0.10, 0.25)
    yaw = float(rng.uniform(-math.pi, math.pi))
    height = float(rng.uniform(0.28, 0.45))
    aspect = rng.uniform(1.0, 2.0)
    where = (float(position[0]), float(position[1]))
    if shape == "polygon":
        corners = int(rng.integers(3, 7))
        angle = 2.0 * math.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
        # Corners on an ellipse make a convex polygon for any angles.
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
