"""What a path is worth, whoever planned it: J, clearance and arrival from its waypoints alone."""

from __future__ import annotations

import gc
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from simloop.benchmarks.planners.scenes import (
    SCENE_NAMES,
    Instance,
    box_distance,
    scene,
    true_clearance,
)
from simloop.common.terminal import print_table
from simloop.config import PlannerConfig, VehicleConfig
from simloop.evaluation.provenance import machine, versions
from simloop.messages import FloatArray
from simloop.planners.problem.clearance import SAFE_WITHIN_M
from simloop.planners.problem.objective import LEAST_INTRUSION_M
from simloop.planners.protocol import PlanningTask
from simloop.planners.reference.exact import exact_path
from simloop.planners.registry import make_planner

PLANS = 1000
PLANS_PRECISE = 200
_CHECK_STEP_M = 1e-3
_POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))


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


@dataclass(slots=True)
class _Tally:
    """What the plans of one planner on one scene came to; spread: std of J, one an instance."""

    ms: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    safe: list[bool] = field(default_factory=list)
    evaluations: list[int] = field(default_factory=list)
    spread: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """The JSON's keys: milliseconds, percent, a fraction, J, and a mean count."""
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


def run(plans: int = PLANS, precise: int = PLANS_PRECISE) -> dict[str, Any]:
    """The figures of ``simloop bench planners --json``.

    plans, precise: at least this many plans a scene, shared by its instances.
    """
    jobs = [("tlbo", PlannerConfig(), plans)]
    jobs.append(("tlbo_precise", PlannerConfig(name="tlbo", precise=True), precise))
    found: dict[str, dict[str, dict[str, float]]] = {name: {} for name in SCENE_NAMES}
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("", total=len(jobs) * len(SCENE_NAMES))
        for name in SCENE_NAMES:
            instances = [(one, optimum(one)) for one in scene(name)]
            for planner, config, count in jobs:
                progress.update(bar, description=f"{name}, {planner}")
                found[name][planner] = measure(instances, config, count)
                progress.advance(bar)
    return {"scenes": found, "machine": machine(), "versions": versions()}


def optimum(instance: Instance) -> float:
    """J* of an instance; among discs it is worked out."""
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
        raise ValueError(f"{instance.name} has no way to the goal")
    return best.cost


def path_cost(waypoints: FloatArray) -> float:
    """J of a polyline (M, 2) without obstacles, by headings (the kernels go by cross products)."""
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
    """Plan each instance (given with its J*) from many seeds and sum up."""
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
    planner.plan(task, np.random.default_rng(0))  # warms the kernels and caches up
    costs, ways = [], []
    gc.collect()
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        began = perf_counter()
        plan = planner.plan(task, rng)
        tally.ms.append(1e3 * (perf_counter() - began))
        tally.evaluations.append(plan.evaluations)
        costs.append(path_cost(plan.waypoints_m))
        ways.append(plan.waypoints_m)
    tally.gap += [100.0 * (cost / best - 1.0) for cost in costs]
    tally.spread.append(float(np.std(costs)))
    for way in ways:
        clear = true_clearance(instance, way, _CHECK_STEP_M)
        tally.safe.append(clear >= instance.safe_m - SAFE_WITHIN_M)


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """The figures as a table for the terminal."""
    header = ["scene", "planner", "ms p50", "p99", "gap % p50", "p95", "safe %", "std", "trials"]
    rows = [
        [name, planner, f"{at['ms_p50']:.2f}", f"{at['ms_p99']:.2f}", f"{at['gap_p50']:.3f}",
         f"{at['gap_p95']:.3f}", f"{100.0 * at['safe']:.1f}", f"{at['std']:.4f}",
         f"{at['evaluations']:.0f}"]
        for name, planners in figures["scenes"].items()
        for planner, at in planners.items()
    ]  # fmt: skip
    print_table(console, f"cold plans, on {figures['machine']['cpu']}", header, rows)
