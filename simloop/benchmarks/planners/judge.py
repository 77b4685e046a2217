"""What a path is worth, whoever planned it: J, clearance and arrival from its waypoints alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simloop.bench_planners import path_cost
from simloop.benchmarks.planners.scenes import Instance, box_distance
from simloop.config import PlannerConfig
from simloop.messages import FloatArray
from simloop.planners.problem.clearance import SAFE_WITHIN_M
from simloop.planners.problem.objective import LEAST_INTRUSION_M

AT_GOAL_M = 1e-6
_SAMPLE_M = 1e-3
_CHUNK = 20_000


@dataclass(frozen=True, slots=True)
class Verdict:
    """cost: J of the path alone. score: J with what it lacks of clearance and of the way to the
    goal priced as the planners' objective prices it, so that an unsafe path never wins."""

    cost: float
    score: float
    length_m: float
    turning_rad: float
    safe: bool
    reached: bool

    @property
    def success(self) -> bool:
        """Safe from start to goal."""
        return self.safe and self.reached


def judge(instance: Instance, path: FloatArray) -> Verdict:
    """Look at a path (M, 2)."""
    weights = PlannerConfig()
    cost = path_cost(path)
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    turning = (cost - weights.length_weight * length) / weights.turning_weight
    left = float(np.hypot(*(path[-1] - instance.goal)))
    lack = max(0.0, instance.safe_m - clearance(instance, path))
    safe, reached = lack <= SAFE_WITHIN_M, left <= AT_GOAL_M
    score = cost
    if not safe:
        score += weights.penalty * (lack + LEAST_INTRUSION_M)
    if not reached:
        score += weights.penalty * left
    return Verdict(cost, score, length, turning, safe, reached)


def clearance(instance: Instance, path: FloatArray) -> float:
    """Least distance of a path (M, 2) from any obstacle, m; negative within a disc, 0 or less
    within a box or polygon. Exact among discs and polygons, sampled each mm among boxes."""
    a, b = path[:-1], path[1:]
    worst = np.inf
    discs = instance.world.discs_xyr_m
    if len(discs):
        worst = float((_to_segments(discs[:, :2], a, b) - discs[:, 2]).min())
    for polygon in instance.world.polygons_m:
        worst = min(worst, _polygon_clearance(polygon, a, b))
    if len(instance.boxes_m) and not instance.world.polygons_m:
        worst = min(worst, _box_clearance(instance, a, b))
    return worst


def _to_segments(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(S, N) distance of points (N, 2) to segments a-b (S, 2)."""
    step = b - a
    square = np.maximum((step**2).sum(axis=1), 1e-300)[:, None]
    from_a = points[None] - a[:, None]
    t = np.clip((from_a * step[:, None]).sum(axis=2) / square, 0.0, 1.0)
    off = from_a - t[..., None] * step[:, None]
    distance: FloatArray = np.hypot(off[..., 0], off[..., 1])
    return distance


def _polygon_clearance(polygon: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Of segments to one polygon (N, 2), any way round; 0 where one meets it."""
    c, d = polygon, np.roll(polygon, -1, axis=0)
    ends = np.concatenate([a, b[-1:]])
    if _inside(polygon, ends).any() or _cross(a, b, c, d).any():
        return 0.0
    return float(min(_to_segments(c, a, b).min(), _to_segments(ends, c, d).min()))


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> np.ndarray:
    """(S, N) whether segment a-b (S, 2) crosses edge c-d (N, 2)."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        u, v = q - p, r - p
        turn: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        return turn

    a, b, c, d = a[:, None], b[:, None], c[None], d[None]
    apart_1 = side(a, b, c) * side(a, b, d) < 0.0
    return np.asarray(apart_1 & (side(c, d, a) * side(c, d, b) < 0.0))


def _inside(polygon: FloatArray, points: FloatArray) -> np.ndarray:
    """(N,) whether points (N, 2) lie in a polygon, by counting its edges to their right."""
    c, d = polygon[None], np.roll(polygon, -1, axis=0)[None]
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (c[..., 1] > y) != (d[..., 1] > y)
    rise = np.where(spans, d[..., 1] - c[..., 1], 1.0)
    at = c[..., 0] + (y - c[..., 1]) / rise * (d[..., 0] - c[..., 0])
    return np.asarray((spans & (x < at)).sum(axis=1) % 2 == 1)


def _box_clearance(instance: Instance, a: FloatArray, b: FloatArray) -> float:
    """Of segments to the boxes near them; boxes beyond twice the safe distance do not matter."""
    boxes, reach, worst = instance.boxes_m, 2.0 * instance.safe_m, np.inf
    for p, q in zip(a, b, strict=True):
        low, high = np.minimum(p, q) - reach, np.maximum(p, q) + reach
        near = boxes[(boxes[:, 2:] >= low).all(axis=1) & (boxes[:, :2] <= high).all(axis=1)]
        if not len(near):
            worst = min(worst, reach)
            continue
        count = 2 + int(np.hypot(*(q - p)) / _SAMPLE_M)
        points = p + np.linspace(0.0, 1.0, count)[:, None] * (q - p)
        size = max(1, _CHUNK // len(near))
        for k in range(0, count, size):
            worst = min(worst, float(box_distance(near, points[k : k + size]).min()))
    return worst
