"""Find the shortest safe path in the true floor plan, the reference for the path of a run.

The result is exact except for rounding. Each convex outline, grown by the robot's radius, is
bounded by arcs about its vertices and by edges that are tangents of two such arcs. A shortest path
among grown outlines consists only of common tangents and arcs (the tangent graph). A* (Hart,
Nilsson & Raphael 1968) finds it. The tangents that leave a circle are computed when the search
arrives there, so that a map of thousands of boxes takes seconds and not all memory.
"""

from __future__ import annotations

import heapq
import math
from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simloop.evaluation.tangent_kernel import Circles, leaving
from simloop.geometry.outline_distance import Index
from simloop.messages import FloatArray
from simloop.worlds.floor_plan import FloorPlan

_SLACK_M = 1e-6
"""Tolerance of distances, because a tangent touches its own circle."""
_ARC_STEP_RAD = math.radians(2.0)
_SAME_RAD = 1e-9  # two points of a circle that are nearer are one
_MOST_PAIRS = 50_000_000
"""Pairs of circles after which the search gives up, some 20 s of processor time."""
_NO_INDEX = Index(np.zeros(2), 1.0, (0, 0), np.zeros(1, np.int64), np.zeros(0, np.int32))


class TooManyCornersError(ValueError):
    """Error for a floor plan on which the search for the shortest path would take too long."""


