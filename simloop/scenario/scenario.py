"""A scenario: start, goal, world, and every setting of one run.

A scenario file is TOML. The scenario's own keys are at the top. Then there is one table for each
section of ``Config`` whose defaults it changes. An error in it is reported in one line with the
file, the key and the choices.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.limits import LOOSE_BODIES, MOVERS, NAME_CHARACTERS, TEXT_CHARACTERS
from simloop.common.quantities import (
    STRICT,
    Coordinate,
    Fraction,
    Point,
    Positive,
    has_area,
    reject,
)
from simloop.config import Config
from simloop.physics.faults import Fault
from simloop.worlds.generators.generator import Generator
from simloop.worlds.movers.settings import Crowd, GoalMotion, Mover
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import MOST_ROUGH_STEP_S, Loose, Terrain

Count = Annotated[int, Field(ge=0, lt=2**63)]
Bounds = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
GAZEBO_FILES = (".world", ".sdf")
MAP_FILES = (".yaml", ".yml")
ARENA_FILES = (".xml", *MAP_FILES, *GAZEBO_FILES)


@dataclass(frozen=True, slots=True, config=STRICT)
class Clutter:
    """Obstacles that are drawn from the seed (see ``worlds.generators.clutter``).

    Attributes:
        count: number of obstacles.
        unseen: share of them that the LiDAR's plane misses, 0 to 1.
        clearance_m: half width of the way from start to goal that stays free, m.
    """

    count: Annotated[int, Field(ge=1, le=200)] = 12
    unseen: Fraction = 0.0
    clearance_m: Annotated[float, Field(gt=0.0, le=5.0)] = 0.26


@dataclass(frozen=True, slots=True, config=STRICT)
class Scenario:
    """A complete description of one run. Equal scenarios give equal runs.

    Attributes:
        name: name of the scenario; by default the file's name.
        start: (3,) x, y, yaw of base_link in map, m, m, rad.
        goal: (2,) x, y in map, m.
        arena: a name, or a file relative to the scenario's: MJCF (``.xml``), a map_server map
            (``.yaml``, ``.yml``), or a Gazebo world (``.world``, ``.sdf``).
        title: a few words for lists and pictures.
        description: one or two sentences.
        seed: seed of every random draw.
        time_limit_s: simulated time after which the run ends, s.
        goal_tolerance_m: largest distance from the goal that counts as reached, m.
        obstacles: obstacles in addition to the arena's own.
        clutter: further obstacles, drawn from the seed.
        generator: a whole world, drawn from the seed, instead of an arena.
        bounds_m: x_min, y_min, x_max, y_max of the arena ``field``, of an MJCF file, or of a
            Gazebo world, m.
        model_path: folders of models that a Gazebo world includes, relative to the scenario's.
        may_be_closed_off: whether a goal that cannot be reached is accepted.
        terrain: ground that is not flat.
        loose: movable bodies.
        movers: things that move by themselves.
        crowd: further movers, drawn from the seed.
        goal_motion: motion of the goal, if it moves.
        faults: faults during the run.
        config: every setting of robot, sensors and physics.
    """

    name: Annotated[str, Field(max_length=NAME_CHARACTERS)]
    start: tuple[Coordinate, Coordinate, Coordinate]
    goal: Point
    arena: str = "field"
    title: Annotated[str, Field(max_length=NAME_CHARACTERS)] = ""
    description: Annotated[str, Field(max_length=TEXT_CHARACTERS)] = ""
    seed: Count = 0
    time_limit_s: Positive = 60.0
    goal_tolerance_m: Positive = 0.10
    obstacles: tuple[Obstacle, ...] = ()
    clutter: Clutter | None = None
    generator: Generator | None = None
    bounds_m: Bounds | None = None
    model_path: tuple[str, ...] = ()
    may_be_closed_off: bool = False
    terrain: Terrain | None = None
    loose: Annotated[tuple[Loose, ...], Field(max_length=LOOSE_BODIES)] = ()
    movers: Annotated[tuple[Mover, ...], Field(max_length=MOVERS)] = ()
    crowd: Crowd | None = None
    goal_motion: GoalMotion | None = None
    faults: tuple[Fault, ...] = ()
    config: Config = Field(default_factory=Config)

    @property
    def drawn(self) -> bool:
        """Whether another seed gives another world."""
        return any(part is not None for part in (self.clutter, self.generator, self.crowd))

    @model_validator(mode="after")
    def _has_one_floor(self) -> Scenario:
        if self.generator is not None and self.arena != "field":
            raise reject("generator: draws its own world, so leave out arena")
        if self.model_path and not self.arena.endswith(GAZEBO_FILES):
            raise reject("model_path: only for a Gazebo world as the arena (.world, .sdf)")
        if self.bounds_m is not None:
            sized = self.arena == "field" or self.arena.endswith((".xml", *GAZEBO_FILES))
            if not sized or self.generator is not None:
                raise reject(
                    "bounds_m: only for the arena field, an MJCF file, or a Gazebo world; the "
                    "others have their own"
                )
            if not has_area(self.bounds_m[:2], self.bounds_m[2:]):
                raise reject("bounds_m: x_min, y_min must be below x_max, y_max")
        return self

    @model_validator(mode="after")
    def _goal_begins_in_place(self) -> Scenario:
        motion = self.goal_motion
        if motion is not None and motion.keys_txy and motion.keys_txy[0][1:] != self.goal:
            raise reject("goal_motion.keys_txy: the first key must be at the scenario's goal")
        return self

    @model_validator(mode="after")
    def _steps_finely_over_rough_ground(self) -> Scenario:
        rough = self.terrain is not None and self.terrain.height_field is not None
        if rough and self.config.rates.physics_s > MOST_ROUGH_STEP_S:
            raise reject(f"rates.physics_s must be {MOST_ROUGH_STEP_S} s or less on a height field")
        return self
