"""The exact optimum among discs without compiled code: the oracle of `reference.exact`."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.reference.exact import ExactPath

_TOUCH_M = 1e-9
_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class _Tangents:
    """Directed tangents as columns of equal length E. Circle 0 is the start, circle 1 the goal.

    Attributes:
        tail: (E,) circle that the tangent leaves.
        tail_sense: (E,) sense about that circle: 1 counter-clockwise, -1 clockwise.
        head: (E,) circle that it reaches.
        head_sense: (E,) sense about that circle.
        heading: (E,) direction, rad, map frame.
        a: (E, 2) first point, m, map frame.
        b: (E, 2) last point, m, map frame.
    """

    tail: NDArray[np.int64]
    tail_sense: NDArray[np.int64]
    head: NDArray[np.int64]
    head_sense: NDArray[np.int64]
    heading: FloatArray
    a: FloatArray
    b: FloatArray


def _tangents(centre: FloatArray, radius: FloatArray, bounds: FloatArray) -> _Tangents:
    """Compute all directed tangents that cross no circle and stay within the bounds."""
    n = len(radius)
    senses = np.array([-1, 1])
    i, si, j, sj = (
        g.ravel() for g in np.meshgrid(np.arange(n), senses, np.arange(n), senses, indexing="ij")
    )
    # Start and goal are circles of radius 0, so one sense is enough for them. No tangent leads into
    # the start or out of the goal.
    keep = (i != j) & (i != 1) & (j != 0) & ((i != 0) | (si == 1)) & ((j != 1) | (sj == 1))
    i, si, j, sj = i[keep], si[keep], j[keep], sj[keep]
    between = centre[j] - centre[i]
    apart = np.hypot(between[:, 0], between[:, 1])
    offset = sj * radius[j] - si * radius[i]
    # Nested circles have no tangents, and overlapping circles have no inner tangents.
    keep = apart > np.abs(offset)
    i, si, j, sj = i[keep], si[keep], j[keep], sj[keep]
    between, apart, offset = between[keep], apart[keep], offset[keep]
    run = np.sqrt(apart**2 - offset**2)
    heading = np.arctan2(between[:, 1], between[:, 0]) - np.arctan2(offset, run)
    # A counter-clockwise circle lies to the left of its tangent, so the point is on its right.
    left = np.column_stack([-np.sin(heading), np.cos(heading)])
    a = centre[i] - (si * radius[i])[:, None] * left
    b = centre[j] - (sj * radius[j])[:, None] * left
    free = np.ones(len(i), dtype=bool)
    square = np.maximum(((b - a) ** 2).sum(axis=1), 1e-300)
    # Free: the distance of the segment to every centre is no less than the radius.
    for c, r in zip(centre[2:], radius[2:], strict=True):
        t = np.clip(((c - a) * (b - a)).sum(axis=1) / square, 0.0, 1.0)
        gap = np.hypot(*(a + t[:, None] * (b - a) - c).T) - r
        free &= gap > -_TOUCH_M
    low, high = bounds[:2] - _TOUCH_M, bounds[2:] + _TOUCH_M
    free &= ((a >= low) & (a <= high) & (b >= low) & (b <= high)).all(axis=1)
    return _Tangents(i[free], si[free], j[free], sj[free], heading[free], a[free], b[free])


def _leaving(t: _Tangents) -> dict[tuple[int, int], list[int]]:
    """Map a circle and a sense to the tangents that leave the circle in this sense.

    They are the successors of the tangents that reach the circle in this sense.
    """
    leaving: dict[tuple[int, int], list[int]] = {}
    for e in range(len(t.tail)):
        leaving.setdefault((int(t.tail[e]), int(t.tail_sense[e])), []).append(e)
    return leaving


def _forbidden(
    k: int, centre: FloatArray, radius: FloatArray, bounds: FloatArray
) -> list[tuple[float, float]]:
    """Find the spans of circle k in another circle or out of bounds: (middle, half width), rad."""
    spans: list[tuple[float, float]] = []
    for j in range(2, len(radius)):
        away = centre[j] - centre[k]
        d = math.hypot(away[0], away[1])
        if j == k or d >= radius[k] + radius[j]:
            continue
        if d <= radius[j] - radius[k]:
            return [(0.0, math.pi)]
        if d <= radius[k] - radius[j]:
            continue
        # Law of cosines: half the angle between the two intersections.
        cosine = (d * d + radius[k] ** 2 - radius[j] ** 2) / (2.0 * d * radius[k])
        spans.append((math.atan2(away[1], away[0]), math.acos(min(1.0, max(-1.0, cosine)))))
    walls = (
        (0.0, bounds[2] - centre[k, 0]),
        (0.5 * math.pi, bounds[3] - centre[k, 1]),
        (math.pi, centre[k, 0] - bounds[0]),
        (-0.5 * math.pi, centre[k, 1] - bounds[1]),
    )
    for angle, room in walls:
        if room < radius[k]:
            spans.append((angle, math.acos(max(-1.0, room / radius[k]))))
    return spans


def _arc_free(spans: list[tuple[float, float]], first: float, sense: int, sweep: float) -> bool:
    """Whether an arc from angle ``first`` over ``sweep`` >= 0 in a given sense meets no span."""
    middle = first + 0.5 * sense * sweep
    for angle, half in spans:
        off = abs((angle - middle + math.pi) % _TURN - math.pi)
        if off < half + 0.5 * sweep - 1e-9:
            return False
    return True


def plain_exact_path(
    discs: FloatArray,
    bounds: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    *,
    safe_m: float,
    length_weight: float = 0.65,
    turning_weight: float = 0.35,
    arc_step_rad: float = 0.02,
) -> ExactPath | None:
    """Find the path of least J among discs.

    Args:
        discs: (K, 3) x, y, radius, m, map frame.
        bounds: (4,) x_min, y_min, x_max, y_max of the whole path, m, map frame.
        start: (>= 2,) x, y, m, map frame.
        goal: (>= 2,) x, y, m, map frame.
        safe_m: Distance that the path keeps from every disc, m.
        length_weight: w1, cost of a metre.
        turning_weight: w2, cost of a radian.
        arc_step_rad: Angle between the samples of an arc, rad.

    Returns:
        The best path; None if start and goal are not connected.
    """
    discs = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    centre = np.vstack([start[:2], goal[:2], discs[:, :2]])
    radius = np.concatenate([[0.0, 0.0], discs[:, 2] + safe_m])
    t = _tangents(centre, radius, np.asarray(bounds, dtype=np.float64))
    leaving = _leaving(t)
    length = np.hypot(*(t.b - t.a).T)
    best = np.full(len(length), np.inf)
    parent = np.full(len(length), -1)
    queue: list[tuple[float, int]] = []
    for e in leaving.get((0, 1), []):
        best[e] = length_weight * length[e]
        queue.append((float(best[e]), e))
    heapq.heapify(queue)
    spans = [_forbidden(k, centre, radius, bounds) if k > 1 else [] for k in range(len(radius))]
    while queue:
        cost, e = heapq.heappop(queue)
        if cost > best[e]:
            continue
        k, sense = int(t.head[e]), int(t.head_sense[e])
        if k == 1:
            return _unroll(t, parent, e, cost, centre, radius, arc_step_rad)
        for f in leaving.get((k, sense), []):
            sweep = (sense * (t.heading[f] - t.heading[e])) % _TURN
            # Rounding can turn an arc of no length into a full turn.
            sweep = 0.0 if sweep > _TURN - 1e-9 else sweep
            total = cost + (length_weight * radius[k] + turning_weight) * sweep
            total += length_weight * length[f]
            first = t.heading[e] - 0.5 * sense * math.pi
            if total < best[f] and _arc_free(spans[k], first, sense, sweep):
                best[f], parent[f] = total, e
                heapq.heappush(queue, (float(total), f))
    return None


def _unroll(
    t: _Tangents,
    parent: NDArray[np.int64],
    last: int,
    cost: float,
    centre: FloatArray,
    radius: FloatArray,
    arc_step: float,
) -> ExactPath:
    """Follow the parents back from the last tangent and sample the arcs between the tangents."""
    chain = [last]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    chain.reverse()
    points = [t.a[chain[0]]]
    length, turning = 0.0, 0.0
    for n, e in enumerate(chain):
        if n > 0:
            k, sense = int(t.tail[e]), int(t.tail_sense[e])
            sweep = (sense * (t.heading[e] - t.heading[chain[n - 1]])) % _TURN
            sweep = 0.0 if sweep > _TURN - 1e-9 else sweep
            first = t.heading[chain[n - 1]] - 0.5 * sense * math.pi
            for s in np.linspace(0.0, sweep, 2 + int(sweep / arc_step))[1:-1]:
                angle = first + sense * s
                points.append(centre[k] + radius[k] * np.array([math.cos(angle), math.sin(angle)]))
            length += radius[k] * sweep
            turning += sweep
            points.append(t.a[e])
        length += math.hypot(*(t.b[e] - t.a[e]))
        points.append(t.b[e])
    return ExactPath(np.array(points), float(cost), float(length), float(turning))
