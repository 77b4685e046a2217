"""A scenario's settings of moving things: ``[[movers]]``, ``[crowd]`` and ``[goal_motion]``."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, Coordinate, Point

Motion = Literal["path", "constant", "walk", "pedestrian"]
Diameter = Annotated[float, Field(ge=0.05, le=5.0)]
Height = Annotated[float, Field(ge=0.05, le=3.0)]
Pace = Annotated[float, Field(ge=0.0, le=5.0)]
Key = tuple[Annotated[float, Field(ge=0.0, le=1e6)], Coordinate, Coordinate]


def check_keys(keys: tuple[Key, ...]) -> None:
    """Check the keys of a path.

    Args:
        keys: (t, x, y) each, s, m, m.

    Raises:
        ValueError: there are fewer than two, they are not in order of time, or the first is not
            at t = 0.
    """
    if len(keys) < 2 or keys[0][0] != 0.0:
        raise ValueError("keys_txy: give two keys (t, x, y) or more, the first at t = 0")
    if any(b[0] <= a[0] for a, b in pairwise(keys)):
        raise ValueError("keys_txy: each key must be later than the one before")


@dataclass(frozen=True, slots=True, config=STRICT)
class Mover:
    """An upright cylinder that moves by itself. Physics does not stop it.

    Attributes:
        motion: ``path``: along keys, through any obstacle; after it touches the robot it goes back
            and waits. ``constant``: straight; it bounces off everything it touches. ``walk``: the
            same, with a random walk of the heading. ``pedestrian``: to random places; a social
            force keeps it clear of walls, movers and robot.
        position_m: initial x, y in map, m; not for a path.
        keys_txy: (t, x, y) of a path, s, m, m; straight between keys, repeated.
        speed_mps: speed, m/s; the greatest speed of a pedestrian; not for a path.
        heading_rad: initial heading of ``constant`` and ``walk``, rad.
        turn_rad: standard deviation of a walk's heading after one second, rad.
        pushes: whether a mover on a path continues after it has touched the robot.
        diameter_m: diameter, m.
        height_m: height, m.
    """

    motion: Motion
    position_m: Point | None = None
    keys_txy: tuple[Key, ...] = ()
    speed_mps: Pace = 0.5
    heading_rad: float = 0.0
    turn_rad: Annotated[float, Field(ge=0.0, le=10.0)] = 0.8
    pushes: bool = False
    diameter_m: Diameter = 0.4
    height_m: Height = 1.0

    @model_validator(mode="after")
    def _has_a_place(self) -> Mover:
        on_path, has_place = self.motion == "path", self.position_m is not None
        if on_path != bool(self.keys_txy) or on_path == has_place:
            raise ValueError("a path needs keys_txy; any other motion needs position_m")
        if self.keys_txy:
            check_keys(self.keys_txy)
        return self

    @property
    def start_m(self) -> Point:
        """Initial x, y in map, m."""
        return self.position_m or self.keys_txy[0][1:]


@dataclass(frozen=True, slots=True, config=STRICT)
class Crowd:
    """Movers that are drawn from the scenario's seed.

    Attributes:
        count: number of movers.
        motions: the kinds of motion, in turn.
        speed_mps: least and greatest speed, m/s.
        diameter_m: least and greatest diameter, m.
        height_m: height of all movers, m.
        apart_m: least initial distance from the robot's start, m.
    """

    count: Annotated[int, Field(ge=1, le=200)] = 12
    motions: Annotated[tuple[Motion, ...], Field(min_length=1)] = (
        "pedestrian",
        "walk",
        "constant",
        "path",
    )
    speed_mps: tuple[Pace, Pace] = (0.2, 0.5)
    diameter_m: tuple[Diameter, Diameter] = (0.3, 0.5)
    height_m: Height = 1.0
    apart_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.5

    @model_validator(mode="after")
    def _ranges_open(self) -> Crowd:
        for key in ("speed_mps", "diameter_m"):
            low, high = getattr(self, key)
            if low > high:
                raise ValueError(f"{key}: give the least first, then the greatest")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class GoalMotion:
    """A goal that moves like a ``Mover``. The robot gets readings of its place.

    Attributes:
        motion: path, constant or walk.
        speed_mps: speed, m/s; not for a path.
        heading_rad: initial heading, rad.
        turn_rad: standard deviation of a walk's heading after one second, rad.
        keys_txy: (t, x, y) of a path, s, m, m; the first is at the scenario's goal.
        room_m: distance that the goal keeps from all obstacles, m.
        period_s: time between two readings, s.
        noise_m: standard deviation of a reading on each axis, m.
    """

    motion: Literal["path", "constant", "walk"] = "walk"
    speed_mps: Pace = 0.2
    heading_rad: float = 0.0
    turn_rad: Annotated[float, Field(ge=0.0, le=10.0)] = 0.5
    keys_txy: tuple[Key, ...] = ()
    room_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.4
    period_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.1
    noise_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01

    @model_validator(mode="after")
    def _has_keys(self) -> GoalMotion:
        if (self.motion == "path") != bool(self.keys_txy):
            raise ValueError("keys_txy: required for a path, not allowed for any other motion")
        if self.keys_txy:
            check_keys(self.keys_txy)
        return self
