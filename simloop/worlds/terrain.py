"""A scenario's settings of uneven ground and of loose bodies.

They are independent of the physics engine. ``mjcf_ground`` adds them to a world.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, Length, Point, has_area
from simloop.config.simulation import Friction

MOST_ROUGH_STEP_S = 0.002
"""The longest physics step over a height field. With a longer step, a hull that falls on the field
penetrates so deeply in one step that the contact throws it out with more energy than it had."""
_MOST_CORRELATED = 100
"""The most cells over which heights may be correlated. Finer grids take minutes and look alike."""
Height = Annotated[float, Field(gt=0.0, le=1.0)]
Run = Annotated[float, Field(ge=0.0, le=100.0)]


@dataclass(frozen=True, slots=True, config=STRICT)
class Ramp:
    """A ramp up, a level top and a ramp down, along x from the foot.

    Attributes:
        position_m: x, y of the middle of the foot in map, m.
        height_m: height of the top, m.
        up_m: horizontal length of the ramp up, m.
        top_m: length of the top, m.
        down_m: horizontal length of the ramp down, m; 0 is a drop.
        width_m: width, m.
        yaw_rad: yaw about the middle of its foot, rad.
    """

    position_m: Point
    height_m: Height
    up_m: Annotated[float, Field(gt=0.0, le=100.0)]
    top_m: Run = 0.0
    down_m: Run = 0.0
    width_m: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True, config=STRICT)
class Step:
    """A level block on the floor. A narrow one is a sill.

    Attributes:
        position_m: x, y of its centre in map, m.
        size_m: overall length and width, m.
        height_m: height, m.
        yaw_rad: yaw, rad.
    """

    position_m: Point
    size_m: tuple[Length, Length]
    height_m: Height
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True, config=STRICT)
class HeightField:
    """Rough ground in a rectangle, from an image or drawn from a seed.

    Random ground is level with the floor at its rim.

    Attributes:
        min_m: least x, y in map, m.
        max_m: greatest x, y in map, m.
        image: a grey PNG: black is the floor, white is ``height_m``; its upper edge is at the
            greatest y.
        height_m: height of white above the floor, m.
        rms_m: standard deviation of random heights about their mean, m.
        correlation_m: distance at which the Gaussian correlation of random heights is 1/e, m.
        seed: seed of the random heights.
        cell_m: size of a cell of the grid, m.
    """

    min_m: Point
    max_m: Point
    image: str | None = None
    height_m: Height | None = None
    rms_m: Annotated[float, Field(gt=0.0, le=0.2)] | None = None
    correlation_m: Annotated[float, Field(ge=0.05, le=10.0)] = 0.5
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    cell_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.05

    @model_validator(mode="after")
    def _is_one_of_two(self) -> HeightField:
        if not has_area(self.min_m, self.max_m):
            raise ValueError("min_m must be below max_m in x and in y")
        if (self.image is None) == (self.rms_m is None):
            raise ValueError("give either image and height_m, or rms_m")
        if (self.image is None) != (self.height_m is None):
            raise ValueError("image and height_m must be given together")
        if max(self.shape()) > 1001:
            raise ValueError("more than 1001 cells along a side: choose a larger cell_m")
        if self.rms_m is not None and self.correlation_m > _MOST_CORRELATED * self.cell_m:
            raise ValueError(f"correlation_m exceeds {_MOST_CORRELATED} cells: enlarge cell_m")
        return self

    def shape(self) -> tuple[int, int]:
        """Compute the size of the grid of heights.

        Returns:
            Rows (along y) and columns (along x).
        """
        spans = (self.max_m[1] - self.min_m[1], self.max_m[0] - self.min_m[0])
        rows, columns = (max(2, round(span / self.cell_m) + 1) for span in spans)
        return rows, columns


@dataclass(frozen=True, slots=True, config=STRICT)
class Terrain:
    """All ground that the robot can drive over. The robot's software does not know it.

    Attributes:
        ramps: the ramps.
        steps: the level blocks.
        height_field: rough ground, or None.
    """

    ramps: tuple[Ramp, ...] = ()
    steps: tuple[Step, ...] = ()
    height_field: HeightField | None = None


@dataclass(frozen=True, slots=True, config=STRICT)
class Loose:
    """A loose body on the floor.

    Attributes:
        shape: box or cylinder.
        position_m: x, y of its centre in map, m.
        size_m: length and width of a box, or diameter of a cylinder, m.
        mass_kg: mass, kg.
        height_m: height, m.
        friction: coefficient of friction between it and the ground.
        yaw_rad: yaw, rad.
        pushable: whether the robot may touch it; if not, a touch counts as a contact.
    """

    shape: Literal["box", "cylinder"]
    position_m: Point
    size_m: tuple[Length, ...]
    mass_kg: Annotated[float, Field(ge=0.01, le=1000.0)]
    height_m: Annotated[float, Field(ge=0.01, le=3.0)] = 0.35
    friction: Friction = 0.5
    yaw_rad: float = 0.0
    pushable: bool = False

    @model_validator(mode="after")
    def _check_size(self) -> Loose:
        if len(self.size_m) != (2 if self.shape == "box" else 1):
            raise ValueError("size_m of a box is length, width; of a cylinder its diameter")
        return self
