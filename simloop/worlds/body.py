"""The robot's true outline. ``config.vehicle`` is what the robot believes about it.

Scenario files are read without MuJoCo, so this module does not load the model: ``vehicle_body``
reads the outline from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

_DISCS = 3
_DECIMALS = 6
_RADIUS_STEP_M = 0.01


class Outline(Protocol):
    """A rectangle centred on base_link, with its length along x."""

    @property
    def length_m(self) -> float:
        """Overall length, m."""
        ...

    @property
    def width_m(self) -> float:
        """Overall width, m."""
        ...


@dataclass(frozen=True, slots=True)
class Body:
    """The robot's true size, for evaluation and drawings. The robot itself never sees it.

    Attributes:
        length_m: length of the rectangle centred on base_link that holds all collision geoms, m.
        width_m: width of the same rectangle, m.
        lidar_height_m: height of the LiDAR's plane over the ground, m.
    """

    length_m: float
    width_m: float
    lidar_height_m: float

    @property
    def footprint_radius_m(self) -> float:
        """Radius of three equal discs in a row that cover the outline, rounded up to 1 cm, m."""
        exact = math.hypot(0.5 * self.length_m / _DISCS, 0.5 * self.width_m)
        # Without the first rounding, a radius of exactly 0.25 m would become 0.26 m.
        return math.ceil(round(exact / _RADIUS_STEP_M, _DECIMALS)) / round(1.0 / _RADIUS_STEP_M)

    @property
    def turning_radius_m(self) -> float:
        """Distance from base_link to the corners: the room to turn on the spot, m."""
        return math.hypot(0.5 * self.length_m, 0.5 * self.width_m)
