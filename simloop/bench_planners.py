"""Planners against the exact optimum on the fixed scenes: how near, how safe, how quick.

Every plan is a cold one, with a generator of its own. Its J is worked out anew from its waypoints
and its clearance by `scenes.true_clearance`, which shares no code with the planners. Nothing here
is ever used in a decision.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from simloop.benchmarks.planners.scenes import SCENE_NAMES, Instance, scene, true_clearance
from simloop.common.terminal import print_table
from simloop.config import PlannerConfig, VehicleConfig
from simloop.evaluation.provenance import machine, versions
from simloop.messages import FloatArray
from simloop.planners.problem.clearance import SAFE_WITHIN_M
from simloop.planners.reference.exact import exact_path
from simloop.planners.registry import make_planner

PLANS = 1000
PLANS_PRECISE = 200
_CHECK_STEP_M = 1e-3
_POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))


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
    task = (instance.world, instance.start, instance.goal)
    planner.plan(*task, np.random.default_rng(0))  # warms the kernels and caches up
    costs, ways = [], []
    gc.collect()
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        began = perf_counter()
        plan = planner.plan(*task, rng)
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
