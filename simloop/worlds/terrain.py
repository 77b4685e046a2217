"""Ground that is not flat, and things that may be pushed: what a scenario says of them.

Apart from any physics engine; ``ground`` builds them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, Length, Point, has_area
from simloop.config.simulation import Friction

MOST_ROUGH_STEP_S = 0.002
"""The longest physics step over a height field: a hull that falls on its prisms goes deep in one
longer step, and is thrown out of them with energy from nowhere."""
_MOST_CORRELATED = 100
"""Cells over which heights may be correlated: finer, a draw takes minutes and shows no more."""
Height = Annotated[float, Field(gt=0.0, le=1.0)]
Run = Annotated[float, Field(ge=0.0, le=100.0)]


@dataclass(frozen=True, slots=True, config=STRICT)
class Ramp:
    """A way up, a level top and a way down, along x from its foot, turned by yaw_rad about it.

    position_m: the middle of the foot. up_m, top_m, down_m: horizontal lengths; down_m = 0 is a
    drop. width_m: across.
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
    """A level block on the floor, or, if it is narrow, a sill; size_m: length, width over all."""

    position_m: Point
    size_m: tuple[Length, Length]
    height_m: Height
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True, config=STRICT)
class HeightField:
    """Rough ground over min_m to max_m (x, y in map), level with the floor at its rim.

    Either an image (PNG, grey: black is the floor, white is height_m above it; its upper edge is
    the largest y), or a draw from ``seed``: heights of standard deviation rms_m about their mean,
    with a Gaussian correlation that falls to 1/e at correlation_m. cell_m: of the grid.
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
            raise ValueError("image and height_m go together")
        if max(self.shape()) > 1001:
            raise ValueError("more than 1001 cells along a side: choose a larger cell_m")
        if self.rms_m is not None and self.correlation_m > _MOST_CORRELATED * self.cell_m:
            raise ValueError(f"correlation_m is over {_MOST_CORRELATED} cells: a larger cell_m")
        return self

    def shape(self) -> tuple[int, int]:
        """Rows (along y) and columns (along x) of the grid of heights."""
        spans = (self.max_m[1] - self.min_m[1], self.max_m[0] - self.min_m[0])
        rows, columns = (max(2, round(span / self.cell_m) + 1) for span in spans)
        return rows, columns


@dataclass(frozen=True, slots=True, config=STRICT)
class Terrain:
    """All that lies on the floor and is driven over. The robot's own software knows of none."""

    ramps: tuple[Ramp, ...] = ()
    steps: tuple[Step, ...] = ()
    height_field: HeightField | None = None


@dataclass(frozen=True, slots=True, config=STRICT)
class Loose:
    """A thing that stands loose on the floor; size_m: box (length, width), cylinder (diameter,).

    friction: between it and the ground. pushable: whether touching it is allowed; a touch of what
    is not counts as any other contact does.
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
