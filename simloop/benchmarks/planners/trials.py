"""One planner on one task from one seed: planned, judged, and timed where time matters."""

from __future__ import annotations

import gc
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from simloop.benchmarks.planners.judge import Verdict, judge, path_cost
from simloop.benchmarks.planners.scenes import Instance
from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, Plan
from simloop.planners.protocol import Planner, PlanningTask, kind_of
from simloop.planners.reactive.online import OnlineWorld, simulate
from simloop.planners.registry import PlannerInfo, info, make_planner

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
PRECISE = "tlbo_precise"
LADDER = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)
"""Shares of the budget at which a planner that keeps no history is run again for one."""
_NEVER_IDLE = 10_000
_LEAST_TIMED, _ENOUGH_MS, _LONG_MS = 3, 50.0, 150.0


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What came of one plan. history: (H, 2) evaluations and the best score so far."""

    planner: str
    instance: str
    seed: int
    verdict: Verdict
    evaluations: int
    generations: int
    path_m: FloatArray
    history: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MovingInstance(Instance):
    """A world with movers or a goal that moves, which only the step-by-step planners can walk."""

    online: OnlineWorld | None = None


def moving_instance(online: OnlineWorld) -> MovingInstance:
    """An instance of a world that moves; its goal is where the goal begins."""
    return MovingInstance(
        online.name,
        online.fixed,
        online.start,
        online.goal.at(0),
        online.safe_m,
        np.zeros((0, 4)),
        online=online,
    )


def info_of(name: str) -> PlannerInfo:
    """What the registry knows of a planner; `PRECISE` is the lead planner."""
    return info("tlbo" if name == PRECISE else name)


def handles(name: str, instance: Instance) -> bool:
    """Whether a planner has an answer for this kind of world."""
    if isinstance(instance, MovingInstance):
        return info_of(name).stepwise
    return kind_of(instance.world) in info_of(name).worlds


def settings(name: str, instance: Instance, budget: int, learners: int) -> PlannerConfig:
    """Equal terms: the same budget, the same size and seeding of the first population. The rules go
    on until the budget is spent; the lead planner ends when its class has learnt enough."""
    common = PlannerConfig(
        name="tlbo" if name == PRECISE else name,
        precise=name == PRECISE,
        safe_distance_m=instance.safe_m,
        start_turn_weight=0.0,
        max_evaluations=budget,
        learners=learners,
    )
    if not info_of(name).update_rule:
        return common
    return replace(common, idle_generations=_NEVER_IDLE, options={"seeding": "seeded"})


def prepare(config: PlannerConfig) -> Planner:
    """A planner for a point."""
    return make_planner(config, POINT)


def plan_once(planner: Planner, instance: Instance, seed: int) -> Plan:
    """A cold plan with a generator of its own."""
    rng = np.random.default_rng(seed)
    task = PlanningTask(instance.world, instance.start, instance.goal, instance.safe_m)
    return planner.plan(task, rng)


def plan_timed(planner: Planner, instance: Instance, seed: int) -> tuple[Plan, float]:
    """`plan_once`, and the seconds that it took."""
    began = perf_counter()
    plan = plan_once(planner, instance, seed)
    return plan, perf_counter() - began


def try_once(
    name: str, instance: Instance, seed: int, config: PlannerConfig, *, history: bool = False
) -> Trial:
    """Plan and judge. history: where the planner keeps none, run it at lesser budgets too."""
    if isinstance(instance, MovingInstance):
        return _walk(name, instance, seed, config)
    plan = plan_once(prepare(config), instance, seed)
    verdict = judge(instance, plan.waypoints_m)
    rows = plan.history
    if history and not len(rows):
        rows = _ladder(instance, seed, config)
    last = np.array([[plan.evaluations, verdict.score]], dtype=np.float64)
    return Trial(
        planner=name,
        instance=instance.name,
        seed=seed,
        verdict=verdict,
        evaluations=plan.evaluations,
        generations=plan.generations,
        path_m=plan.waypoints_m,
        history=_trusted(np.vstack([rows.reshape(-1, 2), last]), verdict),
    )


def _walk(name: str, instance: MovingInstance, seed: int, config: PlannerConfig) -> Trial:
    """Walk a world that moves; the judge is the simulator's own account of collisions."""
    assert instance.online is not None
    steering = prepare(config).steering()  # type: ignore[attr-defined]
    done = simulate(instance.online, steering, np.random.default_rng(seed))
    cost = path_cost(done.points_m)
    lost = 0.0 if done.success else PlannerConfig().penalty
    return Trial(
        planner=name,
        instance=instance.name,
        seed=seed,
        verdict=Verdict(
            cost=cost,
            score=cost + lost,
            length_m=done.length_m,
            turning_rad=(cost - PlannerConfig().length_weight * done.length_m)
            / PlannerConfig().turning_weight,
            safe=done.collisions == 0,
            reached=done.reached,
        ),
        evaluations=done.evaluations,
        generations=done.steps,
        path_m=done.points_m,
        history=np.array([[done.evaluations, cost + lost]], dtype=np.float64),
    )


def _ladder(instance: Instance, seed: int, config: PlannerConfig) -> FloatArray:
    """(H, 2) evaluations and score of runs with lesser budgets."""
    rows = []
    for share in LADDER:
        less = max(100, round(share * config.max_evaluations))
        plan = plan_once(prepare(replace(config, max_evaluations=less)), instance, seed)
        rows.append((plan.evaluations, judge(instance, plan.waypoints_m).score))
    return np.array(rows, dtype=np.float64)


def _trusted(history: FloatArray, verdict: Verdict) -> FloatArray:
    """The history, best so far, in order; where the path is not safe by the judge, the planner's
    own account is worth nothing and only the last row stays."""
    if not verdict.success:
        return history[-1:]
    history = history[np.argsort(history[:, 0], kind="mergesort")]
    history[:, 1] = np.minimum.accumulate(history[:, 1])
    return history


def time_plans(name: str, instance: Instance, config: PlannerConfig) -> list[float]:
    """Milliseconds of some plans in this process: more the quicker they are, one where it takes
    long."""
    planner = prepare(config)

    def once(seed: int) -> None:
        if isinstance(instance, MovingInstance):
            _walk(name, instance, seed, config)
        else:
            plan_once(planner, instance, seed)

    once(0)  # warms kernels and caches up
    gc.collect()
    took: list[float] = []
    while sum(took) < _ENOUGH_MS or (len(took) < _LEAST_TIMED and sum(took) < _LONG_MS):
        began = perf_counter()
        once(len(took))
        took.append(1e3 * (perf_counter() - began))
    return took
