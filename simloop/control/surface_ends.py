"""Where the surfaces that a scan shows can end, between the last ray that met them and the next."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

_FEWEST = 8  # points that show the direction of a surface at its end; a thin post has none


@njit(cache=True)
def ends_of_surfaces(points: FloatArray, spacing: float, apart: float) -> FloatArray:
    """Find how far surfaces may go on beyond their last points.

    The tip of a sharp corner lies between two rays: the last one that met the surface and the first
    that passed it. From the same place every scan misses it again, by as much as the distance of
    two rays, and averaging moves it farther back.

    Args:
        points: (n, 2) points ordered by bearing, m, with the LiDAR near the origin.
        spacing: Angle between two rays, rad.
        apart: Distance of neighbours from which on the nearer one is the end of a surface, m.

    Returns:
        (k, 2) the farthest place that the end of each surface can have, m.
    """
    n = points.shape[0]
    out, k = np.empty((n, 2)), 0
    for i in range(n if n >= _FEWEST else 0):
        j = (i + 1) % n
        if _distance(points[i], points[j]) <= apart:
            continue
        # Of two neighbours far apart the nearer one hides what lies behind its end.
        if math.hypot(points[i, 0], points[i, 1]) < math.hypot(points[j, 0], points[j, 1]):
            out[k] = _prolonged(points, i, -1, spacing, apart)
        else:
            out[k] = _prolonged(points, j, 1, spacing, apart)
        k += 1
    return out[:k]


@njit(cache=True)
def _distance(a: FloatArray, b: FloatArray) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


@njit(cache=True)
def _prolonged(points: FloatArray, i: int, step: int, spacing: float, apart: float) -> FloatArray:
    """(2,) m: the surface that ends at point i, prolonged to the bearing of the next ray.

    Its direction is that of a line fitted to the ``_FEWEST`` points from i on, in direction
    ``step`` (1 or -1).
    """
    n = points.shape[0]
    x = y = xx = xy = yy = 0.0
    for k in range(_FEWEST):
        p = points[(i + k * step) % n]
        if k and _distance(p, points[(i + (k - 1) * step) % n]) > apart:
            return points[i]  # too little is seen of it
        x, y = x + p[0] / _FEWEST, y + p[1] / _FEWEST
    for k in range(_FEWEST):
        p = points[(i + k * step) % n]
        xx += (p[0] - x) ** 2
        xy += (p[0] - x) * (p[1] - y)
        yy += (p[1] - y) ** 2
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(along), math.sin(along)
    end = (points[i, 0] - x) * c + (points[i, 1] - y) * s
    if end < 0.0:
        c, s, end = -c, -s, -end
    bearing = math.atan2(points[i, 1], points[i, 0]) - step * spacing
    ux, uy = math.cos(bearing), math.sin(bearing)
    # Where the line (x, y) + t (c, s) meets that ray. A surface nearly along the ray has no end
    # that can be told so: it is prolonged by two distances of rays.
    far = end + 2.0 * spacing * math.hypot(points[i, 0], points[i, 1])
    across = ux * s - uy * c
    t = far if abs(across) < 1e-3 else (uy * x - ux * y) / across
    t = min(max(t, end), far)
    return np.array([x + t * c, y + t * s])
