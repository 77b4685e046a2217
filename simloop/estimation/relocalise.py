"""Find a lost robot in a known map: candidates from the whole map, each refined and verified.

``best_place`` makes the choice for every relocaliser. The scan matcher has refined each candidate,
and a check against the map gives its cost. The best place is accepted only if it fits and if no
other place is nearly as good: to accept a wrong place is worse than to stay lost.

``relocalise`` is the search of the closed loop, with one scan. Its candidates are free places on a
lattice, in every heading (Olson 2009, without the pyramid). A pose must explain the scan, and its
beams must not cross anything that the map shows as solid. The graph SLAM has its own candidates
and its own check (``graph_slam.map_localiser``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, PoseFix

_STEP_M, _STEP_RAD = 0.1, 2.0 * math.pi / 72  # steps of the lattice of candidates
_SPREAD_M = 0.12  # std of the likelihood of a hit: half the lattice steps, at a few metres
_POINTS = 60  # about how many points of the scan the coarse scores use
_ROOM_M = 0.2  # candidates are farther than this from any surface
_CANDIDATES = 12  # most candidates that are refined
_TRIED = 40  # lattice poses tried per candidate, because many are neighbours
_APART_M, _APART_RAD = 0.3, 0.3  # two poses nearer than this count as the same place
_NEAR_M = 0.1  # a surface nearer than this explains a point
_SHORT_M = 0.2  # a beam is not checked in this distance before its end
_LEAST_EXPLAINED = 0.75  # least ``explained`` share of a pose that is accepted
_LEAST_LEAD = 0.08  # the share must exceed that of every other place by this

Found = TypeVar("Found")


@dataclass(frozen=True, slots=True, eq=False)
class Place(Generic[Found]):
    """A candidate after refinement.

    Attributes:
        cost: Cost of the place; the least is the best.
        fits: Whether the place can be accepted, if no other is nearly as good.
        found: Result of the refinement.
    """

    cost: float
    fits: bool
    found: Found


def best_place(
    places: Iterable[Place[Found]], is_clear: Callable[[Place[Found], Place[Found]], bool]
) -> Found | None:
    """Return the place that fits, if no other place is nearly as good.

    Args:
        places: The refined candidates, in the order in which they were found.
        is_clear: Returns whether the best place (first argument) is clearly better than another
            one. It must return True if both are the same place.

    Returns:
        Result of the refinement at the best place. None if there is no place, the best one does
        not fit, or another one is nearly as good.
    """
    ranked = sorted(places, key=lambda place: place.cost)
    if not ranked or not ranked[0].fits:
        return None
    best = ranked[0]
    return best.found if all(is_clear(best, other) for other in ranked[1:]) else None


@dataclass(frozen=True, slots=True, eq=False)
class SearchMap:
    """Map for the search; all arrays are [iy, ix].

    Attributes:
        origin_m: (2,) lower left corner of the first cell in map, m.
        resolution_m: Side of a cell, m.
        distance_m: (rows, cols) from a cell's centre to the nearest surface, m.
        free: (rows, cols) whether a cell was seen free.
    """

    origin_m: FloatArray
    resolution_m: float
    distance_m: NDArray[np.float32]
    free: NDArray[np.bool_]


@njit(cache=True)
def score_everywhere(
    points: FloatArray,
    places: FloatArray,
    headings: FloatArray,
    likelihood: NDArray[np.float32],
    x0: float,
    y0: float,
    resolution: float,
) -> FloatArray:
    """Score every place in every heading by the mean likelihood of a scan's points.

    Args:
        points: (n, 2) in base_link, m.
        places: (p, 2) positions of base_link in map, m.
        headings: (h,) rad.
        likelihood: (rows, cols) likelihood of a hit in each cell.
        x0: x of the grid's lower left corner, m.
        y0: y of the grid's lower left corner, m.
        resolution: Side of a cell, m.

    Returns:
        (p, h) mean likelihoods; points outside the grid count as 0.
    """
    out = np.zeros((places.shape[0], headings.shape[0]))
    rows, cols = likelihood.shape
    for h in range(headings.shape[0]):
        cos, sin = math.cos(headings[h]), math.sin(headings[h])
        for k in range(points.shape[0]):
            # Rotate the point once; each place only shifts it.
            rx = cos * points[k, 0] - sin * points[k, 1] - x0
            ry = sin * points[k, 0] + cos * points[k, 1] - y0
            for p in range(places.shape[0]):
                col = math.floor((places[p, 0] + rx) / resolution)
                row = math.floor((places[p, 1] + ry) / resolution)
                if 0 <= row < rows and 0 <= col < cols:
                    out[p, h] += likelihood[row, col]
    return out / max(1, points.shape[0])


@njit(cache=True)
def explained(
    points: FloatArray,
    pose: FloatArray,
    distance: NDArray[np.float32],
    x0: float,
    y0: float,
    resolution: float,
) -> float:
    """Compute the share of a scan that a pose explains.

    Args:
        points: (n, 2) in base_link, m.
        pose: (3,) x, y, yaw of base_link in map.
        distance: (rows, cols) from a cell's centre to the nearest surface, m.
        x0: x of the grid's lower left corner, m.
        y0: y of the grid's lower left corner, m.
        resolution: Side of a cell, m.

    Returns:
        Share of the points near a surface, minus the share of the beams that cross one.
    """
    rows, cols = distance.shape
    cos, sin, good = math.cos(pose[2]), math.sin(pose[2]), 0
    for i in range(points.shape[0]):
        dx = cos * points[i, 0] - sin * points[i, 1]
        dy = sin * points[i, 0] + cos * points[i, 1]
        col = math.floor((pose[0] + dx - x0) / resolution)
        row = math.floor((pose[1] + dy - y0) / resolution)
        if 0 <= row < rows and 0 <= col < cols and distance[row, col] < _NEAR_M:
            good += 1
        # Walk along the beam in steps of a cell, and stop before its end.
        length = math.hypot(dx, dy)
        for step in range(1, math.floor((length - _SHORT_M) / resolution)):
            f = step * resolution / length
            col = math.floor((pose[0] + f * dx - x0) / resolution)
            row = math.floor((pose[1] + f * dy - y0) / resolution)
            if 0 <= row < rows and 0 <= col < cols and distance[row, col] < 0.5 * resolution:
                good -= 1
                break
    return good / max(1, points.shape[0])


def candidates(points: FloatArray, where: SearchMap) -> list[FloatArray]:
    """Return the most likely poses in the whole map.

    Args:
        points: (n, 2) a scan's hits in base_link, m.
        where: The map.

    Returns:
        Poses (3,) x, y, yaw of base_link in map, best first; no two are the same place.
    """
    every = max(1, round(_STEP_M / where.resolution_m))
    lattice = np.zeros(where.free.shape, bool)
    lattice[::every, ::every] = True
    rows, cols = np.nonzero(lattice & where.free & (where.distance_m > _ROOM_M))
    if not len(rows):
        return []
    places = where.origin_m + (np.stack((cols, rows), axis=1) + 0.5) * where.resolution_m
    headings = _STEP_RAD * np.arange(round(2.0 * math.pi / _STEP_RAD))
    few = np.ascontiguousarray(points[:: max(1, len(points) // _POINTS)])
    likelihood = np.exp(-0.5 * (where.distance_m / _SPREAD_M) ** 2).astype(np.float32)
    scores = score_everywhere(
        few, places, headings, likelihood, *where.origin_m.tolist(), where.resolution_m
    ).ravel()
    found: list[FloatArray] = []
    for k in np.argsort(-scores, kind="stable")[: _TRIED * _CANDIDATES]:
        place, heading = divmod(int(k), len(headings))
        pose = np.array([*places[place], wrap_angle(headings[heading])])
        if not any(same_place(pose, other) for other in found):
            found.append(pose)
            if len(found) == _CANDIDATES:
                break
    return found


def same_place(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two poses count as the same place.

    Args:
        a: (3,) x, y, yaw, m and rad.
        b: (3,) another pose.

    Returns:
        True if they are near each other in position and heading.
    """
    return math.dist(a[:2], b[:2]) < _APART_M and abs(wrap_angle(a[2] - b[2])) < _APART_RAD


def relocalise(
    points: FloatArray, where: SearchMap, refine: Callable[[FloatArray], PoseFix]
) -> PoseFix | None:
    """Search the whole map for a scan.

    Args:
        points: (n, 2) hits of the scan in base_link, m.
        where: The map.
        refine: The scan matcher; it starts from a candidate's pose (3,).

    Returns:
        The match at the only place that explains the scan. None if no place does, or several do.
    """
    points = np.ascontiguousarray(points)
    corner, resolution = where.origin_m.tolist(), where.resolution_m

    def places() -> Iterable[Place[PoseFix]]:
        for candidate in candidates(points, where):
            fix = refine(candidate)
            if fix.ok:
                share = explained(points, fix.pose, where.distance_m, *corner, resolution)
                yield Place(-share, share >= _LEAST_EXPLAINED, fix)

    def is_clear(best: Place[PoseFix], other: Place[PoseFix]) -> bool:
        lead = other.cost - best.cost
        return lead >= _LEAST_LEAD or same_place(best.found.pose, other.found.pose)

    return best_place(places(), is_clear)
