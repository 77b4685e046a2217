"""Feasibility: whether the goal can be reached at all, and whether the path ahead is still free.

Unknown space counts as free. The goal is therefore given up only if known surfaces enclose it or
cover it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy import ndimage

from simloop.messages import FloatArray, WorldView

_TIMES = 3  # consecutive plans that must find the goal closed off
_FOR_NS = 3_000_000_000  # time that they must span: a passing mover does not close the goal off


def is_closed_off(
    view: WorldView, place: FloatArray, goal: FloatArray, tolerance_m: float, half_width_m: float
) -> bool:
    """Tell whether known obstacles separate a place from the goal.

    A disc must find a way through free and unknown cells, inside the view or around it.

    Args:
        view: What is known of the world.
        place: (2+,) position of the robot, in map, m.
        goal: (2,) in map, m.
        tolerance_m: Distance from the goal that counts as arrived, m.
        half_width_m: Radius of the disc, m.

    Returns:
        True if there is no way.
    """
    rows, cols = view.distance_m.shape
    if rows == 0 or cols == 0:
        return False
    free = np.pad(view.distance_m >= half_width_m, 1, constant_values=True)  # free outside the view
    # The robot's own place counts as free, even if it is close to an obstacle.
    reach = max(tolerance_m, view.resolution_m)
    own = _within(view, place[:2], half_width_m)
    free |= own
    labels = np.asarray(ndimage.label(free)[0])
    there = _within(view, goal, reach)
    mine = set(np.unique(labels[own & free]).tolist()) - {0}
    return mine.isdisjoint(np.unique(labels[there & free]).tolist())


def _within(view: WorldView, place: FloatArray, radius_m: float) -> np.ndarray:
    """Mark the cells of the padded view whose centre is near a place (2,).

    Returns (rows + 2, cols + 2) bool. The nearest cell is always marked.
    """
    rows, cols = view.distance_m.shape
    x = view.origin_m[0] + (np.arange(-1, cols + 1) + 0.5) * view.resolution_m
    y = view.origin_m[1] + (np.arange(-1, rows + 1) + 0.5) * view.resolution_m
    square = (x - place[0])[None, :] ** 2 + (y - place[1])[:, None] ** 2
    return np.asarray(square <= max(radius_m**2, float(square.min())))


class Feasibility:
    """Counts how many plans in a row, and for how long, have found the goal closed off."""

    def __init__(self, tolerance_m: float, width_m: float) -> None:
        self._tolerance_m, self._half_width_m = tolerance_m, 0.45 * width_m
        self._count, self._since_ns = 0, 0
        self.hopeless = False

    def update(self, view: WorldView, place: FloatArray, goal: FloatArray, safe: bool) -> bool:
        """Take the view of a new plan into account.

        Args:
            view: What is known of the world.
            place: (2+,) position of the robot, in map, m.
            goal: (2,) in map, m.
            safe: Whether the plan is safe.

        Returns:
            True if the goal is given up from now on.
        """
        closed = not safe and is_closed_off(
            view, place, goal, self._tolerance_m, self._half_width_m
        )
        self._since_ns = self._since_ns if self._count and closed else view.t_ns
        self._count = self._count + 1 if closed else 0
        was = self.hopeless
        self.hopeless |= self._count >= _TIMES and view.t_ns - self._since_ns >= _FOR_NS
        return self.hopeless and not was


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
    """Tell whether new surfaces in the map come too near to the path ahead.

    Each scan makes only a few cells occupied. Checking their distance to the path is about a
    thousand times cheaper than a new distance field of the whole map. It misses nothing: an
    obstacle that was not in the planner's view lies in a cell that became occupied later.

    Args:
        surfaces: (k, 2) new surface points, in map, m.
        xy: (n, 2) the path's samples, in map, m.
        yaw: (n,) their headings, rad.
        clearance: (n,) their planned clearances, m.
        first: Index of the first sample to check.
        offsets: (d,) centres of the footprint's discs along the heading, m.
        limit: A distance from a disc's centre below this is too near, m.
        slack: A clearance counts only if it is less than planned by more than this, m.

    Returns:
        True if the path is blocked.
    """
    # No disc's centre is farther than this from its sample, which rules out most samples.
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
