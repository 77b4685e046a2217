"""What each geom of a model is to the tracks, and which are the road wheels."""

from __future__ import annotations

import mujoco
import numpy as np

from simloop.physics.track_model import GROUND, HULL, OBSTACLE, WHEEL

SEEN_GROUPS = (0, 1)
"""The geom groups that rays meet: the arena's, not the vehicle's visual (2) and collision (3)."""


def geom_kinds(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) what each geom is to the tracks: ground, obstacle, hull or road wheel i.

    Ground is ``floor`` and whatever is named ``ground_*`` or ``loose_*`` (things that may be
    pushed about); the vehicle is the tree under base_link.
    """
    root = model.body("base_link").id
    kinds = np.full(model.ngeom, OBSTACLE, np.int64)
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if model.body_rootid[model.geom_bodyid[geom]] == root:
            kinds[geom] = HULL
        elif name == "floor" or name.startswith(("ground_", "loose_")):
            kinds[geom] = GROUND
    for number, geom in enumerate(road_wheels(model)):
        kinds[geom] = WHEEL + number
    return kinds


def road_wheels(model: mujoco.MjModel) -> list[int]:
    """The road wheels' geoms, ``road_left_0`` (the foremost), ``road_left_1``, ..., then the right.

    Raises ValueError where the sides differ in number or there are fewer than two.
    """
    sides = []
    for label in ("left", "right"):
        count = 0
        while mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"road_{label}_{count}") >= 0:
            count += 1
        sides.append([model.geom(f"road_{label}_{i}").id for i in range(count)])
    if len(sides[0]) != len(sides[1]) or len(sides[0]) < 2:
        raise ValueError("each side of the vehicle needs as many road wheels, two or more")
    return sides[0] + sides[1]


def is_free(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body hangs on a free joint: its own pose is then all of its joint's."""
    joint = int(model.body_jntadr[body])
    return joint >= 0 and bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)
