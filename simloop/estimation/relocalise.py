"""Where in its own map a lost robot stands: every free place and heading is tried, and proven.

A coarse search over the whole map (Olson 2009, without his pyramid) gives a handful of candidates;
the scan matcher refines each; and what stands in the end must explain the scan, see through
nothing that the map knows to be solid, and be better than any other place by far: a robot that
finds itself where it is not is worse off than one that knows that it is lost.

The interface is narrow on purpose: a map as the planner sees it, a scan's points, a function that
refines; a pose comes out, or nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, PoseFix

_STEP_M, _STEP_RAD = 0.1, 2.0 * math.pi / 72
_SPREAD_M = 0.12  # of the likelihood: half the steps, at a few metres
_POINTS = 60
_ROOM_M = 0.2  # the robot's centre is never nearer to anything
_CANDIDATES = 12
_APART_M, _APART_RAD = 0.3, 0.3
_NEAR_M = 0.1  # a point is explained by a surface this near
_SHORT_M = 0.2  # of its end a beam's way must be free
_LEAST_EXPLAINED = 0.75
_LEAST_LEAD = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class SearchMap:
    """distance_m: (rows, cols) float32 to the nearest surface; free: (rows, cols) bool, seen to be.

    Cell (0, 0) has its lower left corner at origin_m (2,).
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
    """(places, headings) mean likelihood of points (n, 2), seen from each place in each heading."""
    out = np.zeros((places.shape[0], headings.shape[0]))
    rows, cols = likelihood.shape
    for h in range(headings.shape[0]):
        cos, sin = math.cos(headings[h]), math.sin(headings[h])
        for k in range(points.shape[0]):
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
    """Share of points (n, 2) that lie by a surface, less the share of beams that cross one."""
    rows, cols = distance.shape
    cos, sin, good = math.cos(pose[2]), math.sin(pose[2]), 0
    for i in range(points.shape[0]):
        dx = cos * points[i, 0] - sin * points[i, 1]
        dy = sin * points[i, 0] + cos * points[i, 1]
        col = math.floor((pose[0] + dx - x0) / resolution)
        row = math.floor((pose[1] + dy - y0) / resolution)
        if 0 <= row < rows and 0 <= col < cols and distance[row, col] < _NEAR_M:
            good += 1
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
    """The most likely poses (3,) in the whole map, best first, all well apart."""
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
    for k in np.argsort(-scores, kind="stable")[: 40 * _CANDIDATES]:
        place, heading = divmod(int(k), len(headings))
        pose = np.array([*places[place], wrap_angle(headings[heading])])
        if not any(same_place(pose, other) for other in found):
            found.append(pose)
            if len(found) == _CANDIDATES:
                break
    return found


def same_place(a: FloatArray, b: FloatArray) -> bool:
    """Whether two poses (3,) are candidates for one and the same."""
    return math.dist(a[:2], b[:2]) < _APART_M and abs(wrap_angle(a[2] - b[2])) < _APART_RAD


def relocalise(
    points: FloatArray, where: SearchMap, refine: Callable[[FloatArray], PoseFix]
) -> PoseFix | None:
    """The one pose in the map that explains points (n, 2) in base_link; None where none is sure.

    refine: the scan matcher, from a candidate's pose (3,).
    """
    points = np.ascontiguousarray(points)
    ranked: list[tuple[float, PoseFix]] = []
    for candidate in candidates(points, where):
        fix = refine(candidate)
        if fix.ok:
            share = explained(
                points, fix.pose, where.distance_m, *where.origin_m.tolist(), where.resolution_m
            )
            ranked.append((share, fix))
    ranked.sort(key=lambda pair: -pair[0])
    if not ranked or ranked[0][0] < _LEAST_EXPLAINED:
        return None
    best = ranked[0][1]
    rival = next((s for s, fix in ranked if not same_place(fix.pose, best.pose)), 0.0)
    return best if ranked[0][0] - rival >= _LEAST_LEAD else None
