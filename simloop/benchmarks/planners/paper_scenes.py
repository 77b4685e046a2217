"""The papers' own scenes, rebuilt from the stated facts, because no paper prints its obstacles.

One length unit of a paper is one metre here, except for Sabiha's centimetres. Where a paper prints
the length of its best path, the obstacles are chosen so that the shortest path is about as long.

- sabiha4: Sabiha 2022, four obstacles, d_safe 30 cm: S1.
- strip20x60: Mohamed 2012, third map: five obstacles, (0, 0) to (60, 0), shortest 61.64.
- abed50: Mohamed 2012, first map: fifty obstacles, (5, 5) to (26, 25), shortest 30.462.
- abed150: Mohamed 2012, second map: 150 obstacles, (10, 20) to (80, 80), shortest 93.367.
- abed5: five large obstacles between the first map's ends (the strip is the paper's own five).
- wu180: Wu 2016, circles and convex polygons, (20, 20) to (147, 147), best 186.988.
- narrow, local_minimum, trap, maze: Abed 2022, maps 2-5: (0, 0) to (45, 45), maze to (30, 20).
- moving_obstacles (two), moving_goal: Abed 2022, Figures 11 and 12; for the online simulator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simloop.benchmarks.planners.scenes import Instance, disc_world, scene
from simloop.messages import FloatArray, WorldView
from simloop.planners.reactive.online import Mover, MovingPoint, OnlineWorld

PAPER_SCENES = (
    "sabiha4",
    "abed5",
    "abed50",
    "abed150",
    "strip20x60",
    "wu180",
    "narrow",
    "local_minimum",
    "trap",
    "maze",
)
ONLINE_SCENES = ("narrow", "local_minimum", "trap", "maze", "moving_obstacles", "moving_goal")

_SAFE_M = 0.3
# Discs x, y, radius, m.
_STRIP = (
    (9.0, 1.0, 3.2),
    (20.5, -1.6, 3.5),
    (31.0, 1.4, 3.7),
    (42.0, -1.0, 3.5),
    (52.0, 1.6, 3.2),
)
_FIVE = (
    (10.5, 9.0, 2.5),
    (15.5, 17.0, 3.0),
    (18.0, 11.5, 2.0),
    (22.5, 21.0, 2.0),
    (9.0, 15.5, 1.8),
)
_WU_DISCS = ((48.0, 45.0, 12.0), (88.0, 104.0, 13.0), (122.0, 118.0, 10.0), (60.0, 130.0, 14.0))
_WU_POLYGONS = (
    ((66.0, 60.0), (88.0, 56.0), (92.0, 76.0), (74.0, 84.0)),
    ((100.0, 60.0), (126.0, 48.0), (132.0, 74.0)),
    ((24.0, 74.0), (44.0, 72.0), (48.0, 92.0), (34.0, 100.0), (22.0, 90.0)),
    ((104.0, 136.0), (128.0, 138.0), (120.0, 160.0), (102.0, 156.0)),
    ((146.0, 96.0), (164.0, 92.0), (166.0, 116.0), (150.0, 120.0)),
)
_WU_SAFE_M = 2.0
_ABED_SAFE_M, _ABED_RADIUS_M = 0.6, 0.5
_ABED_BOUNDS = (-2.0, -2.0, 47.0, 47.0)
# Boxes x_min, y_min, x_max, y_max, m.
_NARROW = (
    (8.0, -3.0, 10.0, 19.0),
    (8.0, 21.5, 10.0, 48.0),
    (20.0, -3.0, 22.0, 9.0),
    (20.0, 11.5, 22.0, 48.0),
    (32.0, -3.0, 34.0, 30.0),
    (32.0, 32.5, 34.0, 48.0),
)
_LOCAL_MINIMUM = (
    (24.0, 12.0, 26.0, 28.0),
    (12.0, 26.0, 26.0, 28.0),
    (34.0, 34.0, 38.0, 38.0),
    (6.0, 34.0, 10.0, 40.0),
    (36.0, 6.0, 40.0, 14.0),
)
_TRAP = (
    (28.0, 10.0, 30.0, 30.0),
    (10.0, 28.0, 30.0, 30.0),
    (10.0, 18.0, 12.0, 30.0),
    (18.0, 10.0, 30.0, 12.0),
    (36.0, 30.0, 38.0, 40.0),
    (30.0, 38.0, 34.0, 40.0),
)
_MAZE = (
    (4.0, -3.0, 5.0, 15.0),
    (9.0, 4.0, 10.0, 23.0),
    (14.0, -3.0, 15.0, 10.0),
    (14.0, 14.0, 15.0, 23.0),
    (19.0, 3.0, 20.0, 17.0),
    (19.0, 16.0, 26.0, 17.0),
    (24.0, -3.0, 25.0, 11.0),
)
# Name: obstacles, side of the square, radii, start, goal, first seed.
_MOHAMED = {
    "abed50": (50, 32.0, (0.5, 1.5), (5.0, 5.0), (26.0, 25.0), 3034),
    "abed150": (150, 100.0, (1.0, 3.0), (10.0, 20.0), (80.0, 80.0), 4029),
}


def paper_scene(name: str, seed: int = 0) -> Instance:
    """Build a fixed scene.

    Args:
        name: One of `PAPER_SCENES`.
        seed: Seed of the maps with 50 and 150 obstacles, which are drawn; 0 gives the scene on
            which the papers' tables are measured.

    Returns:
        The task.

    Raises:
        ValueError: The name is unknown.
    """
    if name == "sabiha4":
        one = scene("S1")[0]
        return Instance(name, one.world, one.start, one.goal, one.safe_m, one.boxes_m)
    if name == "strip20x60":
        world = disc_world(np.array(_STRIP), (0.0, -10.0, 60.0, 10.0))
        return _instance(name, world, (0.0, 0.0), (60.0, 0.0), _SAFE_M)
    if name == "abed5":
        world = disc_world(np.array(_FIVE), (0.0, 0.0, 32.0, 32.0))
        return _instance(name, world, (5.0, 5.0), (26.0, 25.0), _SAFE_M)
    if name in _MOHAMED:
        return _mohamed(name, seed)
    if name == "wu180":
        world = _polygon_world(_WU_POLYGONS, _WU_DISCS, (0.0, 0.0, 180.0, 180.0))
        return _instance(name, world, (20.0, 20.0), (147.0, 147.0), _WU_SAFE_M)
    if name in ("narrow", "local_minimum", "trap"):
        boxes = {"narrow": _NARROW, "local_minimum": _LOCAL_MINIMUM, "trap": _TRAP}[name]
        return _walls(name, boxes, _ABED_BOUNDS, (45.0, 45.0))
    if name == "maze":
        return _walls(name, _MAZE, (-2.0, -2.0, 32.0, 22.0), (30.0, 20.0))
    raise ValueError(f"unknown scene {name!r}; choose from {', '.join(PAPER_SCENES)}")


def online_scene(name: str) -> OnlineWorld:
    """Build a scene for the online simulator.

    Args:
        name: One of `ONLINE_SCENES`.

    Returns:
        A world for `simloop.planners.reactive.online.simulate`.

    Raises:
        ValueError: The name is unknown.
    """
    if name == "moving_obstacles":
        fixed = disc_world(np.array([[12.0, 8.0, 2.0], [30.0, 34.0, 2.5]]), _ABED_BOUNDS)
        one = _instance(name, fixed, (0.0, 0.0), (45.0, 45.0), _ABED_SAFE_M)
        movers = (
            Mover(MovingPoint(np.array([[10.0, 24.0], [28.0, 12.0]]), 0.3), 1.5),
            Mover(MovingPoint(np.array([[38.0, 26.0], [24.0, 40.0]]), 0.5), 1.5),
        )
        return _online(one, MovingPoint(one.goal), movers)
    if name == "moving_goal":
        fixed = disc_world(np.array([[15.0, 15.0, 3.0], [30.0, 22.0, 3.0]]), _ABED_BOUNDS)
        one = _instance(name, fixed, (0.0, 0.0), (40.0, 20.0), _ABED_SAFE_M)
        return _online(one, MovingPoint(np.array([[40.0, 20.0], [40.0, 44.0], [20.0, 44.0]]), 0.25))
    if name in ONLINE_SCENES:
        one = paper_scene(name)
        return _online(one, MovingPoint(one.goal))
    raise ValueError(f"unknown scene {name!r}; choose from {', '.join(ONLINE_SCENES)}")


def _instance(
    name: str,
    world: WorldView,
    start: tuple[float, float],
    goal: tuple[float, float],
    safe_m: float,
    boxes: FloatArray | None = None,
) -> Instance:
    """Make a task from positions (x, y); the start's yaw is 0."""
    known = np.zeros((0, 4)) if boxes is None else boxes
    return Instance(name, world, np.array([*start, 0.0]), np.array(goal), safe_m, known)


