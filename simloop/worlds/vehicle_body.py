"""Read the robot's true outline from the vehicle's model."""

from __future__ import annotations

import mujoco
import numpy as np

from simloop.worlds.body import Body
from simloop.worlds.solids import solids_of_spec

_DECIMALS = 6  # micrometres; rounding errors of decimal fractions are smaller


def body_of(spec: mujoco.MjSpec) -> Body:
    """Read the outline of the vehicle from its model, before or after compilation.

    Lengths are rounded to the micrometre.

    Args:
        spec: a specification with the vehicle: the body ``base_link`` and the site ``lidar``.

    Returns:
        The outline and the LiDAR's height.
    """
    base = spec.body("base_link")
    solids = solids_of_spec(spec, base, jointed=True)
    # The rectangle is centred on base_link, so the farther of two opposite sides counts.
    half_length, half_width = (
        max(solid.reach_m(side * axis) for solid in solids for side in (-1.0, 1.0))
        for axis in np.eye(3)[:2]
    )
    return Body(
        round(2.0 * half_length, _DECIMALS),
        round(2.0 * half_width, _DECIMALS),
        round(float(spec.site("lidar").pos[2]), _DECIMALS),
    )
