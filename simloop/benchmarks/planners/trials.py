"""Trials: one planner on one task from one seed, judged, and timed if requested."""

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
"""Shares of the budget at which a planner without a history is run again to get one."""
_NEVER_IDLE = 10_000
_LEAST_TIMED, _ENOUGH_MS, _LONG_MS = 3, 50.0, 150.0


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The result of one plan.

    Attributes:
        planner: Name of the planner.
        instance: Name of the task.
        seed: Seed of the plan.
        verdict: The judge's rating.
        evaluations: Number of candidates that the planner evaluated.
        generations: Number of generations, or of steps for a step-by-step planner.
        path_m: (M, 2) waypoints, m, map frame.
        history: (H, 2) evaluations and the best score so far, ascending in evaluations.
    """

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
    """A world with movers or a moving goal, which only the step-by-step planners can cross.

    Attributes:
        online: The world for the simulator.
    """

    online: OnlineWorld | None = None


def moving_instance(online: OnlineWorld) -> MovingInstance:
    """Make a task of a world with movers or a moving goal.

    Args:
        online: The world.

    Returns:
        A task whose goal is the first position of the moving goal.
    """
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
    """Return the registry's entry of a planner.

    Args:
        name: Name of the planner; `PRECISE` is the lead planner.

    Returns:
        Its entry.
    """
    return info("tlbo" if name == PRECISE else name)


def handles(name: str, instance: Instance) -> bool:
    """Tell whether a planner can plan in the world of a task.

    Args:
        name: Name of the planner.
        instance: The task.

    Returns:
        Whether it can.
    """
    if isinstance(instance, MovingInstance):
        return info_of(name).stepwise
    return kind_of(instance.world) in info_of(name).worlds


def settings(name: str, instance: Instance, budget: int, learners: int) -> PlannerConfig:
    """Make settings on equal terms: the same budget, population size and seeding.

    Update rules run until the budget is spent; the lead planner also stops when its class no
    longer improves.

    Args:
        name: Name of the planner.
        instance: The task.
        budget: Largest number of evaluations.
        learners: Size of the population.

    Returns:
        The planner's settings.
    """
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
    """Make a planner for a point robot.

    Args:
        config: The planner's settings.

    Returns:
        The planner.

    Raises:
        InputError: A library that it needs is not installed.
    """
    return make_planner(config, POINT)


def plan_once(planner: Planner, instance: Instance, seed: int) -> Plan:
    """Plan once, without a previous plan and with a new random generator.

    Args:
        planner: The planner.
        instance: The task.
        seed: Seed of the generator.

    Returns:
        The plan.
    """
    rng = np.random.default_rng(seed)
    task = PlanningTask(instance.world, instance.start, instance.goal, instance.safe_m)
    return planner.plan(task, rng)


def plan_timed(planner: Planner, instance: Instance, seed: int) -> tuple[Plan, float]:
    """Plan once and measure the time.

    Args:
        planner: The planner.
        instance: The task.
        seed: Seed of the plan.

    Returns:
        The plan, and its planning time, s.
    """
    began = perf_counter()
    plan = plan_once(planner, instance, seed)
    return plan, perf_counter() - began


def try_once(
    name: str, instance: Instance, seed: int, config: PlannerConfig, *, history: bool = False
) -> Trial:
    """Plan once and judge the result.

    Args:
        name: Name of the planner.
        instance: The task.
        seed: Seed of the plan.
        config: The planner's settings.
        history: Whether a planner without a history is run again with smaller budgets to get one.

    Returns:
        The trial.
    """
    if isinstance(instance, MovingInstance):
        return _try_moving(name, instance, seed, config)
    plan = plan_once(prepare(config), instance, seed)
    verdict = judge(instance, plan.waypoints_m)
    rows = plan.history
    if history and not len(rows):
        rows = _history_by_budgets(instance, seed, config)
    last = np.array([[plan.evaluations, verdict.score]], dtype=np.float64)
    return Trial(
        planner=name,
        instance=instance.name,
        seed=seed,
        verdict=verdict,
        evaluations=plan.evaluations,
        generations=plan.generations,
        path_m=plan.waypoints_m,
        history=_checked_history(np.vstack([rows.reshape(-1, 2), last]), verdict),
    )


def _try_moving(name: str, instance: MovingInstance, seed: int, config: PlannerConfig) -> Trial:
    """Simulate a world with movers; the simulator counts the collisions, not the judge."""
    assert instance.online is not None
    steering = prepare(config).steering()  # type: ignore[attr-defined]
    done = simulate(instance.online, steering, np.random.default_rng(seed))
    cost = path_cost(done.points_m)
    penalty = 0.0 if done.success else PlannerConfig().penalty
    return Trial(
        planner=name,
        instance=instance.name,
        seed=seed,
        verdict=Verdict(
            cost=cost,
            score=cost + penalty,
            length_m=done.length_m,
            turning_rad=(cost - PlannerConfig().length_weight * done.length_m)
            / PlannerConfig().turning_weight,
            safe=done.collisions == 0,
            reached=done.reached,
        ),
        evaluations=done.evaluations,
        generations=done.steps,
        path_m=done.points_m,
        history=np.array([[done.evaluations, cost + penalty]], dtype=np.float64),
    )


def _history_by_budgets(instance: Instance, seed: int, config: PlannerConfig) -> FloatArray:
    """Run with smaller budgets; return evaluations and scores (H, 2)."""
    rows = []
    for share in LADDER:
        less = max(100, round(share * config.max_evaluations))
        plan = plan_once(prepare(replace(config, max_evaluations=less)), instance, seed)
        rows.append((plan.evaluations, judge(instance, plan.waypoints_m).score))
    return np.array(rows, dtype=np.float64)


def _checked_history(history: FloatArray, verdict: Verdict) -> FloatArray:
    """Return the history in order, as the best score so far.

    If the judge finds the path unsafe, the planner's own account is not reliable. Then only the
    judge's row, which is the last one, is kept.
    """
    if not verdict.success:
        return history[-1:]
    history = history[np.argsort(history[:, 0], kind="mergesort")]
    history[:, 1] = np.minimum.accumulate(history[:, 1])
    return history


def time_plans(name: str, instance: Instance, config: PlannerConfig) -> list[float]:
    """Time some plans in this process; quick planners make more of them.

    Args:
        name: Name of the planner.
        instance: The task.
        config: The planner's settings.

    Returns:
        Planning times, ms; at least one.
    """
    planner = prepare(config)

    def once(seed: int) -> None:
        if isinstance(instance, MovingInstance):
            _try_moving(name, instance, seed, config)
        else:
            plan_once(planner, instance, seed)

    once(0)  # compiles the kernels and fills the caches
    gc.collect()
    took: list[float] = []
    while sum(took) < _ENOUGH_MS or (len(took) < _LEAST_TIMED and sum(took) < _LONG_MS):
        began = perf_counter()
        once(len(took))
        took.append(1e3 * (perf_counter() - began))
    return took
