"""Account of a plan: the cost of its path by the common objective, and whether it is safe."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan
from simloop.planners.problem.clearance import Problem, make_problem
from simloop.planners.problem.objective import (
    intrusion,
    length_and_turning,
    make_stack,
    start_turn,
)
from simloop.planners.protocol import PlanningTask


def problem_of(config: PlannerConfig, overhang_m: float, task: PlanningTask) -> Problem:
    """Build the planning problem of a task.

    Args:
        config: The weights of the objective.
        overhang_m: Distance of the footprint's foremost disc ahead of base_link, m.
        task: The view, the start, the goal and the safe distance.

    Returns:
        The problem in the form that the compiled kernels take.
    """
    return make_problem(
        task.world,
        task.start,
        task.goal,
        safe_m=task.safe_distance_m,
        overhang_m=overhang_m,
        length_weight=config.length_weight,
        turning_weight=config.turning_weight,
        start_turn_weight=config.start_turn_weight,
        penalty=config.penalty,
    )


@njit(cache=True)
def _measure(p: Problem, path: FloatArray, stack: FloatArray) -> tuple[float, float, float, float]:
    """Compute the length, turning, start turn and summed intrusion of a path."""
    m = path.shape[0]
    length, turning = length_and_turning(path, m)
    return length, turning, start_turn(p, path, m), intrusion(p, path, m, np.inf, stack)


def lack_of(p: Problem, path: FloatArray) -> float:
    """Compute the summed intrusion of a path.

    Args:
        p: The problem.
        path: (n, 2) waypoints in map, m.

    Returns:
        The sum of R over the segments, m: 0 if the whole path keeps the safe distance.
    """
    return float(intrusion(p, path, len(path), np.inf, make_stack()))


def account(
    name: str,
    task: PlanningTask,
    p: Problem,
    path: FloatArray,
    *,
    lack_m: float | None = None,
    **told: Any,
) -> Plan:
    """Make the plan along a path, with its J by the common objective.

    Args:
        name: The planner's name.
        task: The task that the path solves.
        p: The task's problem.
        path: (n, 2) waypoints in map, m.
        lack_m: Shortfall of the path, m, if it is more than missing clearance (for example a path
            that does not reach the goal); by default its summed intrusion.
        **told: Further fields of `Plan`.

    Returns:
        The plan; it is safe if its shortfall is zero.
    """
    length, turning, first_turn, lack = _measure(p, path, make_stack())
    lack = lack if lack_m is None else lack_m
    start_turn_cost = p.start_turn_weight * first_turn
    cost = p.length_weight * length + p.turning_weight * turning + start_turn_cost
    return Plan(
        t_ns=task.world.t_ns,
        waypoints_m=path,
        cost=cost + p.penalty * lack,
        length_m=length,
        turning_rad=turning,
        safe=lack == 0.0,
        planner=name,
        reason=task.reason,
        safe_distance_m=task.safe_distance_m,
        start_turn_cost=start_turn_cost,
        **told,
    )