@dataclass(frozen=True, slots=True, eq=False)
class ShortestPath:
    """A shortest path.

    Attributes:
        length_m: Its exact length, m.
        xy_m: (N, 2) its points in map, m; arcs are sampled every two degrees.
    """

    length_m: float
    xy_m: FloatArray


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

    Raises:
        TooManyCornersError: The search was given up.
    """
    ends = np.array([start_m[:2], goal_m[:2]], dtype=np.float64)
    free_m = float(plan.clearance_m(ends).min())
    if free_m < radius_m - _SLACK_M:
        return None
    # Rounding may put an end inside a grown outline. It then has no tangents, so shrink the disc.
    radius_m = min(radius_m, free_m - 0.1 * _SLACK_M)
    if np.array_equal(ends[0], ends[1]):
        return ShortestPath(0.0, ends)
    return _Search(plan, _circles(plan, ends, radius_m), radius_m).run()


def _circles(plan: FloorPlan, ends: FloatArray, radius_m: float) -> Circles:
    """List the circles: 0 is the start and 1 the goal, both of radius 0, then the vertices."""
    centres, radii = [ends], [np.zeros(2)]
    following, preceding = [np.zeros((2, 2))], [np.zeros((2, 2))]
    for section in plan.sections:
        vertices = section.vertices_m
        centres.append(vertices)
        radii.append(np.full(len(vertices), section.radius_m + radius_m))
        following.append(np.roll(vertices, -1, axis=0) - vertices)
        preceding.append(np.roll(vertices, 1, axis=0) - vertices)
    return Circles(
        np.concatenate(centres),
        np.concatenate(radii),
        np.concatenate(following),
        np.concatenate(preceding),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Departures:
    """The free tangents that leave a circle in one sense, by the angle at which they leave.

    Attributes:
        angles: Angles in the direction of the path, rad, in ascending order from -pi.
        heads: (T, 2) circle and sense that each of them reaches.
        ends_m: (T, 4) its ends x, y, x, y in map, m.
        arcs: Arc from each of them to the next, once it was needed; None if it is blocked.
    """

    angles: list[float]
    heads: NDArray[np.int64]
    ends_m: FloatArray
    arcs: dict[int, FloatArray | None] = field(default_factory=dict)


_Node = tuple[int, int, int]
"""Circle, sense, and the number of the departure from there; the goal is (1, 1, 0)."""


class _Search:
    """A* over the departures of all circles."""

    def __init__(self, plan: FloorPlan, circles: Circles, radius_m: float) -> None:
        self._plan, self._circles, self._radius_m = plan, circles, radius_m
        self._heads = self._reachable()
        self._known: dict[tuple[int, int], _Departures] = {}
        self._pairs = 0
        self._best: dict[_Node, float] = {}
        self._came: dict[_Node, tuple[_Node, FloatArray]] = {}
        self._queue: list[tuple[float, float, _Node]] = []

    def run(self) -> ShortestPath | None:
        """Find the path from circle 0 to circle 1."""
        origin = self._circles.centre_m[0]
        start = (0, 1, -1)
        for number in range(len(self._departures(0, 1).angles)):
            self._offer(start, (0, 1, number), 0.0, origin[None, :], origin)
        while self._queue:
            _, cost, node = heapq.heappop(self._queue)
            if cost > self._best[node]:
                continue  # an older, longer way to this node
            if node[0] == 1:
                return ShortestPath(cost, self._points(node))
            self._expand(node, cost)
        return None

    def _points(self, node: _Node) -> FloatArray:
        """Follow the links back and join their points."""
        points = []
        while node in self._came:
            node, leg = self._came[node]
            points.append(leg)
        return np.concatenate(points[::-1])

    def _expand(self, node: _Node, cost: float) -> None:
        circle, sense, number = node
        here = self._departures(circle, sense)
        # Along the tangent, and then along the arc to the next departure from the other circle.
        head, head_sense = map(int, here.heads[number])
        x0, y0, x1, y1 = here.ends_m[number].tolist()
        cost_there, end = cost + math.hypot(x1 - x0, y1 - y0), np.array([x1, y1])
        if head == 1:
            self._offer(node, (1, 1, 0), cost_there, end[None, :], end)
        else:
            self._arrive(node, (head, head_sense), end, cost_there)
        # Or on along the arc to the next departure from this one.
        if circle > 1 and len(here.angles) > 1:
            after, angle = (number + 1) % len(here.angles), here.angles[number]
            swept = (here.angles[after] - angle) % (2.0 * math.pi)
            if number not in here.arcs:
                place = here.ends_m[after, :2]
                here.arcs[number] = self._arc(circle, sense, angle, swept, place)
            arc = here.arcs[number]
            if arc is not None:
                length = float(self._circles.radius_m[circle]) * swept
                self._offer(node, (circle, sense, after), cost + length, arc, arc[-1])

    def _arrive(self, node: _Node, to: tuple[int, int], end_m: FloatArray, cost: float) -> None:
        """Go on from the end of a tangent to the next departure along the circle."""
        circle, sense = to
        there = self._departures(circle, sense)
        if not there.angles:
            return
        dx, dy = (end_m - self._circles.centre_m[circle]).tolist()
        angle = sense * math.atan2(dy, dx)
        after = bisect_left(there.angles, angle - _SAME_RAD) % len(there.angles)
        swept = (there.angles[after] - angle + _SAME_RAD) % (2.0 * math.pi) - _SAME_RAD
        swept = max(0.0, swept)
        arc = self._arc(circle, sense, angle, swept, there.ends_m[after, :2])
        if arc is not None:
            cost += float(self._circles.radius_m[circle]) * swept
            self._offer(node, (circle, sense, after), cost, np.vstack([end_m, arc]), arc[-1])

    def _offer(
        self, come_from: _Node, node: _Node, cost: float, leg_m: FloatArray, at_m: FloatArray
    ) -> None:
        """Put a node into the queue if this is the shortest way to it so far."""
        if cost < self._best.get(node, math.inf):
            self._best[node], self._came[node] = cost, (come_from, leg_m)
            to_go = math.dist(at_m, self._circles.centre_m[1])
            heapq.heappush(self._queue, (cost + to_go, cost, node))

    def _arc(
        self, circle: int, sense: int, angle: float, swept: float, end_m: FloatArray
    ) -> FloatArray | None:
        """Compute the points of an arc after its first one; None if it is blocked."""
        radius, centre = float(self._circles.radius_m[circle]), self._circles.centre_m[circle]
        steps = max(2, math.ceil(swept / _ARC_STEP_RAD) + 1)
        turned = sense * (angle + np.linspace(0.0, swept, steps))
        points = centre + radius * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        points[-1] = end_m
        free = np.all(self._plan.clearance_m(points) >= self._radius_m - _SLACK_M)
        return points[1:] if free else None

    def _departures(self, circle: int, sense: int) -> _Departures:
        """Find the free tangents that leave a circle, once."""
        found = self._known.get((circle, sense))
        if found is None:
            self._pairs += len(self._heads)
            if self._pairs > _MOST_PAIRS:
                raise TooManyCornersError(f"more than {_MOST_PAIRS:,} pairs of corners")
            one, plan = self._circles, self._plan
            heads, ends = leaving(
                circle, float(sense), self._heads, one, plan.outlines, plan.index or _NO_INDEX,
                self._radius_m - _SLACK_M, _SLACK_M,
            )  # fmt: skip
            off = ends[:, :2] - one.centre_m[circle]
            angles = sense * np.arctan2(off[:, 1], off[:, 0])
            order = np.argsort(angles, kind="stable")
            found = _Departures(angles[order].tolist(), heads[order], ends[order])
            self._known[circle, sense] = found
        return found

    def _reachable(self) -> NDArray[np.int64]:
        """List the goal and the circles of which some part is free."""
        one = self._circles
        count = math.ceil(2.0 * math.pi / _ARC_STEP_RAD)
        turned = 2.0 * math.pi * np.arange(count) / count
        around = np.stack([np.cos(turned), np.sin(turned)], axis=1)
        kept = [1]
        for circle in range(2, len(one.radius_m)):
            radius = one.radius_m[circle]
            # A point between two of these is nearer to one of them than half the step.
            least = self._radius_m - _SLACK_M - 0.5 * _ARC_STEP_RAD * radius
            outward = np.ones(count, np.bool_)
            for side in (one.to_next[circle], one.to_previous[circle]):
                outward &= around @ side <= _ARC_STEP_RAD * math.hypot(*side)
            points = one.centre_m[circle] + radius * around[outward]
            if np.any(self._plan.clearance_m(points) >= least):
                kept.append(circle)
        return np.array(kept, np.int64)
