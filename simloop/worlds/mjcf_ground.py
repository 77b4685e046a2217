"""Add terrain, loose bodies and movers to a world before it is compiled.

Geoms named ``ground_*`` are ground: touching them is no contact, and they are not on the floor
plan. A ramp or step is ground if the vehicle can climb it in theory, else it is an obstacle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from simloop.common.grey_image import read_grey
from simloop.messages import FloatArray
from simloop.physics.track_theory import climbable_step, climbing_angle
from simloop.worlds.mjcf.climb import Climb
from simloop.worlds.mjcf.stands import BELLY_M, GROUND_BITS
from simloop.worlds.movers.settings import Mover
from simloop.worlds.terrain import HeightField, Loose, Ramp, Step, Terrain

_HULL_AND_WHEELS = GROUND_BITS[0]
_BASE_M = 0.1
_MOVER_RGBA = (0.80, 0.32, 0.24, 1.0)


def add_terrain(world: mujoco.MjSpec, terrain: Terrain, friction: float) -> None:
    """Add ramps, steps and the height field.

    Args:
        world: the specification, with the vehicle in it.
        terrain: the terrain to add.
        friction: coefficient of the tracks; what they cannot climb is named ``obstacle_*``.

    Raises:
        ValueError: an image cannot be read.
    """
    for number, ramp in enumerate(terrain.ramps, start=1):
        climbed = math.atan2(ramp.height_m, ramp.up_m) < climbing_angle_of(friction)
        _add_ramp(world, ramp, f"{'ground' if climbed else 'obstacle'}_ramp_{number:02d}")
    for number, step in enumerate(terrain.steps, start=1):
        climbed = step.height_m <= climbable_height(world, friction)
        _add_step(world, step, f"{'ground' if climbed else 'obstacle'}_step_{number:02d}")
    if terrain.height_field is not None:
        _add_field(world, terrain.height_field)


def climbing_angle_of(friction: float) -> float:
    """Compute the steepest ramp that the tracks climb, if friction is the only limit.

    Args:
        friction: coefficient between tracks and ground.

    Returns:
        The angle, rad.
    """
    return climbing_angle(math.inf, 1.0, 0.0, friction) if friction > 0.0 else 0.0


def climbable_height(world: mujoco.MjSpec, friction: float) -> float:
    """Compute the highest step that the vehicle climbs, by plane statics (``track_theory``).

    Args:
        world: the specification, with the vehicle in it.
        friction: coefficient between tracks and ground.

    Returns:
        The height, m.
    """
    base = world.body("base_link")
    wheels = [geom for geom in base.geoms if geom.name.startswith("road_left_")]
    x = [float(geom.pos[0]) for geom in wheels]
    centre, radius = base.ipos, float(wheels[0].size[0])
    return climbable_step(
        friction, radius, max(x) - float(centre[0]), float(centre[0]) - min(x), float(centre[2])
    )


def climb_of(world: mujoco.MjSpec, friction: float) -> Climb:
    """Compute what the vehicle climbs, by plane statics.

    Args:
        world: the specification, with the vehicle in it.
        friction: coefficient between tracks and ground.

    Returns:
        The highest step and the steepest slope.
    """
    return Climb(climbable_height(world, friction), climbing_angle_of(friction))


def heights_of(field: HeightField) -> FloatArray:
    """Compute the heights of a field of rough ground, from its image or from its seed.

    Args:
        field: the field's settings.

    Returns:
        (rows, columns) heights over the floor, m, 0 or more; row 0 at the smallest y.

    Raises:
        ValueError: the image cannot be read.
    """
    rows, columns = field.shape()
    if field.image is not None:
        assert field.height_m is not None
        grey = read_grey(field.image)
        scale = (rows / grey.shape[0], columns / grey.shape[1])
        return np.clip(zoom(grey, scale, order=1, grid_mode=True, mode="nearest"), 0.0, 1.0) * (
            field.height_m
        )
    assert field.rms_m is not None
    # White noise smoothed with a Gaussian of width s has the correlation exp(-d^2 / 4 s^2), which
    # is 1/e at d = 2 s.
    width = 0.5 * field.correlation_m / field.cell_m
    edge = math.ceil(4.0 * width)
    noise = np.random.default_rng(field.seed).standard_normal((rows + 2 * edge, columns + 2 * edge))
    smooth = gaussian_filter(noise, width, truncate=4.0)[edge : edge + rows, edge : edge + columns]
    smooth = field.rms_m * (smooth - smooth.mean()) / smooth.std()
    raised: FloatArray = (smooth - smooth.min()) * _rim(rows, columns, 2.0 * width)
    return raised


def _rim(rows: int, columns: int, width: float) -> FloatArray:
    """Compute weights (rows, columns) that rise from 0 at the edge to 1 at ``width`` cells."""
    along = [np.minimum(np.arange(n), np.arange(n)[::-1]) for n in (rows, columns)]
    distance = np.minimum(along[0][:, None], along[1][None, :])
    share = np.clip(distance / max(width, 1.0), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share), np.float64)


def add_loose(world: mujoco.MjSpec, things: Sequence[Loose]) -> None:
    """Add loose bodies on free joints. They are named ``loose_*`` if the robot may push them.

    Args:
        world: the specification.
        things: the loose bodies to add.
    """
    for number, thing in enumerate(things, start=1):
        name = f"{'loose' if thing.pushable else 'obstacle_loose'}_{number:02d}"
        half = 0.5 * thing.height_m
        body = world.worldbody.add_body(
            name=name, pos=[*thing.position_m, half], quat=_turn(thing.yaw_rad)
        )
        body.add_freejoint()
        geom = body.add_geom(name=name, contype=1, conaffinity=3, material="oak")
        geom.mass, geom.friction = thing.mass_kg, [thing.friction, 0.005, 0.0001]
        if thing.shape == "box":
            geom.type = mujoco.mjtGeom.mjGEOM_BOX
            geom.size = [0.5 * thing.size_m[0], 0.5 * thing.size_m[1], half]
        else:
            geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
            geom.size = [0.5 * thing.size_m[0], half, 0.0]
        # Without priority, MuJoCo uses the larger of two frictions, which may be the floor's.
        geom.priority = 1


def _turn(yaw_rad: float) -> list[float]:
    """Compute the quaternion of a rotation about z."""
    return [math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad)]


def _add_ramp(world: mujoco.MjSpec, ramp: Ramp, name: str) -> None:
    ends = ramp.up_m + ramp.top_m
    profile = [(0.0, 0.0), (ramp.up_m, ramp.height_m), (ends, ramp.height_m)]
    profile += [(ends + ramp.down_m, 0.0)]
    sides = (-0.5 * ramp.width_m, 0.5 * ramp.width_m)
    # The base is below the floor. Otherwise the foot would be thinner than a contact is deep.
    corners = [(x, y, z) for y in sides for x, z in (*profile, (0.0, -_BASE_M), (ends, -_BASE_M))]
    mesh = world.add_mesh(name=name, uservert=np.unique(np.array(corners), axis=0).ravel().tolist())
    world.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=mesh.name,
        pos=[*ramp.position_m, 0.0],
        quat=_turn(ramp.yaw_rad),
        contype=_HULL_AND_WHEELS,
        conaffinity=0,
        material="slate",
    )


def _add_step(world: mujoco.MjSpec, step: Step, name: str) -> None:
    world.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * step.size_m[0], 0.5 * step.size_m[1], 0.5 * step.height_m],
        pos=[*step.position_m, 0.5 * step.height_m],
        quat=_turn(step.yaw_rad),
        contype=_HULL_AND_WHEELS,
        conaffinity=0,
        material="slate",
    )


def _add_field(world: mujoco.MjSpec, field: HeightField) -> None:
    heights = heights_of(field)
    highest = max(float(heights.max()), 1e-6)
    size = [0.5 * (high - low) for low, high in zip(field.min_m, field.max_m, strict=True)]
    middle = [0.5 * (high + low) for low, high in zip(field.min_m, field.max_m, strict=True)]
    world.add_hfield(
        name="ground_field",
        nrow=heights.shape[0],
        ncol=heights.shape[1],
        size=[*size, highest, _BASE_M],
        userdata=(heights / highest).ravel().tolist(),
    )
    world.worldbody.add_geom(
        name="ground_field",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="ground_field",
        pos=[*middle, 0.0],
        contype=_HULL_AND_WHEELS if highest > BELLY_M else 2,
        conaffinity=0,
        material="sage",
    )


def add_movers(world: mujoco.MjSpec, movers: Sequence[Mover]) -> None:
    """Add movers as upright cylinders on mocap bodies ``mover_01``, ``mover_02``, ...

    Args:
        world: the specification.
        movers: the movers to add, in the order in which their places are set.
    """
    for number, mover in enumerate(movers, start=1):
        half = 0.5 * mover.height_m
        name = f"mover_{number:02d}"
        body = world.worldbody.add_body(name=name, mocap=True, pos=[*mover.start_m, half])
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.5 * mover.diameter_m, half, 0.0],
            contype=1,
            conaffinity=0,
            rgba=_MOVER_RGBA,
        )
