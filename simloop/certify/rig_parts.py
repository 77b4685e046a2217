"""Parts of a test rig's model: road wheels, blocks, and a rough height field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from simloop.messages import FloatArray

RADIUS_M = 0.037
"""Radius of the sprockets and road wheels of models/tracked_ugv.xml."""
_ROUGH_CELLS = 201  # grid points on each side of the height field
_COARSE = 51  # random heights on each side, with linear interpolation between them


@dataclass(frozen=True, slots=True)
class Block:
    """A box on or in the ground.

    Attributes:
        centre_m: (3,) centre in the world.
        half_m: (3,) half sizes.
        pitch_rad: pitch; positive: nose up.
        mass_kg: mass; above 0 the block is loose.
        friction: MuJoCo's own friction of the block against floor and hull.
        bearing: joint of a loose block. A rail allows motion along x, a pivot rotation about z.
        name: start of the geom's name, which decides the kind of a fixed block for the tracks.
    """

    centre_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    pitch_rad: float = 0.0
    mass_kg: float = 0.0
    friction: float = 0.5
    bearing: Literal["none", "rail", "pivot"] = "none"
    name: str = "ground_block"


def add_wheels(spec: mujoco.MjSpec, support_x: FloatArray, gauge_m: float) -> list[mujoco.MjsGeom]:
    """Add road wheels under base_link.

    Args:
        spec: the vehicle, without road wheels.
        support_x: (n,) x of the wheels of one side, front to rear, m.
        gauge_m: distance between left and right, m.

    Returns:
        The 2 n wheels, left before right.
    """
    base, style, wheels = spec.body("base_link"), spec.find_default("road_wheel"), []
    for label, sign in (("left", 1.0), ("right", -1.0)):
        for i, x in enumerate(support_x):
            geom = base.add_geom(style, name=f"road_{label}_{i}")
            geom.pos = [x, sign * 0.5 * gauge_m, RADIUS_M]
            wheels.append(geom)
    return wheels


def add_rough(spec: mujoco.MjSpec, height_m: float, seed: int) -> None:
    """Add a height field of 8 m x 8 m whose highest point is at most at z = 0.

    Heights are random every 16 cm and bilinear between: level on average, without cliffs.

    Args:
        spec: the world.
        height_m: difference between the lowest and the highest possible point, m.
        seed: seed of the random heights.
    """
    coarse = np.random.default_rng(seed).random((_COARSE, _COARSE))
    rows = np.linspace(0.0, _COARSE - 1.0, _ROUGH_CELLS)
    low = np.minimum(rows.astype(int), _COARSE - 2)
    share = rows - low
    along = coarse[low] * (1 - share)[:, None] + coarse[low + 1] * share[:, None]
    heights = along[:, low] * (1 - share) + along[:, low + 1] * share
    spec.add_hfield(
        name="rough",
        nrow=_ROUGH_CELLS,
        ncol=_ROUGH_CELLS,
        size=[4.0, 4.0, height_m, 0.2],
        userdata=heights.ravel().tolist(),
    )
    spec.worldbody.add_geom(
        name="ground_rough",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="rough",
        pos=[0.0, 0.0, -height_m],
        contype=3,
    )


def add_block(spec: mujoco.MjSpec, block: Block, number: int) -> None:
    """Add a block, fixed or loose.

    Args:
        spec: the world.
        block: the block to add.
        number: number that makes its name unique.
    """
    half = [math.cos(0.5 * block.pitch_rad), 0.0, -math.sin(0.5 * block.pitch_rad), 0.0]
    loose = block.mass_kg > 0.0
    name = f"{'loose' if loose else block.name}_{number}"
    holder = spec.worldbody
    if loose:
        holder = spec.worldbody.add_body(name=name, pos=list(block.centre_m), quat=half)
        if block.bearing == "rail":
            holder.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
        elif block.bearing == "pivot":
            holder.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
        else:
            holder.add_freejoint()
    geom = holder.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=list(block.half_m), contype=1
    )
    geom.friction = [block.friction, 0.005, 0.0001]
    # Wheels and hull touch any block. A free block also touches the floor and other blocks.
    geom.conaffinity = 3 if loose and block.bearing == "none" else 0
    if loose:
        geom.mass = block.mass_kg
    else:
        geom.pos, geom.quat = list(block.centre_m), half
