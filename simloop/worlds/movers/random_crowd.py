"""Draw a random crowd: the start, the speed and the motion of each mover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from simloop.messages import FloatArray
from simloop.worlds.floor_plan import FloorPlan, distance_to_bounds
from simloop.worlds.movers.settings import Crowd, Mover

_TRIALS = 500
_APART_M = 0.1  # least distance of a mover from obstacles, and from other movers at the start
_CORNERS = 4  # number of corners of a closed path


def draw_crowd(
    crowd: Crowd, floor: FloorPlan, start: Sequence[float], rng: np.random.Generator
) -> tuple[Mover, ...]:
    """Draw movers that touch nothing at first and keep a distance from the robot's start.

    Args:
        crowd: number and motions of the movers.
        floor: the floor plan.
        start: (2,) or (3,) x, y, ... of the robot in map, m.
        rng: random generator of all draws.

    Returns:
        The movers. They have the crowd's motions in turn.

    Raises:
        ValueError: there is not enough room for all movers.
    """
    drawn: list[Mover] = []
    for number in range(crowd.count):
        radius = 0.5 * float(rng.uniform(*crowd.diameter_m))
        place = _place(crowd, floor, start, drawn, radius, rng)
        speed, heading = float(rng.uniform(*crowd.speed_mps)), float(rng.uniform(-math.pi, math.pi))
        motion = crowd.motions[number % len(crowd.motions)]
        keys = _round_trip(floor, place, radius, speed, rng) if motion == "path" else ()
        drawn.append(
            Mover(
                motion=motion,
                position_m=None if keys else (float(place[0]), float(place[1])),
                keys_txy=keys,
                speed_mps=speed,
                heading_rad=heading,
                diameter_m=2.0 * radius,
                height_m=crowd.height_m,
            )
        )
    return tuple(drawn)


def _place(
    crowd: Crowd,
    floor: FloorPlan,
    start: Sequence[float],
    drawn: Sequence[Mover],
    radius: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw a free place (2,) for the next mover."""
    for _ in range(_TRIALS):
        place = rng.uniform(floor.bounds_m[:2], floor.bounds_m[2:])
        if (
            _room(floor, place) > radius + _APART_M
            and math.dist(place, start[:2]) > radius + crowd.apart_m
            and all(
                math.dist(place, other.start_m) > radius + 0.5 * other.diameter_m + _APART_M
                for other in drawn
            )
        ):
            return place
    raise ValueError(f"crowd: found no place for {crowd.count} movers: ask for fewer")


def _round_trip(
    floor: FloorPlan, place: FloatArray, radius: float, speed: float, rng: np.random.Generator
) -> tuple[tuple[float, float, float], ...]:
    """Draw keys (t, x, y) of a closed path over a few corners, clear of obstacles."""
    corners = [place]
    for _ in range(_TRIALS):
        if len(corners) == _CORNERS:
            break
        corner = rng.uniform(floor.bounds_m[:2], floor.bounds_m[2:])
        if _clear(floor, corners[-1], corner, radius) and _clear(floor, corner, place, radius):
            corners.append(corner)
    corners += [place]
    keys, t = [(0.0, float(place[0]), float(place[1]))], 0.0
    for a, b in pairwise(corners):
        t += max(math.dist(a, b) / max(speed, 0.01), 0.01)
        keys.append((t, float(b[0]), float(b[1])))
    return tuple(keys)


def _clear(floor: FloorPlan, a: FloatArray, b: FloatArray, radius: float) -> bool:
    """Tell whether a mover can go straight from a (2,) to b (2,)."""
    share = np.linspace(0.0, 1.0, 2 + int(math.dist(a, b) / 0.05))[:, None]
    return _room(floor, a + share * (b - a)) > radius + _APART_M


def _room(floor: FloorPlan, places: FloatArray) -> float:
    """Compute the least distance, m, of places (..., 2) to obstacles or to the floor's bounds."""
    sides = distance_to_bounds(places, floor.bounds_m).min()
    return float(min(floor.clearance_m(places).min(), sides))
