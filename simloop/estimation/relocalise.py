"""Find a lost robot in a known map: candidates from the whole map, each refined and verified.

``best_place`` is the search that every relocaliser shares. Candidates come best first; the scan
matcher refines each; a check against the whole map scores the refined pose. The result is believed
only if it fits, and if no other place comes near it: a robot that takes a wrong place for true is
worse off than one that knows that it is lost.

``relocalise`` is the search of the closed loop, with one scan. Its candidates are free places on a
lattice, in every heading (Olson 2009, without his pyramid). A pose must explain the scan without
looking through anything that the map knows to be solid. The mapper over long ways brings its own
candidates and its own check (``graph_slam.map_localiser``).
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

_STEP_M, _STEP_RAD = 0.1, 2.0 * math.pi / 72  # of the lattice of candidates
_SPREAD_M = 0.12  # of the likelihood of a hit: half the steps, at a few metres
_POINTS = 60  # of the scan that the coarse scores use
_ROOM_M = 0.2  # the robot's centre is never nearer to anything
_CANDIDATES = 12
_TRIED = 40  # lattice poses looked at for each candidate, since many are next to one another
_APART_M, _APART_RAD = 0.3, 0.3  # poses nearer than that are one and the same place
_NEAR_M = 0.1  # a surface this near explains a point
_SHORT_M = 0.2  # up to this far from its end a beam's way must be free
_LEAST_EXPLAINED = 0.75  # share of the points, less the share of beams that cross a surface
_LEAST_LEAD = 0.08  # of that share over the best other place

Found = TypeVar("Found")


@dataclass(frozen=True, slots=True, eq=False)
class Place(Generic[Found]):
    """A candidate after refinement.

    Attributes:
        cost: How much speaks against it; the least is the best.
        fits: Whether it may be believed, if no other comes near it.
        found: What the refinement found there.
    """

    cost: float
    fits: bool
    found: Found


def best_place(
    places: Iterable[Place[Found]], is_clear: Callable[[Place[Found], Place[Found]], bool]
) -> Found | None:
    """Return the one place that fits and that no other comes near.

    Args:
        places: The refined candidates, in the order in which they were found.
        is_clear: Whether the best place, given first, is clearly better than another one. It must
            be true for a place that is really the same.

    Returns:
        What was found at the best place. None if there is none, it does not fit, or another is
        about as good.
    """
    ranked = sorted(places, key=lambda place: place.cost)
    if not ranked or not ranked[0].fits:
        return None
    best = ranked[0]
    return best.found if all(is_clear(best, other) for other in ranked[1:]) else None


@dataclass(frozen=True, slots=True, eq=False)
class SearchMap:
    """A map to search in, as a planner sees it; all arrays are [iy, ix].

    Attributes:
        origin_m: (2,) lower left corner of the first cell in map, m.
        resolution_m: Side of a cell, m.
        distance_m: (rows, cols) from a cell's centre to the nearest surface, m.
        free: (rows, cols) whether a cell was seen to be free.
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
    """Score every place in every heading by the mean likelihood of a scan's points there.

    Args:
        points: (n, 2) in base_link, m.
        places: (p, 2) of base_link in map, m.
        headings: (h,) rad.
        likelihood: (rows, cols) of a hit in each cell.
        x0: x of the grid's lower left corner, m.
        y0: y of it, m.
        resolution: Side of a cell, m.

    Returns:
        (p, h) mean likelihoods; points outside the grid count as 0.
    """
    out = np.zeros((places.shape[0], headings.shape[0]))
    rows, cols = likelihood.shape
    for h in range(headings.shape[0]):
        cos, sin = math.cos(headings[h]), math.sin(headings[h])
        for k in range(points.shape[0]):
            # Turned once for all places, which only shift it.
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
    """Return how much of a scan a pose explains.

    Args:
        points: (n, 2) in base_link, m.
        pose: (3,) x, y, yaw of base_link in map.
        distance: (rows, cols) from a cell's centre to the nearest surface, m.
        x0: x of the grid's lower left corner, m.
        y0: y of it, m.
        resolution: Side of a cell, m.

    Returns:
        Share of the points that lie by a surface, less the share of beams that cross one.
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
        # Walk along the beam, a cell a step, to a little before its end.
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
        Poses (3,) x, y, yaw of base_link in map, best first, no two at the same place.
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
    """Return whether two poses count as one and the same place.

    Args:
        a: (3,) x, y, yaw, m and rad.
        b: (3,) another one.

    Returns:
        True if they are near each other in place and in heading.
    """
    return math.dist(a[:2], b[:2]) < _APART_M and abs(wrap_angle(a[2] - b[2])) < _APART_RAD


def relocalise(
    points: FloatArray, where: SearchMap, refine: Callable[[FloatArray], PoseFix]
) -> PoseFix | None:
    """Find a scan in the whole map.

    Args:
        points: (n, 2) its hits in base_link, m.
        where: The map.
        refine: The scan matcher, from a candidate's pose (3,).

    Returns:
        The match at the one place that explains the scan; None if there is no such place, or
        more than one.
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
