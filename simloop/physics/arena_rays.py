"""Cast rays among the arena's geoms, for the LiDAR and the depth camera."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import SEEN_GROUPS

_GRAZING = 0.15  # a ray grazes a surface if the cosine between ray and normal is below this
_FAR_M = 0.01  # along the normal; an origin that is farther off may face another surface


class ArenaRays:
    """Cast rays that hit the arena but not the vehicle."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Keep the model and its state.

        Args:
            model: an arena with the vehicle.
            data: its state, read at each call.
        """
        self._model, self._data = model, data
        self._vehicle = model.body("base_link").id
        self._groups = np.isin(np.arange(6), SEEN_GROUPS).astype(np.uint8)

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Cast the rays of one control period. Their origins are millimetres apart.

        All rays are cast from the middle origin in one call. Then each range is corrected for the
        ray's own origin, with the hit surface as a plane. A ray that grazes its surface is cast
        again from its own origin.

        Args:
            origins_m: (n, 3) in the world, m; none in a period without a beam.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        if len(origins_m) == 0:
            return np.empty(0)
        middle = origins_m[len(origins_m) // 2]
        ranges, normals = self._fan(middle, directions, cutoff_m)
        geom = np.empty(1, np.int32)
        for i in carry_ranges(ranges, normals, directions, origins_m, middle, cutoff_m):
            there = mujoco.mj_ray(
                self._model,
                self._data,
                origins_m[i],
                directions[i],
                self._groups,
                1,
                self._vehicle,
                geom,
            )
            ranges[i] = there if there <= cutoff_m else -1.0
        return ranges

    def look(self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Cast rays from one origin.

        Args:
            origin_m: (3,) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        ranges, _ = self._fan(origin_m, directions, cutoff_m)
        ranges[ranges > cutoff_m] = -1.0
        return ranges

    def _fan(
        self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float
    ) -> tuple[FloatArray, FloatArray]:
        """Cast from one origin: ranges (n,), normals (n, 3). Beyond the cutoff: -1 or a range."""
        n = len(directions)
        normals, ranges, geoms = np.empty((n, 3)), np.empty(n), np.empty(n, np.int32)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            origin_m,
            directions.ravel(),
            self._groups,
            1,
            self._vehicle,
            geoms,
            ranges,
            normals.ravel(),
            n,
            cutoff_m,
        )
        return ranges, normals


@njit(cache=True)
def carry_ranges(
    ranges: FloatArray,
    normals: FloatArray,
    directions: FloatArray,
    origins: FloatArray,
    middle: FloatArray,
    cutoff: float,
) -> NDArray[np.int64]:
    """Correct ranges in place for ray origins near the one of the cast. Surfaces are planes.

    r' = r - (d . n) / (u . n), with n the surface's normal, d the origin's offset, u the ray.

    Args:
        ranges: (n,) from ``middle``, m; updated. Negative ones (no hit) are not changed.
        normals: (n, 3) of the surfaces that were hit.
        directions: (n, 3) unit vectors u.
        origins: (n, 3) the rays' own origins, m.
        middle: (3,) the origin from which they were cast, m.
        cutoff: longest range, m; a longer range becomes -1.

    Returns:
        Indices of the rays that meet their surface at an angle too flat for this correction.
    """
    flat = np.empty(ranges.shape[0], np.int64)
    count = 0
    for i in range(ranges.shape[0]):
        if ranges[i] < 0.0:
            continue
        along, off = 0.0, 0.0
        for k in range(3):
            along += directions[i, k] * normals[i, k]
            off += (origins[i, k] - middle[k]) * normals[i, k]
        # At a flat angle, a small offset moves the hit a long way, perhaps past the surface's edge.
        if abs(along) < _GRAZING or abs(off) > _FAR_M:
            flat[count] = i
            count += 1
        else:
            ranges[i] -= off / along
            if ranges[i] > cutoff:
                ranges[i] = -1.0
    return flat[:count]
