"""The account of a plan."""

from __future__ import annotations

from typing import Any

import numpy as np

from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.problem.clearance import Problem, make_problem
from simloop.planners.problem.objective import intrusion, length_and_turning, make_stack


def problem_of(
    config: PlannerConfig, overhang_m: float, world: WorldView, start: FloatArray, goal: FloatArray
) -> Problem:
    """The planning problem that a config asks for."""
    return make_problem(
        world,
        start,
        goal,
        safe_m=config.safe_distance_m,
        overhang_m=overhang_m,
        length_weight=config.length_weight,
        turning_weight=config.turning_weight,
        start_turn_weight=config.start_turn_weight,
        penalty=config.penalty,
    )


def lack_of(p: Problem, path: FloatArray) -> float:
    """Summed intrusion of a path (n, 2), m: 0 where it keeps the safe distance all along."""
    return float(intrusion(p, path, len(path), np.inf, make_stack()))


def account(
    name: str, world: WorldView, p: Problem, path: FloatArray, lack_m: float, **told: Any
) -> Plan:
    """The plan along a path (n, 2) that lacks so much: J with the lack's price, length, turning.

    told: `Plan`'s further fields.
    """
    length, turning = length_and_turning(path, len(path))
    cost = p.length_weight * length + p.turning_weight * turning
    return Plan(
        t_ns=world.t_ns,
        waypoints_m=path,
        cost=cost + p.penalty * lack_m,
        length_m=length,
        turning_rad=turning,
        safe=lack_m == 0.0,
        planner=name,
        **told,
    )
