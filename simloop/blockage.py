"""Whether what has just come into the map stands in the way of the path that is followed.

Each scan makes a handful of cells occupied. Asking how near these come to the path ahead is
some thousand times cheaper than a new distance field of the whole map, and misses nothing: an
obstacle that was not in the planner's view is in a cell that became occupied after it.
"""

from __future__ import annotations

import math

from numba import njit

from simloop.messages import FloatArray


@njit(cache=True)
def stands_in_the_way(
    surfaces: FloatArray,
    xy: FloatArray,
    yaw: FloatArray,
    clearance: FloatArray,
    first: int,
    offsets: FloatArray,
    limit: float,
    slack: float,
) -> bool:
    """Whether a surface (k, 2), in map, comes too near to the footprint's discs along a path.

    xy (n, 2), yaw (n,), clearance (n,), m, of the path's samples as planned; those from ``first``
    on count. offsets: of the discs' centres along the heading, m. Too near is less than ``limit``
    and less than was planned by more than ``slack``, m.
    """
    reach = 0.0
    for d in range(offsets.shape[0]):
        reach = max(reach, abs(offsets[d]))
    for k in range(surfaces.shape[0]):
        for i in range(first, xy.shape[0]):
            near = min(limit, clearance[i] - slack)
            dx, dy = surfaces[k, 0] - xy[i, 0], surfaces[k, 1] - xy[i, 1]
            if near <= 0.0 or dx * dx + dy * dy >= (near + reach) ** 2:
                continue
            cos, sin = math.cos(yaw[i]), math.sin(yaw[i])
            along, aside = cos * dx + sin * dy, cos * dy - sin * dx
            for d in range(offsets.shape[0]):
                if math.hypot(along - offsets[d], aside) < near:
                    return True
    return False