def _mohamed(name: str, seed: int) -> Instance:
    """Make a task among uniformly drawn discs that keep twice the safe distance from both ends."""
    count, side, radii, start, goal, first = _MOHAMED[name]
    rng = np.random.default_rng(first + seed)
    discs: list[tuple[float, float, float]] = []
    while len(discs) < count:
        x, y = rng.uniform(0.0, side, 2)
        r = rng.uniform(*radii)
        if min(np.hypot(x - end[0], y - end[1]) for end in (start, goal)) >= r + 2.0 * _SAFE_M:
            discs.append((x, y, r))
    world = disc_world(np.array(discs), (0.0, 0.0, side, side))
    return _instance(name, world, start, goal, _SAFE_M)


def _polygon_world(
    polygons: tuple[tuple[tuple[float, float], ...], ...],
    discs: tuple[tuple[float, float, float], ...],
    bounds: tuple[float, float, float, float],
) -> WorldView:
    """Make a view of convex polygons, corners counter-clockwise, and discs."""
    corners = tuple(np.array(polygon, dtype=np.float64) for polygon in polygons)
    return replace(disc_world(np.array(discs), bounds), polygons_m=corners)


def _walls(
    name: str,
    boxes: tuple[tuple[float, float, float, float], ...],
    bounds: tuple[float, float, float, float],
    goal: tuple[float, float],
) -> Instance:
    """Make a task among boxes, from the origin to a goal."""
    corners = tuple(((a, b), (c, b), (c, d), (a, d)) for a, b, c, d in boxes)
    world = _polygon_world(corners, (), bounds)
    return _instance(name, world, (0.0, 0.0), goal, _ABED_SAFE_M, np.array(boxes))


def _online(one: Instance, goal: MovingPoint, movers: tuple[Mover, ...] = ()) -> OnlineWorld:
    """Make the world of a task for the online simulator."""
    return OnlineWorld(
        name=one.name,
        fixed=one.world,
        start=one.start,
        goal=goal,
        movers=movers,
        radius_m=_ABED_RADIUS_M,
        safe_m=one.safe_m,
    )
