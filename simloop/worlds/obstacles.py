"""Obstacles that a scenario or a seed adds to an arena, apart from any physics engine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, Point
from simloop.messages import FloatArray
from simloop.worlds.floor_plan import Section

ShapeName = Literal["box", "cylinder", "ellipse", "ell", "polygon"]
Length = Annotated[float, Field(gt=0.0, le=1e3)]

_SIZES = {
    "box": "length, width",
    "ellipse": "length, width",
    "cylinder": "diameter",
    "ell": "length, width, thickness",
    "polygon": "(none: give vertices_m)",
}
_COUNTS = {"box": 2, "ellipse": 2, "cylinder": 1, "ell": 3, "polygon": 0}


@dataclass(frozen=True, slots=True, config=STRICT)
class Obstacle:
    """An upright, static thing on the floor, or hung up ``bottom_m`` over it.

    size_m, over all: box and ellipse (length, width), cylinder (diameter,), ell (length, width,
    thickness) of two boxes that make an L. A polygon is convex and has ``vertices_m`` instead,
    (V, 2) about its own centre. The length lies along x, turned by ``yaw_rad``.
    """

    shape: ShapeName
    position_m: Point
    size_m: tuple[Length, ...] = ()
    yaw_rad: float = 0.0
    height_m: Annotated[float, Field(gt=0.0, le=3.0)] = 0.35
    vertices_m: tuple[Point, ...] = ()
    bottom_m: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0

    @model_validator(mode="after")
    def _check_size(self) -> Obstacle:
        if len(self.size_m) != _COUNTS[self.shape]:
            raise ValueError(f"size_m of a {self.shape} is {_SIZES[self.shape]}")
        if self.shape == "ell" and self.size_m[2] >= min(self.size_m[:2]):
            raise ValueError("an ell's thickness must be less than its length and width")
        if (self.shape == "polygon") != bool(self.vertices_m):
            raise ValueError("a polygon has vertices_m, and nothing else has them")
        if self.shape == "polygon" and not _is_convex(np.array(self.vertices_m)):
            raise ValueError("vertices_m must go round a convex polygon")
        return self

    def parts(self) -> tuple[Obstacle, ...]:
        """The convex pieces of which it is made: itself, or the two boxes of an L."""
        if self.shape != "ell":
            return (self,)
        length, width, thick = self.size_m
        foot = self._box(0.0, 0.5 * (thick - width), length, thick)
        stem = self._box(0.5 * (thick - length), 0.5 * thick, thick, width - thick)
        return foot, stem

    def _box(self, x: float, y: float, length: float, width: float) -> Obstacle:
        (where,) = self._placed(np.array([[x, y]])).tolist()
        return replace(self, shape="box", position_m=tuple(where), size_m=(length, width))

    def sections(self, name: str = "obstacle") -> tuple[Section, ...]:
        """What it shows on the floor plan, exactly (an ellipse to 0.1 mm)."""
        return tuple(part._section(name) for part in self.parts())

    def _section(self, name: str) -> Section:
        if self.shape == "cylinder":
            return Section(name, np.array([self.position_m]), 0.5 * self.size_m[0])
        if self.shape == "polygon":
            outline = counter_clockwise(np.array(self.vertices_m))
        elif self.shape == "ellipse":
            outline = ellipse_outline(0.5 * self.size_m[0], 0.5 * self.size_m[1])
        else:
            corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
            outline = 0.5 * corners * np.array(self.size_m)
        return Section(name, self._placed(outline))

    def _placed(self, local: FloatArray) -> FloatArray:
        """(N, 2) of the obstacle's own frame in map."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return local @ np.array([[cos, sin], [-sin, cos]]) + np.array(self.position_m)


def ellipse_outline(semi_x_m: float, semi_y_m: float, count: int = 96) -> FloatArray:
    """(count, 2) counter-clockwise, as far outside the ellipse as inside it: within 0.03 %."""
    angle = 2.0 * math.pi * np.arange(count) / count
    swell = 2.0 / (1.0 + math.cos(math.pi / count))
    return swell * np.stack([semi_x_m * np.cos(angle), semi_y_m * np.sin(angle)], axis=1)


def counter_clockwise(outline: FloatArray) -> FloatArray:
    """The same outline (V, 2), turned round if it runs clockwise."""
    following = np.roll(outline, -1, axis=0)
    area = np.sum(outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0])
    return outline if area >= 0.0 else outline[::-1].copy()


def _is_convex(outline: FloatArray) -> bool:
    if len(outline) < 3:
        return False
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    total = np.arctan2(turns, np.sum(edges * following, axis=1)).sum()
    one_way = bool(np.all(turns > 0.0) or np.all(turns < 0.0))
    return one_way and abs(abs(total) - 2.0 * math.pi) < 1e-6
