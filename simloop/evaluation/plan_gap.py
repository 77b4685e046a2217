"""Compare each replan with the exact optimum among the discs of the same view.

The robot does not see the result. It is computed after the run, because one optimum takes about
40 ms. The effort is bounded: an optimum among n discs takes up to n^3 steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.reference.exact import exact_path
from simloop.truth import Published

_SAME_PLACE_M = 0.01
_TOUCH_M = 1e-6
_MOST_DISCS = 400  # an optimum among so many takes 2 to 9 s, and cannot be interrupted
_MOST_WORK = 1_000_000_000  # sum of n^3 of all optima of a run: 10 to 60 s


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
            the plan's safe distance; None if there is no such path, or if it was not computed.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """What the exact optimum of a plan depends on.

    Attributes:
        discs_xyr_m: (K, 3) x, y, radius of the view's obstacles, in map, m.
        bounds_m: (4,) x_min, y_min, x_max, y_max, in map, m.
    """

    discs_xyr_m: FloatArray
    bounds_m: FloatArray

    @property
    def work(self) -> int:
        return (len(self.discs_xyr_m) + 2) ** 3


class PlanLog:
    """Listens to a run's messages, and keeps the plans with what their optimum depends on.

    If all optima of a long run would take too long, only those of every 2nd, 4th, ... plan are
    computed. Their views are all that is kept, so memory is bounded, too.
    """

    def __init__(self, config: PlannerConfig) -> None:
        self._config = config
        self._plans: list[Plan] = []
        self._problems: dict[int, _Problem] = {}  # by the plan's place in the list
        self._work, self._stride = 0, 1

    def offer(self, message: Published) -> None:
        """Take one message. A plan and its view come in the same control period, in any order.

        Args:
            message: Any message of the run; plans and parts of views are kept.
        """
        if isinstance(message, Plan):
            # Without its pictures, which are many times as large as the rest.
            self._plans.append(replace(message, candidates_m=(), history=np.zeros((0, 2))))
        elif isinstance(message, WorldView) and self._plans:
            place = len(self._plans) - 1
            if self._plans[place].t_ns == message.t_ns:
                self._keep(place, message)

    def records(
        self,
        stop: Callable[[], bool] = lambda: False,
        show: Callable[[int], None] = lambda done: None,
    ) -> list[PlanRecord]:
        """Compute the records of all plans so far, including the first.

        Args:
            stop: Called before each optimum; True ends the work. The rest has no optimum.
            show: Called with the number of optima computed so far.

        Returns:
            One record for each plan, in order.
        """
        records, done = [], 0
        for place, plan in enumerate(self._plans):
            problem = self._problems.get(place)
            if problem is not None and stop():
                problem = None
            records.append(self._record(plan, problem))
            done += problem is not None
            show(done)
        return records

    @property
    def plans(self) -> int:
        """Number of plans so far."""
        return len(self._plans)

    @property
    def optima(self) -> int:
        """Number of plans whose optimum is computed."""
        return len(self._problems)

    def _keep(self, place: int, view: WorldView) -> None:
        problem = _Problem(view.discs_xyr_m.copy(), view.bounds_m.copy())
        if place % self._stride or len(problem.discs_xyr_m) > _MOST_DISCS:
            return
        self._problems[place] = problem
        self._work += problem.work
        while self._work > _MOST_WORK:
            self._stride *= 2
            kept = {at: one for at, one in self._problems.items() if at % self._stride == 0}
            self._problems = kept
            self._work = sum(one.work for one in kept.values())

    def _record(self, plan: Plan, problem: _Problem | None) -> PlanRecord:
        best = None
        if problem is not None:
            best = least_cost(
                self._config,
                problem,
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
    view: WorldView | _Problem,
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
