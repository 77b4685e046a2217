"""Where a robot that sees only ahead may go backwards: along its own trail."""

from __future__ import annotations

import numpy as np

from simloop.geometry.footprint import arc_end
from simloop.messages import FloatArray

_DISTANCES_M = (0.1, 0.2, 0.3)  # along the arc; each scan brings a new trail
_ASIDE_M = 0.12  # largest distance of the arc from the trail
_LEAST_MPS = 0.02  # a slower speed has no arc worth the name


def is_on_trail(trail_m: FloatArray | None, speed: float, rate: float) -> bool:
    """Say whether the arc of a backward velocity lies on the robot's own trail.

    Args:
        trail_m: (k, 2) where base_link has been, in base_link now, m; None if everything is seen.
        speed: Forward speed, m/s, negative.
        rate: Yaw rate, rad/s.

    Returns:
        True if the next 0.3 m of the arc are near the trail, or if there is no trail to keep to.
    """
    if trail_m is None:
        return True
    if not len(trail_m):
        return False
    curvature = rate / min(speed, -_LEAST_MPS)
    for distance in _DISTANCES_M:
        x, y = arc_end(-distance, -distance * curvature)
        if np.hypot(trail_m[:, 0] - x, trail_m[:, 1] - y).min() > _ASIDE_M:
            return False
    return True
