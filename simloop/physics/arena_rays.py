"""Rays cast among the arena's geoms: what LiDAR and depth camera measure."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import SEEN_GROUPS

_GRAZING = 0.15  # cosine between a ray and the surface's normal below which it grazes
_FAR_M = 0.01  # offset of origins along a normal beyond which a surface may not be the same plane


class ArenaRays:
    """Casts rays that see the arena and not the vehicle."""

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
        """Ranges of the rays of one control period, whose origins are millimetres apart.

        All rays are cast from the middle origin in one call. Each range is then carried over to its
        own origin along the surface that was hit. A ray that grazes its surface is cast again from
        its own origin.

        Args:
            origins_m: (n, 3) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where nothing is met within the cutoff.
        """
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
        """Ranges of rays from one origin.

        Args:
            origin_m: (3,) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where nothing is met within the cutoff.
        """
        ranges, _ = self._fan(origin_m, directions, cutoff_m)
        ranges[ranges > cutoff_m] = -1.0
        return ranges

    def _fan(
        self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (n,) and normals (n, 3) from one origin; beyond the cutoff -1 or a range."""
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
    """Carry ranges in place from one origin to others nearby, surfaces being planes.

    r' = r - (d . n) / (u . n), with n the surface's normal, d the origin's offset, u the ray.

    Args:
        ranges: (n,) from ``middle``, m; updated. Negative ones (nothing met) stay as they are.
        normals: (n, 3) of the surfaces that were hit.
        directions: (n, 3) unit vectors u.
        origins: (n, 3) the rays' own origins, m.
        middle: (3,) the origin from which they were cast, m.
        cutoff: longest range, m; longer ones become -1.

    Returns:
        Indices of the rays that meet their surface at too flat an angle for this.
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
        # At a flat angle a small offset is a long way along the ray, past the surface's edge.
        if abs(along) < _GRAZING or abs(off) > _FAR_M:
            flat[count] = i
            count += 1
        else:
            ranges[i] -= off / along
            if ranges[i] > cutoff:
                ranges[i] = -1.0
    return flat[:count]
