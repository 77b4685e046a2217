"""What each replan came to, beside the exact optimum among the discs of the same view.

Nothing of it enters the robot, and nothing is worked out before the run is over: the optimum takes
some 40 ms a view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.reference.exact import exact_path
from simloop.truth import Published

_HERE_M = 0.01
_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """One replan. cost: J, the penalty included where it is not safe.

    exact_cost: least J of a point among the view's discs from the same start; None where there is
    none. gap_percent: what J has over it; None where the plan is not safe. The discs cover more
    than the map's cells do, which is where most planners look: a gap below zero is a way that
    the discs hide.
    """

    t_s: float
    planner: str
    reason: str
    safe: bool
    evaluations: int
    generations: int
    cost: float
    length_m: float
    turning_rad: float
    exact_cost: float | None
    gap_percent: float | None


class PlanLog:
    """Hears a run's messages and keeps the plans with the views that they were made in."""

    def __init__(self, config: PlannerConfig) -> None:
        self._config = config
        self._plans: list[Plan] = []
        self._views: dict[int, WorldView] = {}

    def offer(self, message: Published) -> None:
        """Take one message."""
        if isinstance(message, Plan):
            self._plans.append(message)
        elif isinstance(message, WorldView):
            self._views[message.t_ns] = message

    def records(self) -> list[PlanRecord]:
        """All replans so far, the first plan included."""
        return [self._record(plan, self._views[plan.t_ns]) for plan in self._plans]

    def _record(self, plan: Plan, view: WorldView) -> PlanRecord:
        best = least_cost(self._config, view, plan.waypoints_m[0], plan.waypoints_m[-1])
        gap = 100.0 * (plan.cost / best - 1.0) if plan.safe and best else None
        return PlanRecord(
            t_s=plan.t_ns * 1e-9,
            planner=plan.planner,
            reason=plan.reason,
            safe=plan.safe,
            evaluations=plan.evaluations,
            generations=plan.generations,
            cost=plan.cost,
            length_m=plan.length_m,
            turning_rad=plan.turning_rad,
            exact_cost=best,
            gap_percent=gap,
        )


def least_cost(
    config: PlannerConfig, view: WorldView, start: FloatArray, goal: FloatArray
) -> float | None:
    """Least J of a point among the view's discs. A disc nearer to an end than the safe distance is
    taken for as much smaller as that end asks for: the robot stands there already."""
    if np.hypot(*(goal - start)) < _HERE_M:
        return None
    discs = view.discs_xyr_m.copy()
    for end in (start, goal):
        room = np.hypot(*(discs[:, :2] - end).T) - config.safe_distance_m - _TOUCH_M
        discs[:, 2] = np.minimum(discs[:, 2], room)
    discs = discs[discs[:, 2] > -config.safe_distance_m]
    found = exact_path(
        discs,
        view.bounds_m,
        start,
        goal,
        safe_m=config.safe_distance_m,
        length_weight=config.length_weight,
        turning_weight=config.turning_weight,
    )
    return None if found is None else found.cost
