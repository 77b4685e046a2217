"""What a scenario says of things that move: ``[[movers]]``, ``[crowd]`` and ``[goal_motion]``."""

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
    """Raise ValueError unless there are two keys or more, from t = 0 on, in order of time."""
    if len(keys) < 2 or keys[0][0] != 0.0:
        raise ValueError("keys_txy: two keys (t, x, y) or more, the first at t = 0")
    if any(b[0] <= a[0] for a, b in pairwise(keys)):
        raise ValueError("keys_txy: each key must be later than the one before")


@dataclass(frozen=True, slots=True, config=STRICT)
class Mover:
    """An upright cylinder that goes its own way, and is stopped by nothing but what is said here.

    path: along keys_txy (t s, x m, y m), straight between them, over and over, through whatever is
    there; having touched the robot it steps back and waits, or, if it ``pushes``, goes on.
    constant: straight on at speed_mps towards heading_rad, thrown back by all that it touches.
    walk: the same, its heading a random walk of turn_rad a square root of a
    second. pedestrian: to places drawn at random, at speed_mps or less, keeping clear of walls,
    of one another and of the robot (the social force of Helbing & Molnar 1995).
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
            raise ValueError("a path has keys_txy, all else a position_m")
        if self.keys_txy:
            check_keys(self.keys_txy)
        return self

    @property
    def start_m(self) -> Point:
        """Where it is at the beginning."""
        return self.position_m or self.keys_txy[0][1:]


@dataclass(frozen=True, slots=True, config=STRICT)
class Crowd:
    """Movers drawn from the scenario's seed, ``count`` of them, of each of ``motions`` in turn.

    speed_mps, diameter_m: least and greatest. apart_m: from the robot's start, at first.
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
                raise ValueError(f"{key}: the least first, then the greatest")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class GoalMotion:
    """A goal that moves, as a ``Mover`` does, and keeps ``room_m`` from all that stands.

    The robot is told where it is every ``period_s``, with an error of ``noise_m`` (one standard
    deviation an axis). On a path keys_txy[0] is the scenario's goal.
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
            raise ValueError("a path has keys_txy, and nothing else has them")
        if self.keys_txy:
            check_keys(self.keys_txy)
        return self
