"""Obstacles that a scenario or a seed adds to an arena. Independent of the physics engine."""

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
    """An upright, static obstacle that stands on the floor or hangs above it.

    Attributes:
        shape: box, cylinder, ellipse, ell (an L of two boxes) or polygon (convex).
        position_m: x, y of its centre in map, m.
        size_m: overall size, m: length and width of a box or an ellipse; diameter of a cylinder;
            length, width and thickness of the arms of an ell; empty for a polygon. Without yaw the
            length is along x.
        yaw_rad: yaw, rad.
        height_m: distance from its lower to its upper edge, m.
        vertices_m: (V, 2) corners of a polygon relative to its centre, m.
        bottom_m: height of its lower edge over the floor, m.
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
            raise ValueError("vertices_m: required for a polygon, not allowed for any other shape")
        if self.shape == "polygon" and not _is_convex(np.array(self.vertices_m)):
            raise ValueError("vertices_m must be the corners of a convex polygon, in order")
        return self

    def parts(self) -> tuple[Obstacle, ...]:
        """Split the obstacle into convex parts.

        Returns:
            The obstacle itself, or the two boxes of an L.
        """
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
        """Compute its outlines on the floor plan: ellipses to 0.1 mm, all others exactly.

        Args:
            name: name of the sections.

        Returns:
            One section for each convex part.
        """
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
        """Transform points (N, 2) from the obstacle's frame to map."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return local @ np.array([[cos, sin], [-sin, cos]]) + np.array(self.position_m)


def ellipse_outline(semi_x_m: float, semi_y_m: float, count: int = 96) -> FloatArray:
    """Approximate an ellipse by a polygon, to 0.03 %, as far outside of it as inside.

    Args:
        semi_x_m: half axis along x, m.
        semi_y_m: half axis along y, m.
        count: number of vertices.

    Returns:
        (count, 2) vertices about the origin, m, counter-clockwise.
    """
    angle = 2.0 * math.pi * np.arange(count) / count
    swell = 2.0 / (1.0 + math.cos(math.pi / count))
    return swell * np.stack([semi_x_m * np.cos(angle), semi_y_m * np.sin(angle)], axis=1)


def counter_clockwise(outline: FloatArray) -> FloatArray:
    """Put an outline into counter-clockwise order.

    Args:
        outline: (V, 2) vertices in either order.

    Returns:
        (V, 2) the same vertices, reversed if they were clockwise.
    """
    following = np.roll(outline, -1, axis=0)
    area = np.sum(outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0])
    return outline if area >= 0.0 else outline[::-1].copy()


def _is_convex(outline: FloatArray) -> bool:
    """Tell whether an outline (V, 2) turns in one direction only, and exactly once around."""
    if len(outline) < 3:
        return False
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    total = np.arctan2(turns, np.sum(edges * following, axis=1)).sum()
    one_way = bool(np.all(turns > 0.0) or np.all(turns < 0.0))
    return one_way and abs(abs(total) - 2.0 * math.pi) < 1e-6
