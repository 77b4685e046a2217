"""Tell which meshes the vehicle touches elsewhere than the LiDAR sees them."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

_SHARE = 0.98
"""A mesh with less than this share of its convex hull's volume counts as concave."""


def is_concave(model: mujoco.MjModel, geom: int) -> bool:
    """Tell whether the mesh of a geom differs from its convex hull.

    MuJoCo's contacts are with the convex hull, and its rays meet the mesh itself.

    Args:
        model: the compiled arena.
        geom: number of a geom.

    Returns:
        True for a concave mesh; False for a convex one, and for all other geoms.
    """
    if int(model.geom_type[geom]) != int(mujoco.mjtGeom.mjGEOM_MESH):
        return False
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = np.array(model.mesh_vert[first : first + count], np.float64)
    start, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = points[model.mesh_face[start : start + faces]]
    volume = float(np.linalg.det(corners).sum()) / 6.0
    try:
        return abs(volume) < _SHARE * ConvexHull(points).volume
    except (QhullError, ValueError):
        return False
