"""The robot's true outline; ``config.vehicle`` is what the robot believes of it.

Scenario files are read without MuJoCo, so ``vehicle_body`` reads the outline from the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

_DISCS = 3
_DECIMALS = 6
_RADIUS_STEP_M = 0.01


class Outline(Protocol):
    """A rectangle centred on base_link, its length along x."""

    @property
    def length_m(self) -> float:
        """Over all, m."""
        ...

    @property
    def width_m(self) -> float:
        """Over all, m."""
        ...


@dataclass(frozen=True, slots=True)
class Body:
    """What the robot truly is, for everything that judges or draws: never for the robot itself.

    Attributes:
        length_m: of the rectangle centred on base_link that holds all collision geoms, m.
        width_m: of the same rectangle, m.
        lidar_height_m: of the LiDAR's plane over the ground, m.
    """

    length_m: float
    width_m: float
    lidar_height_m: float

    @property
    def footprint_radius_m(self) -> float:
        """Radius of three equal discs in a row that cover the outline, up to a whole cm, m."""
        exact = math.hypot(0.5 * self.length_m / _DISCS, 0.5 * self.width_m)
        # The rounding first keeps a radius of exactly 0.25 m from becoming 0.26 m.
        return math.ceil(round(exact / _RADIUS_STEP_M, _DECIMALS)) / round(1.0 / _RADIUS_STEP_M)

    @property
    def turning_radius_m(self) -> float:
        """From base_link to the corners: what it needs to turn on the spot, m."""
        return math.hypot(0.5 * self.length_m, 0.5 * self.width_m)
