"""Compare each replan with the exact optimum among the discs of the same view.

The robot does not see the result. It is computed after the run, because one optimum takes about
40 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.reference.exact import exact_path
from simloop.truth import Published

_SAME_PLACE_M = 0.01
_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """One replan, with its gap to the exact optimum.

    Attributes:
        t_s: Simulated time of the view, s.
        planner: Name of the planner.
        reason: Why the plan was requested.
        safe: Whether the whole plan keeps its safe distance.
        evaluations: Number of paths and segments that were evaluated.
        generations: Number of generations of a population.
        cost: J, including the start turn and, if the plan is not safe, the penalty.
        length_m: Length of the polyline, m.
        turning_rad: Sum of its turns, rad.
        safe_distance_m: Distance from obstacles that the plan had to keep, m.
        start_turn_cost: Part of ``cost`` for the turn from the robot's heading to the first
            first segment.
        exact_cost: Least J without a start turn, for a point among the view's discs that keeps
            the plan's safe distance; None if there is no such path.
        gap_percent: Excess of ``cost`` without the start turn over ``exact_cost``, %; None if the
            plan is not safe. Most planners use the map's cells, and the discs cover more than the
            cells do, so the gap may be below zero.
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
    safe_distance_m: float
    start_turn_cost: float
    exact_cost: float | None
    gap_percent: float | None


class PlanLog:
    """Listens to a run's messages, and keeps the plans with their views."""

    def __init__(self, config: PlannerConfig) -> None:
        self._config = config
        self._plans: list[Plan] = []
        self._views: dict[int, WorldView] = {}

    def offer(self, message: Published) -> None:
        """Take one message.

        Args:
            message: Any message of the run; plans and views are kept.
        """
        if isinstance(message, Plan):
            self._plans.append(message)
        elif isinstance(message, WorldView):
            self._views[message.t_ns] = message

    def records(self) -> list[PlanRecord]:
        """Compute the records of all plans so far, including the first.

        Returns:
            One record for each plan, in order.
        """
        return [self._record(plan, self._views[plan.t_ns]) for plan in self._plans]

    def _record(self, plan: Plan, view: WorldView) -> PlanRecord:
        best = least_cost(
            self._config,
            view,
            plan.waypoints_m[0],
            plan.waypoints_m[-1],
            safe_distance_m=plan.safe_distance_m,
        )
        gap = 100.0 * (plan.path_cost / best - 1.0) if plan.safe and best else None
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
            safe_distance_m=plan.safe_distance_m,
            start_turn_cost=plan.start_turn_cost,
            exact_cost=best,
            gap_percent=gap,
        )


def least_cost(
    config: PlannerConfig,
    view: WorldView,
    start: FloatArray,
    goal: FloatArray,
    *,
    safe_distance_m: float,
) -> float | None:
    """Compute the least J of a point among a view's discs, without a start turn.

    If a disc is nearer to an end than the safe distance, its radius is reduced until the end keeps
    that distance, because the robot is already there.

    Args:
        config: The weights of length and turning.
        view: The view of the plan, in map.
        start: (2,) x, y in map, m.
        goal: (2,) x, y in map, m.
        safe_distance_m: Distance from the discs that a path must keep, m.

    Returns:
        J of the exact optimum; None if there is no path, or if start and goal are the same place.
    """
    if np.hypot(*(goal - start)) < _SAME_PLACE_M:
        return None
    discs = view.discs_xyr_m.copy()
    for end in (start, goal):
        room = np.hypot(*(discs[:, :2] - end).T) - safe_distance_m - _TOUCH_M
        discs[:, 2] = np.minimum(discs[:, 2], room)
    discs = discs[discs[:, 2] > -safe_distance_m]
    found = exact_path(
        discs,
        view.bounds_m,
        start,
        goal,
        safe_m=safe_distance_m,
        length_weight=config.length_weight,
        turning_weight=config.turning_weight,
    )
    return None if found is None else found.cost
