"""Keep the outlines of meshes, so that equal meshes at other places of a world share them."""

from __future__ import annotations

import numpy as np

from simloop.messages import FloatArray
from simloop.worlds.gazebo.mesh_slice import outline_between
from simloop.worlds.gazebo.shapes import Shell

_DIGITS = 9  # of the tilt and of heights, m, that count as equal


class Outlines:
    """The outlines of all meshes of one world.

    An outline depends on the mesh, its scale, its tilt and its height. Its place and its yaw only
    move it.
    """

    def __init__(self) -> None:
        """Begin without outlines."""
        self._found: dict[tuple[object, ...], list[FloatArray] | None] = {}

    def between(self, shell: Shell, low_m: float, high_m: float) -> list[FloatArray] | None:
        """Compute the outline of a mesh between two heights.

        Args:
            shell: the mesh.
            low_m: the lower height in map, m.
            high_m: the upper height, m.

        Returns:
            Convex polygons (V, 2) in map, m, counter-clockwise; None if the outline is too
            intricate.
        """
        turn, tilt = _turn_and_tilt(shell.pose[:3, :3])
        low, high = low_m - float(shell.pose[2, 3]), high_m - float(shell.pose[2, 3])
        rounded = (np.round(tilt, _DIGITS) + 0.0).tobytes()  # no -0.0
        key = (shell.mesh, rounded, round(low, _DIGITS), round(high, _DIGITS))
        if key not in self._found:
            self._found[key] = outline_between(shell.local @ tilt.T, low, high)
        found = self._found[key]
        if found is None:
            return None
        return [part @ turn.T + shell.pose[:2, 3] for part in found]


def _turn_and_tilt(rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split a rotation (3, 3) into one in the plane (2, 2), and one (3, 3) that comes before it."""
    # Equal tilts choose the same axis, whatever the yaw. Two axes cannot both be upright.
    x, y = rotation[:2, 0 if np.hypot(*rotation[:2, 0]) > 0.5 else 1]
    length = float(np.hypot(x, y))
    turn = np.array([[x, -y], [y, x]]) / length
    tilt = rotation.copy()
    tilt[:2] = turn.T @ rotation[:2]
    return turn, tilt
