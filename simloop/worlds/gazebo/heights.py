"""Tell by its height what is an obstacle: not the floor, and not what hangs over the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simloop.messages import FloatArray
from simloop.worlds.floor_plan import BAND_M
from simloop.worlds.gazebo.models import Collision
from simloop.worlds.gazebo.notes import Notes
from simloop.worlds.gazebo.shapes import Ground, Shell
from simloop.worlds.solids import Solid

_HIGHEST_FLOOR_M = 0.3  # a floor slab is at most this far from the feet of what stands on it
_FLOOR_SIDE_M = 2.0  # a floor is at least this long and wide
_THICKEST_M = 1.0
_CARRIES = 0.8  # share of all other things that a floor has above it


class Placed(NamedTuple):
    """A solid or shell with the box around it.

    Attributes:
        collision: the collision shape that it belongs to.
        body: the solid or shell.
        low: (3,) least x, y, z in map, m.
        high: (3,) greatest x, y, z, m.
    """

    collision: Collision
    body: Solid | Shell
    low: FloatArray
    high: FloatArray


def placed(collision: Collision, body: Solid | Shell) -> Placed:
    """Compute the box around a body.

    Args:
        collision: the collision shape that it belongs to.
        body: the body.

    Returns:
        The body with its box.
    """
    if isinstance(body, Shell):
        corners = body.triangles.reshape(-1, 3)
        return Placed(collision, body, corners.min(axis=0), corners.max(axis=0))
    high = np.array([body.reach_m(axis) for axis in np.eye(3)])
    return Placed(collision, body, np.array([-body.reach_m(-axis) for axis in np.eye(3)]), high)


def ground_height(
    things: Sequence[Placed],
    planes: Sequence[Ground],
    start_m: Sequence[float] | None,
    notes: Notes,
) -> float:
    """Find the height of the ground that the robot stands on.

    It is the highest plane, or the top of a wide slab that carries the robot's start and most other
    things. The slab lies at most 0.3 m over the plane; if there is none, at most 0.3 m over or
    under the feet of most other things.

    Args:
        things: all bodies.
        planes: all planes.
        start_m: (2,) x, y of the robot's start in map, m; None: unknown.
        notes: gets the name of a floor that is not at height 0.

    Returns:
        The height in map, m; 0 if nothing tells it.
    """
    ground, name = 0.0, ""
    if planes:
        ground = max(plane.height_m for plane in planes)
        name = "the highest plane"
    low = np.array([one.low for one in things]).reshape(-1, 3)
    high = np.array([one.high for one in things]).reshape(-1, 3)
    middle = 0.5 * (low + high)
    size = high - low
    wide = (size[:, :2].min(axis=1) >= _FLOOR_SIDE_M) & (size[:, 2] <= _THICKEST_M)
    wide &= np.array([_is_level(one.body) for one in things], bool)
    rests = low[~wide, 2]
    base = ground if planes or not len(rests) else float(np.median(rests))
    for k in np.flatnonzero(wide).tolist():
        top = float(high[k, 2])
        if abs(top - base) > _HIGHEST_FLOOR_M or (planes and top <= ground):
            continue
        others = np.arange(len(things)) != k if wide.all() else ~wide
        over = np.all((middle[:, :2] >= low[k, :2]) & (middle[:, :2] <= high[k, :2]), axis=1)
        carried = over[others] & (high[others, 2] > top + BAND_M[0])
        here = start_m is None or bool(
            np.all((low[k, :2] <= start_m[:2]) & (high[k, :2] >= start_m[:2]))
        )
        if here and len(carried) and carried.mean() >= _CARRIES and (not name or top > ground):
            ground, name = top, f"model {things[k].collision.model}"
    if abs(ground) > 1e-3:
        notes.add(f"the ground is at height {ground:.3g} m", name)
    return ground


def _is_level(body: Solid | Shell) -> bool:
    """Tell whether a wide body can be a floor: its upper side is not tilted."""
    if isinstance(body, Shell):
        return bool(np.ptp(body.triangles[..., 2]) <= _HIGHEST_FLOOR_M)
    return bool(np.abs(body.rotation[2]).max() > 1.0 - 1e-6)


def standing(things: Sequence[Placed], ground_m: float, notes: Notes) -> list[Placed]:
    """Select the bodies that are in the robot's way by their height.

    Args:
        things: all bodies.
        ground_m: height of the ground in map, m.
        notes: gets what is left out.

    Returns:
        The bodies that reach the heights at which something can touch the robot.
    """
    least, most = BAND_M
    found = []
    for one in things:
        name = one.collision.model
        bottom, top = one.low[2] - ground_m, one.high[2] - ground_m
        if top <= least + 1e-9:
            notes.add(f"what is lower than {least:g} m is floor, and left out", name)
        elif bottom >= most - 1e-9:
            notes.add(f"what hangs higher than the robot ({most:g} m) is left out", name)
        else:
            found.append(one)
            if one.collision.can_move:
                notes.add("models that are not static stand still here", name)
    return found
