"""The plain shortest path: the whole tangent graph at once, then Dijkstra. The oracle in tests.

The result is exact except for rounding. Each convex outline, grown by the robot's radius, is
bounded by arcs about its vertices and by edges that are tangents of two such arcs. A shortest path
among grown outlines consists only of common tangents and arcs (the tangent graph), so Dijkstra's
algorithm on that graph finds it.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.worlds.floor_plan import FloorPlan, outline_edges, segment_distances

_SLACK_M = 1e-6
"""Tolerance of distances, because a tangent touches its own circle."""
_ARC_STEP_RAD = math.radians(2.0)
_BATCH = 4096


@dataclass(frozen=True, slots=True, eq=False)
class ShortestPath:
    """A shortest path.

    Attributes:
        length_m: Its exact length, m.
        xy_m: (N, 2) its points in map, m; arcs are sampled every two degrees.
    """

    length_m: float
    xy_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Circles:
    """The circles that a path can follow, one around each vertex of an outline.

    Attributes:
        centre_m: (N, 2) centres in map, m.
        radius_m: (N,) radii, m.
        to_next: (N, 2) vector to the next vertex of the outline, m; zero if there is none. With
            ``to_previous`` it bounds the part of the circle that is free.
        to_previous: (N, 2) vector to the previous vertex, m.
    """

    centre_m: FloatArray
    radius_m: FloatArray
    to_next: FloatArray
    to_previous: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Tangents:
    """Directed common tangents of two circles.

    Attributes:
        tail: (T,) circle that the tangent leaves.
        head: (T,) circle that it reaches.
        tail_sense: (T,) direction of the path on the tail, +1 counter-clockwise, -1 clockwise.
        head_sense: (T,) the same for the head.
        start_m: (T, 2) point where it leaves the tail, in map, m.
        end_m: (T, 2) point where it reaches the head, in map, m.
    """

    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    tail_sense: NDArray[np.int64]
    head_sense: NDArray[np.int64]
    start_m: FloatArray
    end_m: FloatArray


def shortest_path(
    plan: FloorPlan, start_m: FloatArray, goal_m: FloatArray, radius_m: float
) -> ShortestPath | None:
    """Find the shortest path on which a disc touches no obstacle.

    Args:
        plan: The true floor plan.
        start_m: (2,) centre of the disc at the start, in map, m.
        goal_m: (2,) centre of the disc at the goal, in map, m.
        radius_m: Radius of the disc.

    Returns:
        The path of the disc's centre; None if there is none, or if the start or the goal is nearer
        to an obstacle than the radius.
    """
    ends = np.array([start_m[:2], goal_m[:2]], dtype=np.float64)
    free_m = float(plan.clearance_m(ends).min())
    if free_m < radius_m - _SLACK_M:
        return None
    # Rounding may put an end inside a grown outline. It then has no tangents, so shrink the disc.
    radius_m = min(radius_m, free_m - 0.1 * _SLACK_M)
    if np.array_equal(ends[0], ends[1]):
        return ShortestPath(0.0, ends)
    circles = _circles(plan, ends, radius_m)
    return _search(plan, circles, _free_tangents(plan, circles, radius_m), radius_m)


def _circles(plan: FloorPlan, ends: FloatArray, radius_m: float) -> _Circles:
    """List the circles: 0 is the start and 1 the goal, both of radius 0, then the vertices."""
    centres, radii = [ends], [np.zeros(2)]
    following, preceding = [np.zeros((2, 2))], [np.zeros((2, 2))]
    for section in plan.sections:
        vertices = section.vertices_m
        centres.append(vertices)
        radii.append(np.full(len(vertices), section.radius_m + radius_m))
        following.append(np.roll(vertices, -1, axis=0) - vertices)
        preceding.append(np.roll(vertices, 1, axis=0) - vertices)
    return _Circles(
        np.concatenate(centres),
        np.concatenate(radii),
        np.concatenate(following),
        np.concatenate(preceding),
    )


def _free_tangents(plan: FloorPlan, circles: _Circles, radius_m: float) -> _Tangents:
    """Find all common tangents of two circles along which the disc touches no obstacle."""
    # Every ordered pair of circles, except into the start and out of the goal.
    tail, head = np.nonzero(~np.eye(len(circles.radius_m), dtype=bool))
    into_or_out = (head != 0) & (tail != 1)
    tail, head = tail[into_or_out], head[into_or_out]
    found = [
        _tangents(circles, tail, head, tail_sense, head_sense)
        for tail_sense in (1, -1)
        for head_sense in (1, -1)
    ]
    joined = [np.concatenate(columns) for columns in zip(*found, strict=True)]
    tail, head, tail_sense, head_sense, start_m, end_m = joined
    # First the cheap test of the ends, then the exact test of the whole tangent. Batches keep the
    # table of tangents and edges small.
    near = radius_m - _SLACK_M
    free = (plan.clearance_m(start_m) >= near) & (plan.clearance_m(end_m) >= near)
    index = np.flatnonzero(free)
    edges_m, swell_m = outline_edges(plan.sections)
    for batch in np.array_split(index, max(1, math.ceil(len(index) / _BATCH))):
        distance = segment_distances(start_m[batch], end_m[batch], edges_m[:, 0], edges_m[:, 1])
        free[batch] = np.all(distance - swell_m >= near, axis=1)
    return _Tangents(
        tail[free], head[free], tail_sense[free], head_sense[free], start_m[free], end_m[free]
    )


def _tangents(
    circles: _Circles,
    tail: NDArray[np.int64],
    head: NDArray[np.int64],
    tail_sense: int,
    head_sense: int,
) -> tuple[NDArray[np.int64], ...]:
    """Find the tangents with one pair of senses that touch both outlines at a vertex.

    Let u be the tangent's direction and n the normal to its right. A circle (c, r) that the
    path follows with sense s is touched at c + s r n. Both touching points are on one line
    along u if |c2 - c1| sin(angle of u against c2 - c1) = s1 r1 - s2 r2.
    """
    # A point has no sense: start and goal are used with sense +1 only.
    keep = ((tail != 0) | (tail_sense > 0)) & ((head != 1) | (head_sense > 0))
    tail, head = tail[keep], head[keep]
    apart = circles.centre_m[head] - circles.centre_m[tail]
    distance = np.hypot(apart[:, 0], apart[:, 1])
    offset = tail_sense * circles.radius_m[tail] - head_sense * circles.radius_m[head]
    # Circles that touch from inside (for example a start on an arc) have a tangent of length 0.
    keep = (distance > 0.0) & (distance > np.abs(offset) - _SLACK_M)
    tail, head, apart = tail[keep], head[keep], apart[keep]
    lean = np.arcsin(np.clip(offset[keep] / distance[keep], -1.0, 1.0))
    heading = np.arctan2(apart[:, 1], apart[:, 0]) + lean
    right = np.stack([np.sin(heading), -np.cos(heading)], axis=1)
    # A touching point is on the outline only if its normal is between those of the two edges.
    ends = []
    keep = np.ones(len(tail), dtype=bool)
    for circle, sense in ((tail, tail_sense), (head, head_sense)):
        normal = sense * right
        for side in (circles.to_next[circle], circles.to_previous[circle]):
            keep &= np.sum(normal * side, axis=1) <= 1e-9
        ends.append(circles.centre_m[circle] + circles.radius_m[circle, None] * normal)
    senses = (np.full(len(tail), tail_sense)[keep], np.full(len(tail), head_sense)[keep])
    return tail[keep], head[keep], *senses, ends[0][keep], ends[1][keep]


def _search(
    plan: FloorPlan, circles: _Circles, tangents: _Tangents, radius_m: float
) -> ShortestPath | None:
    """Build the tangent graph. Its nodes are the tangents' ends, its links tangents and arcs."""
    count = len(tangents.tail)
    if not count:
        return None
    # Node 2 t is the start of tangent t, node 2 t + 1 its end.
    links: dict[int, list[tuple[int, float, FloatArray]]] = defaultdict(list)
    lengths = np.hypot(*(tangents.end_m - tangents.start_m).T)
    for t in range(count):
        links[2 * t].append((2 * t + 1, float(lengths[t]), tangents.end_m[t : t + 1]))
    for node, after, length, points in _arcs(plan, circles, tangents, radius_m):
        links[node].append((after, length, points))
    sources = [2 * int(t) for t in np.flatnonzero(tangents.tail == 0)]
    targets = {2 * int(t) + 1 for t in np.flatnonzero(tangents.head == 1)}
    return _dijkstra(links, sources, targets, circles.centre_m[0])


