"""Judge: rate a planned path by its waypoints alone, with J, clearance and arrival at the goal.

The code is independent of the planners' kernels, so it can find their faults.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from simloop.benchmarks.planners.scenes import Instance, box_distance, true_clearance
from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray
from simloop.planners.problem.clearance import SAFE_WITHIN_M
from simloop.planners.problem.objective import LEAST_INTRUSION_M
from simloop.planners.protocol import PlanningTask
from simloop.planners.reference.exact import exact_path
from simloop.planners.registry import make_planner

PLANS = 1000
"""Number of plans for each scene when the lead planner is measured."""
PLANS_PRECISE = 200
"""Number of these plans with the precise setting."""
_CHECK_STEP_M = 1e-3
_POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
AT_GOAL_M = 1e-6
"""Distance from the goal within which a path counts as arrived, m."""
_SAMPLE_M = 1e-3
_CHUNK = 20_000  # samples x boxes in one chunk


@dataclass(frozen=True, slots=True)
class Verdict:
    """The rating of a path.

    Attributes:
        cost: J of the path alone.
        score: J plus the penalties of the planners' objective for missing clearance and for the
            distance left to the goal, so that an unsafe path never wins.
        length_m: Length, m.
        turning_rad: Summed turning, rad.
        safe: Whether the path keeps the safe distance, with the tolerance `SAFE_WITHIN_M`.
        reached: Whether it ends at the goal.
    """

    cost: float
    score: float
    length_m: float
    turning_rad: float
    safe: bool
    reached: bool

    @property
    def success(self) -> bool:
        """Whether the path is safe and reaches the goal."""
        return self.safe and self.reached


def judge(instance: Instance, path: FloatArray) -> Verdict:
    """Rate a path.

    Args:
        instance: The task.
        path: (M, 2) waypoints, m, map frame.

    Returns:
        The rating.
    """
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
    """Compute the least distance of a path from any obstacle.

    It is exact among discs and polygons, and sampled every millimetre among boxes.

    Args:
        instance: The task.
        path: (M, 2) waypoints, m, map frame.

    Returns:
        Distance, m; negative inside a disc, 0 inside a box or polygon. Among boxes it is at most
        twice the safe distance.
    """
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
    """Compute the distances (S, N) from points (N, 2) to segments a-b (S, 2), m."""
    step = b - a
    square = np.maximum((step**2).sum(axis=1), 1e-300)[:, None]
    from_a = points[None] - a[:, None]
    t = np.clip((from_a * step[:, None]).sum(axis=2) / square, 0.0, 1.0)
    off = from_a - t[..., None] * step[:, None]
    distance: FloatArray = np.hypot(off[..., 0], off[..., 1])
    return distance


def _polygon_clearance(polygon: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Compute the distance from segments to a polygon (N, 2), m; 0 if they meet."""
    c, d = polygon, np.roll(polygon, -1, axis=0)
    ends = np.concatenate([a, b[-1:]])
    if _inside(polygon, ends).any() or _cross(a, b, c, d).any():
        return 0.0
    return float(min(_to_segments(c, a, b).min(), _to_segments(ends, c, d).min()))


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> np.ndarray:
    """Tell which segments a-b (S, 2) cross which edges c-d (N, 2), as (S, N)."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        u, v = q - p, r - p
        turn: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        return turn

    a, b, c, d = a[:, None], b[:, None], c[None], d[None]
    apart_1 = side(a, b, c) * side(a, b, d) < 0.0
    return np.asarray(apart_1 & (side(c, d, a) * side(c, d, b) < 0.0))


def _inside(polygon: FloatArray, points: FloatArray) -> np.ndarray:
    """Tell which points (N, 2) are in a polygon, as (N,): an odd number of edges on their right."""
    c, d = polygon[None], np.roll(polygon, -1, axis=0)[None]
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (c[..., 1] > y) != (d[..., 1] > y)
    rise = np.where(spans, d[..., 1] - c[..., 1], 1.0)
    at = c[..., 0] + (y - c[..., 1]) / rise * (d[..., 0] - c[..., 0])
    return np.asarray((spans & (x < at)).sum(axis=1) % 2 == 1)


def _box_clearance(instance: Instance, a: FloatArray, b: FloatArray) -> float:
    """Compute the distance from segments to the boxes near them, by samples, m.

    Only boxes within twice the safe distance count.
    """
    boxes, reach, worst = instance.boxes_m, 2.0 * instance.safe_m, np.inf
    for p, q in zip(a, b, strict=True):
        low, high = np.minimum(p, q) - reach, np.maximum(p, q) + reach
        near = boxes[(boxes[:, 2:] >= low).all(axis=1) & (boxes[:, :2] <= high).all(axis=1)]
        if not len(near):
            worst = min(worst, reach)
            continue
        count = 2 + int(np.hypot(*(q - p)) / _SAMPLE_M)
        points = p + np.linspace(0.0, 1.0, count)[:, None] * (q - p)
        # Work in chunks, because the table of samples by boxes may not fit into memory.
        size = max(1, _CHUNK // len(near))
        for k in range(0, count, size):
            worst = min(worst, float(box_distance(near, points[k : k + size]).min()))
    return worst


@dataclass(slots=True)
class _Tally:
    """Samples from the plans of one planner on one scene.

    Attributes:
        ms: Planning times, ms.
        gap: Gaps of J over J*, %.
        safe: Whether each plan is safe.
        evaluations: Number of evaluations of each plan.
        spread: Standard deviation of J, one for each instance.
    """

    ms: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    safe: list[bool] = field(default_factory=list)
    evaluations: list[int] = field(default_factory=list)
    spread: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """Summarise the samples.

        Returns:
            Percentiles of times (ms) and gaps (%), share of safe plans, mean spread of J, mean
            evaluations, number of plans.
        """
        return {
            "ms_p50": float(np.percentile(self.ms, 50)),
            "ms_p99": float(np.percentile(self.ms, 99)),
            "gap_p50": float(np.percentile(self.gap, 50)),
            "gap_p95": float(np.percentile(self.gap, 95)),
            "safe": float(np.mean(self.safe)),
            "std": float(np.mean(self.spread)),
            "evaluations": float(np.mean(self.evaluations)),
            "plans": len(self.ms),
        }


def optimum(instance: Instance) -> float:
    """Compute the the optimum J* of an instance.

    Args:
        instance: A task with discs only, or one with a stored optimum.

    Returns:
        J*.

    Raises:
        ValueError: No path connects start and goal.
    """
    if instance.best_cost is not None:
        return instance.best_cost
    weights = PlannerConfig()
    best = exact_path(
        instance.world.discs_xyr_m,
        instance.world.bounds_m,
        instance.start[:2],
        instance.goal,
        safe_m=instance.safe_m,
        length_weight=weights.length_weight,
        turning_weight=weights.turning_weight,
    )
    if best is None:
        raise ValueError(f"{instance.name}: no path connects start and goal")
    return best.cost


def path_cost(waypoints: FloatArray) -> float:
    """Compute J of a polyline with the default weights, without obstacles.

    Turning is summed from headings; the planners' kernels use cross products instead.

    Args:
        waypoints: (M, 2) waypoints, m.

    Returns:
        w1 length + w2 turning (Sabiha 2022, online TLBO, Eq. 12).
    """
    weights = PlannerConfig()
    steps = np.diff(waypoints, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps = steps[lengths > 1e-9]
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    return float(
        weights.length_weight * lengths.sum() + weights.turning_weight * np.abs(turns).sum()
    )


def measure(
    instances: Iterable[tuple[Instance, float]], config: PlannerConfig, plans: int
) -> dict[str, float]:
    """Measure a planner in this process on several instances.

    Args:
        instances: The tasks, each with its J*.
        config: The planner's settings; the safe distance comes from each instance.
        plans: Least number of plans, shared equally by the instances.

    Returns:
        Figures by name, see `bench.figures`.
    """
    todo, tally = list(instances), _Tally()
    seeds = -(-plans // len(todo))
    for instance, best in todo:
        _measure_one(instance, best, config, seeds, tally)
    return tally.figures()


def _measure_one(
    instance: Instance, best: float, config: PlannerConfig, seeds: int, tally: _Tally
) -> None:
    config = replace(config, safe_distance_m=instance.safe_m, start_turn_weight=0.0)
    planner = make_planner(config, _POINT)
    task = PlanningTask(instance.world, instance.start, instance.goal, instance.safe_m)
    planner.plan(task, np.random.default_rng(0))  # compiles the kernels and fills the caches
    costs, paths = [], []
    gc.collect()
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        began = perf_counter()
        plan = planner.plan(task, rng)
        tally.ms.append(1e3 * (perf_counter() - began))
        tally.evaluations.append(plan.evaluations)
        costs.append(path_cost(plan.waypoints_m))
        paths.append(plan.waypoints_m)
    # The judge runs after all plans, so that it does not disturb the timing.
    tally.gap += [100.0 * (cost / best - 1.0) for cost in costs]
    tally.spread.append(float(np.std(costs)))
    for path in paths:
        clear = true_clearance(instance, path, _CHECK_STEP_M)
        tally.safe.append(clear >= instance.safe_m - SAFE_WITHIN_M)
