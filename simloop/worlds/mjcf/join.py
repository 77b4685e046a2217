"""Join an arena and the vehicle in one world, without either changing the other."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from typing import Any

import mujoco

from simloop.common.data_files import models_dir
from simloop.physics.engine import warnings_heard
from simloop.worlds.mjcf.reader import fields_of

PREFIX = "arena/"
"""Start of the names of the arena's materials, meshes and default classes in the joined world."""
_OURS = re.compile(
    r"(obstacle_(drawn|step|ramp|loose)|ground_(ramp|step|field)|loose|mover)(_\d|$)|payload$"
)
"""Names of what a scenario adds."""
_DRAWN = ("oak", "teal", "brick", "mustard", "slate", "sage", "plum")


def join(arena: mujoco.MjSpec) -> mujoco.MjSpec:
    """Attach an arena and the vehicle to an empty world.

    The vehicle keeps the names of its own file, and so do the arena's bodies, geoms and cameras
    unless the vehicle has one of the same name. All else of the arena gets a prefix. The world has
    the options of the vehicle's file, and the look of the arena's.

    Args:
        arena: the arena, checked; it becomes part of the result.

    Returns:
        The world, not compiled. It has all materials that drawn obstacles use.
    """
    world, vehicle = _look(), vehicle_spec()
    for key in fields_of(world.option):
        value = getattr(vehicle.option, key)
        setattr(world.option, key, value)
        setattr(arena.option, key, value)  # equal, so that MuJoCo reports no conflict
    _copy_look(arena, world)
    mine = {kind: {one.name for one in getattr(vehicle, kind)} for kind in _KINDS}
    with warnings_heard(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # In this order, the bodies of the arena come before the vehicle, as they always have.
        world.attach(arena, prefix=PREFIX, frame=world.worldbody.add_frame())
        world.attach(vehicle, prefix="", frame=world.worldbody.add_frame())
    for kind in _KINDS:
        _shorten(world, getattr(world, kind), mine[kind])
    return world


_KINDS = ("bodies", "geoms", "cameras", "numerics")


def vehicle_spec() -> mujoco.MjSpec:
    """Read the vehicle's file, without what it has only to be opened alone.

    Returns:
        The vehicle, not compiled.
    """
    models = models_dir()
    vehicle = mujoco.MjSpec.from_file(str(models / "tracked_ugv.xml"))
    vehicle.delete(vehicle.geom("ground"))
    vehicle.delete(vehicle.light("ground_light"))
    # The keyframe holds only the vehicle's joints, not those of loose bodies.
    vehicle.delete(vehicle.key("home"))
    for mesh in vehicle.meshes:
        mesh.file = str(models.absolute() / mesh.file)
    return vehicle


def _look() -> mujoco.MjSpec:
    """Make an empty world with the materials of drawn obstacles."""
    world = mujoco.MjSpec.from_file(str(models_dir() / "arenas" / "assets" / "look.xml"))
    for material in list(world.materials):
        if material.name not in _DRAWN:
            world.delete(material)
    for texture in list(world.textures):
        world.delete(texture)
    return world


def _copy_look(arena: mujoco.MjSpec, world: mujoco.MjSpec) -> None:
    """Take light, colours and the camera's default view from the arena."""
    for part in ("headlight", "map", "rgba", "scale"):
        theirs, ours = getattr(arena.visual, part), getattr(world.visual, part)
        for key in fields_of(theirs):
            setattr(ours, key, getattr(theirs, key))
    world.stat.center, world.stat.extent = arena.stat.center, arena.stat.extent
    arena.visual.quality = world.visual.quality


def _shorten(world: mujoco.MjSpec, elements: Iterable[Any], vehicles: set[str]) -> None:
    """Take the prefix off the arena's names that the vehicle does not have."""
    taken = set(vehicles)
    followers = [one for one in (*world.cameras, *world.lights) if one.targetbody]
    for one in list(elements):
        short = one.name.removeprefix(PREFIX)
        if _OURS.match(short):
            short += "_"
        # The vehicle's road wheels are found by their numbers.
        if short != one.name and short not in taken and not short.startswith("road_"):
            for follower in followers:
                if isinstance(one, mujoco.MjsBody) and follower.targetbody == one.name:
                    follower.targetbody = short
            one.name = short
            taken.add(short)
