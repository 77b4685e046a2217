"""Tell which geoms that an arena calls ground the vehicle can get onto, by shape and place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.worlds.solids import Solid

_AZIMUTHS = 32
_STEP = 1e-5  # of the derivative of the support function
_BESIDE_M = 0.05  # two geoms that are nearer touch


class Climb(NamedTuple):
    """What the vehicle climbs.

    Attributes:
        height_m: the highest step, m.
        angle_rad: the steepest slope, rad.
    """

    height_m: float
    angle_rad: float


def climbed(solids: Sequence[Solid | None], climb: Climb, flat_m: float) -> NDArray[np.bool_]:
    """Tell which solids the vehicle can get onto, from the floor or from others that touch them.

    A solid is climbed where its upper side begins: the top of a box or a wall, the foot of a ramp.
    So a ramp and each stair of a flight are climbed, and a wall that stands alone is not. What
    touches is told by the boxes around the solids.

    Args:
        solids: convex solids in map, over a floor at z = 0; None: ground in any case, which leads
            nowhere.
        climb: what the vehicle climbs.
        flat_m: height up to which a solid is ground in any case, m.

    Returns:
        (N,) for each solid.
    """
    count = len(solids)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    foot = np.zeros(count)
    for number, solid in enumerate(solids):
        if solid is not None:
            high[number] = [solid.reach_m(axis) for axis in np.eye(3)]
            low[number] = [-solid.reach_m(-axis) for axis in np.eye(3)]
            foot[number] = 0.0 if high[number, 2] <= flat_m else _foot_m(solid, climb.angle_rad)
    reached = foot <= climb.height_m
    waiting = np.flatnonzero(reached).tolist()
    while waiting:
        one = waiting.pop()
        touches = np.all(
            (low[:, :2] <= high[one, :2] + _BESIDE_M) & (high[:, :2] >= low[one, :2] - _BESIDE_M),
            axis=1,
        )
        new = touches & ~reached & (foot <= high[one, 2] + climb.height_m)
        reached |= new
        waiting += np.flatnonzero(new).tolist()
    return reached


def _foot_m(solid: Solid, angle_rad: float) -> float:
    """Compute the least height of the surface that is not steeper than an angle, m.

    It is at a point that is the farthest along a direction with this angle to the vertical.
    """
    angles = 2.0 * math.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    return min(
        _height_m(solid, np.array([sine * math.cos(angle), sine * math.sin(angle), cosine]))
        for angle in angles.tolist()
    )


def _height_m(solid: Solid, direction: FloatArray) -> float:
    """Compute the height of the lowest of the points that are farthest along a direction, m.

    It is the derivative of the support function along the vertical.
    """
    beside = direction - np.array([0.0, 0.0, _STEP])
    length = float(np.linalg.norm(beside))
    return (solid.reach_m(direction) - length * solid.reach_m(beside / length)) / _STEP