def _dijkstra(
    links: dict[int, list[tuple[int, float, FloatArray]]],
    sources: list[int],
    targets: set[int],
    start_m: FloatArray,
) -> ShortestPath | None:
    """Run Dijkstra's algorithm (1959) from several sources to the nearest of several targets."""
    best = dict.fromkeys(sources, 0.0)
    came: dict[int, tuple[int, FloatArray]] = {}
    queue = [(0.0, node) for node in sources]
    heapq.heapify(queue)
    while queue:
        cost, node = heapq.heappop(queue)
        if cost > best[node]:
            continue  # an older, longer way to this node
        if node in targets:
            # Follow the links back and join their points.
            points = []
            while node in came:
                node, leg = came[node]
                points.append(leg)
            return ShortestPath(cost, np.concatenate([start_m[None], *reversed(points)]))
        for after, length, leg in links[node]:
            if cost + length < best.get(after, math.inf):
                best[after] = cost + length
                came[after] = (node, leg)
                heapq.heappush(queue, (cost + length, after))
    return None


def _arcs(
    plan: FloorPlan, circles: _Circles, tangents: _Tangents, radius_m: float
) -> list[tuple[int, int, float, FloatArray]]:
    """List the free arcs between neighbouring ends of tangents: node, next node, length, points.

    For each circle and sense, the ends are sorted by angle, and each is linked to the next one.
    """
    ends: dict[tuple[int, int], list[tuple[float, int]]] = defaultdict(list)
    for t in range(len(tangents.tail)):
        for node, circle, sense, point in (
            (2 * t, int(tangents.tail[t]), int(tangents.tail_sense[t]), tangents.start_m[t]),
            (2 * t + 1, int(tangents.head[t]), int(tangents.head_sense[t]), tangents.end_m[t]),
        ):
            if circle > 1:
                dx, dy = point - circles.centre_m[circle]
                ends[circle, sense].append((sense * math.atan2(dy, dx), node))
    arcs = []
    for (circle, sense), around in ends.items():
        around.sort()
        radius, centre = float(circles.radius_m[circle]), circles.centre_m[circle]
        for (angle, node), (to, after) in zip(around, around[1:] + around[:1], strict=True):
            swept = (to - angle) % (2.0 * math.pi)
            steps = max(2, math.ceil(swept / _ARC_STEP_RAD) + 1)
            turned = sense * (angle + np.linspace(0.0, swept, steps))
            points = centre + radius * np.stack([np.cos(turned), np.sin(turned)], axis=1)
            if np.all(plan.clearance_m(points) >= radius_m - _SLACK_M):
                arcs.append((node, after, radius * swept, points[1:]))
                if swept == 0.0:  # both ends are one point, so the link goes both ways
                    arcs.append((after, node, 0.0, points[1:]))
    return arcs
