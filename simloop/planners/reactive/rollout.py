"""Base of the planners that move a point step by step through the world view.

The path is the simplified trace of the point. Its account (J, clearance along every segment,
overhang of the three-disc footprint) is the same as that of every other planner.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np
from numba import njit

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.problem.account import account, lack_of, problem_of
from simloop.planners.problem.clearance import (
    STACK,
    Problem,
    relaxed_clearance,
    segment_clearance,
)
from simloop.planners.problem.objective import length_of
from simloop.planners.protocol import PlanningTask
from simloop.planners.reactive.overhang_room import with_room
from simloop.planners.tlbo.warm import way_ahead

TOLERANCE_SHARES = (0.02, 0.005, 0.0)
"""Allowed distances of a simplified path from the trace, in safe distances. The first one that
costs no clearance is used."""
_ATTEMPTS = 4
_LONGEST = 2.0  # times the length of a known path: a walk that goes on for longer is given up
_WALK_MARGIN = 0.1  # of the safe distance: walks keep a little more than they must
_LEAST_GROWTH = 0.1  # of the overhang: growth between two attempts


class Rollout(NamedTuple):
    """The result of moving a point from the start until it stops.

    Attributes:
        path: (n, 2) the point's positions, m, map frame.
        reached: Whether the last one is the goal.
        evaluations: Number of candidates tried.
        generations: Number of generations of a search, if there was one.
        candidates: Further paths (n, 2), m, map frame, for display.
        others: Further paths (n, 2), m, map frame, that reach the goal. If ``path`` lacks
            clearance, the first of them that does not is used.
    """

    path: FloatArray
    reached: bool
    evaluations: int
    generations: int = 0
    candidates: tuple[FloatArray, ...] = ()
    others: tuple[FloatArray, ...] = ()


RollOut = Callable[[Problem, int, float], Rollout]
"""Moves a point: a function of a problem, the number of the attempt, from 0, and the length, m,
after which a walk may be given up."""


@njit(cache=True)
def simplify(path: FloatArray, tolerance: float) -> FloatArray:
    """Simplify a path: drop points that its shape does not need (Douglas & Peucker 1973).

    Args:
        path: (n, 2) points, m.
        tolerance: Largest distance of a dropped point from the simplified path, m.

    Returns:
        (k, 2) the remaining points, the first and the last among them.
    """
    n = path.shape[0]
    keep = np.zeros(n, dtype=np.bool_)
    keep[0] = keep[n - 1] = True
    todo = [(0, n - 1)]  # a stack instead of recursion, which numba types poorly
    while len(todo) > 0:
        first, last = todo.pop()
        dx, dy = path[last, 0] - path[first, 0], path[last, 1] - path[first, 1]
        square = dx * dx + dy * dy
        most, at = tolerance, -1
        for i in range(first + 1, last):
            ex, ey = path[i, 0] - path[first, 0], path[i, 1] - path[first, 1]
            t = min(max((ex * dx + ey * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            off = math.hypot(ex - t * dx, ey - t * dy)
            if off > most:
                most, at = off, i
        if at >= 0:
            keep[at] = True
            todo.append((first, at))
            todo.append((at, last))
    return path[keep]


def with_extra_clearance(p: Problem, extra_m: float) -> Problem:
    """Return the same problem with a larger safe distance.

    Args:
        p: The planning problem.
        extra_m: Distance to add to the safe distance, m.

    Returns:
        A problem in which the robot can still leave a start that lacks the larger distance.
    """
    slack = p.start_slack + extra_m if p.start_slack > 0.0 else 0.0
    if slack == 0.0 and extra_m > 0.0:
        here = relaxed_clearance(p, p.start_x, p.start_y) - p.safe_m
        slack = max(0.0, extra_m - here + 1e-6) if here < extra_m else 0.0
    return p._replace(safe_m=p.safe_m + extra_m, start_slack=slack)


def plan_by_rollout(
    name: str,
    task: PlanningTask,
    problem: Problem,
    roll_out: RollOut,
    known: Plan | None = None,
) -> Plan:
    """Move a point to the goal and turn its trace into a plan.

    The moving point ignores the vehicle's overhang. If its path lacks clearance for this reason,
    the obstacles are grown by what is missing at its worst place, up to the whole overhang, and the
    point moves again. If it does not reach the goal among the grown obstacles, they are grown
    half as much more. The first path that is safe and reaches the goal is used, else the one
    with the least missing clearance. Without an overhang there is one attempt.

    Args:
        name: Name of the planner.
        task: The task, with the original world view.
        problem: The planning problem in the view that the planner uses.
        roll_out: Moves the point.
        known: A plan with a safe path. The attempts end when a path costs more even without
            regard to its clearance, because larger obstacles make no path cheaper.

    Returns:
        The plan; ``safe`` only if its path keeps the safe distance and reaches the goal.
    """
    best: tuple[float, Rollout, FloatArray] | None = None
    evaluations = 0
    growth, lacking, most = 0.0, 0.0, _most_growth(problem)
    known_cost, most_m = math.inf, math.inf
    if known is not None:
        known_cost, most_m = known.cost, _LONGEST * known.length_m
    for attempt in range(_ATTEMPTS if problem.overhang_m > 0.0 else 1):
        done = roll_out(with_extra_clearance(problem, growth), attempt, most_m)
        evaluations += done.evaluations
        path, lack = _safest(problem, done)
        left = math.hypot(problem.goal_x - path[-1, 0], problem.goal_y - path[-1, 1])
        badness = lack + (0.0 if done.reached else left)
        if best is None or badness < best[0]:
            best = badness, done, path
        if badness == 0.0 or (not done.reached and growth == 0.0):
            break  # if obstacles as they are close the way off, grown ones do so as well
        if done.reached and _account_of(name, task, problem, path, 0.0).cost >= known_cost:
            break
        if done.reached:
            if growth == most:
                break
            most_m = min(most_m, _LONGEST * length_of(done.path, len(done.path)))
            more = max(_worst_lack(problem, path), _LEAST_GROWTH * problem.overhang_m)
            lacking, growth = growth, min(growth + more, most)
        else:
            growth = 0.5 * (lacking + growth)
    assert best is not None
    badness, done, path = best
    spent = {"evaluations": evaluations, "generations": done.generations}
    return account(name, task, problem, path, lack_m=badness, candidates_m=done.candidates, **spent)


class RolloutPlanner:
    """A `simloop.planners.protocol.Planner` whose subclasses move a point through the view."""

    name: ClassVar[str] = ""
    keeps_way: ClassVar[bool] = False
    """Whether the last plan, as far as it lies ahead and is still safe, is kept until a better path
    is found. A random planner without memory would turn round whenever its point happens to pass
    an obstacle on the other side."""

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._overhang = max(vehicle.footprint_offsets_m)

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """Move a point to the goal and return its trace as a plan; see `Planner.plan`.

        Args:
            task: The task; its previous plan is used if the planner ``keeps_way``.
            rng: Source of all randomness.

        Returns:
            The plan. If the point does not reach the goal, the plan ends where the point stopped
            and is not safe.
        """
        task = replace(task, world=self._usable_view(task.world))
        problem = problem_of(self._config, self._overhang, task)
        way = way_ahead(problem, task.previous) if self.keeps_way else None
        old = None if way is None else self._old_plan(task, problem, way)
        roll_out = self._make_rollout(task.world, rng)
        if old is not None:
            plan = plan_by_rollout(self.name, task, problem, roll_out, old)
            return plan if plan.safe and plan.cost < old.cost else _told_by(old, plan)
        plan = plan_by_rollout(self.name, task, problem, roll_out)
        go_on = None if way is None else self._make_continuation(problem, way, rng)
        if go_on is None:
            return plan
        other = plan_by_rollout(self.name, task, problem, go_on, plan if plan.safe else None)
        spent = plan.evaluations + other.evaluations
        better = (not other.safe, other.cost) < (not plan.safe, plan.cost)
        return replace(other if better else plan, evaluations=spent)

    def _old_plan(self, task: PlanningTask, problem: Problem, way: FloatArray) -> Plan | None:
        """Return the plan along what lies ahead of the last one, if that is still safe."""
        plan = _account_of(self.name, task, problem, way)
        if not plan.safe and problem.overhang_m > 0.0:
            # A few centimetres off the way, or a wall that is now seen better, are no reason to
            # go elsewhere: the way bends with them.
            way, lack = _finish(problem, Rollout(with_room(problem, way), True, 0))
            plan = _account_of(self.name, task, problem, way, lack)
        return plan if plan.safe else None

    def _usable_view(self, world: WorldView) -> WorldView:
        """Return the view in a form that this planner can use."""
        return world

    def _make_rollout(self, world: WorldView, rng: np.random.Generator) -> RollOut:
        """Return the function that moves the point; see `plan_by_rollout`."""
        raise NotImplementedError

    def _make_continuation(
        self, problem: Problem, way: FloatArray, rng: np.random.Generator
    ) -> RollOut | None:
        """Return a function that moves the point on from where the last way is blocked now.

        A walk that starts anew knows nothing of what it was doing, for example of the surface that
        it followed. None if the planner's point has no such state.
        """
        return None


def clear_part(p: Problem, way: FloatArray) -> FloatArray:
    """Return the part of a way before the first segment that lacks clearance.

    Args:
        p: The planning problem.
        way: (n, 2) waypoints, m, map frame.

    Returns:
        (k >= 1, 2) its first waypoints, m, map frame.
    """
    for n in range(2, len(way) + 1):
        if lack_of(p, way[n - 2 : n]) > 0.0:
            return way[: n - 1]
    return way


def _told_by(old: Plan, search: Plan) -> Plan:
    """Return a kept plan with the account of the search that found nothing better."""
    return replace(
        old,
        evaluations=search.evaluations,
        generations=search.generations,
        candidates_m=search.candidates_m,
    )


def _account_of(
    name: str, task: PlanningTask, p: Problem, path: FloatArray, lack_m: float | None = None
) -> Plan:
    """Return the plan along a path that nobody has searched for."""
    return account(name, task, p, path, lack_m=lack_m, evaluations=0, generations=0)


def _most_growth(p: Problem) -> float:
    """Return how much the obstacles may grow, m: up to the overhang, but not over the goal.

    A walk to a goal inside an obstacle would go on until its steps are used up.
    """
    room = relaxed_clearance(p, p.goal_x, p.goal_y) - (1.0 + _WALK_MARGIN) * p.safe_m
    return min(p.overhang_m, max(0.0, room))


@njit(cache=True)
def _worst_lack(p: Problem, path: FloatArray) -> float:
    """Return the clearance that is missing at the worst place of a path, m."""
    worst, stack, need = 0.0, np.zeros((STACK, 3)), p.safe_m - p.tolerance_m
    for i in range(path.shape[0] - 1):
        clear = segment_clearance(
            p, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], need, -np.inf, stack
        )
        if clear < need:
            worst = max(worst, p.safe_m - clear)
    return worst


def _safest(p: Problem, done: Rollout) -> tuple[FloatArray, float]:
    """Return the first of a result's paths that is safe, else the first, and what it lacks, m."""
    first = _finish(p, done)
    if first[1] > 0.0:
        for other in done.others:
            path, lack = _finish(p, done._replace(path=other))
            if lack == 0.0:
                return path, lack
        if done.reached and p.overhang_m > 0.0:
            bent = _finish(p, done._replace(path=with_room(p, done.path)))
            if bent[1] < first[1]:
                return bent
    return first


def _finish(p: Problem, done: Rollout) -> tuple[FloatArray, float]:
    """Return the simplified path, with at least two points, and its missing clearance, m."""
    path, lack = done.path, np.inf
    for share in TOLERANCE_SHARES:
        path = simplify(np.ascontiguousarray(done.path), share * p.safe_m)
        if len(path) == 1:  # the point never left the start: show its intended direction
            path = np.array([path[0], (p.goal_x, p.goal_y)])
        if done.reached:
            path[-1] = p.goal_x, p.goal_y
        lack = lack_of(p, path)
        if lack == 0.0:
            break
    return path, lack
