"""What the planners share that plan by moving a point step by step through the view they have.

The path is what the point has gone, thinned; its account (J, clearance along every segment, three
discs' overhang) is the same as every planner's.
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
    Problem,
    relaxed_clearance,
)
from simloop.planners.protocol import PlanningTask

THIN_SHARES = (0.02, 0.005, 0.0)
"""How far a thinned path may lie from what was gone, in safe distances: the first that costs no
clearance."""
_LADDER = (0.0, 0.25, 0.5, 1.0)
_SLOPE_M = 1e-3
_CLIMB_CELLS = 0.5


class Walk(NamedTuple):
    """What one roll-out came to. path: (n, 2); reached: whether it ends at the goal."""

    path: FloatArray
    reached: bool
    evaluations: int
    generations: int = 0
    candidates: tuple[FloatArray, ...] = ()


@njit(cache=True)
def surface(p: Problem, x: float, y: float) -> tuple[float, float, float]:
    """Distance from a point to the nearest obstacle grown by the safe distance, and the unit vector
    away from it.

    Negative inside; less is asked for near a start too close. Among discs alone the vector is
    exact, else it is the distance's slope; 0, 0 where that has none.
    """
    gap = relaxed_clearance(p, x, y) - p.safe_m
    if p.field.size == 0 and p.corners.size == 0:
        least = np.inf
        ux, uy = 0.0, 0.0
        for k in range(p.discs.shape[1]):
            dx, dy = x - p.discs[0, k], y - p.discs[1, k]
            apart = math.hypot(dx, dy)
            if apart - p.discs[2, k] < least and apart > 0.0:
                least = apart - p.discs[2, k]
                ux, uy = dx / apart, dy / apart
        return gap, ux, uy
    h = _CLIMB_CELLS / p.per_m if p.field.size > 0 else _SLOPE_M * p.safe_m
    gx = relaxed_clearance(p, x + h, y) - relaxed_clearance(p, x - h, y)
    gy = relaxed_clearance(p, x, y + h) - relaxed_clearance(p, x, y - h)
    size = math.hypot(gx, gy)
    if size < 1e-12:
        return gap, 0.0, 0.0
    return gap, gx / size, gy / size


@njit(cache=True)
def inside_bounds(p: Problem, x: float, y: float) -> bool:
    """Whether a point lies in the box of the waypoints, or no further out than start or goal."""
    low_x, high_x = min(p.low_x, p.start_x, p.goal_x), max(p.high_x, p.start_x, p.goal_x)
    low_y, high_y = min(p.low_y, p.start_y, p.goal_y), max(p.high_y, p.start_y, p.goal_y)
    return low_x <= x <= high_x and low_y <= y <= high_y


@njit(cache=True)
def thin(path: FloatArray, tolerance: float) -> FloatArray:
    """The path (n, 2) without the points that its shape does not need: each that is dropped lies
    within ``tolerance`` m of what stays (Douglas & Peucker 1973)."""
    n = path.shape[0]
    keep = np.zeros(n, dtype=np.bool_)
    keep[0] = keep[n - 1] = True
    todo = [(0, n - 1)]
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


def grown(p: Problem, extra_m: float) -> Problem:
    """The same problem with ``extra_m`` more to be kept from everything but at the start."""
    slack = p.start_slack + extra_m if p.start_slack > 0.0 else 0.0
    if slack == 0.0 and extra_m > 0.0:
        here = relaxed_clearance(p, p.start_x, p.start_y) - p.safe_m
        slack = max(0.0, extra_m - here + 1e-6) if here < extra_m else 0.0
    return p._replace(safe_m=p.safe_m + extra_m, start_slack=slack)


def plan_by_walking(
    name: str,
    task: PlanningTask,
    problem: Problem,
    walk: Callable[[Problem, int], Walk],
) -> Plan:
    """Walk, and answer for what came of it.

    walk: called with a problem and the number of the attempt. A point knows nothing of the
    vehicle's overhang, so where a path lacks clearance because of it, the obstacles are grown by a
    quarter, a half and the whole of it. The first path that is safe and reaches the goal is taken,
    else the one that lacks least; it is ``safe`` only if it reaches the goal.
    """
    best: tuple[float, Walk, FloatArray] | None = None
    evaluations = 0
    for attempt, share in enumerate(_LADDER if problem.overhang_m > 0.0 else _LADDER[:1]):
        done = walk(grown(problem, share * problem.overhang_m), attempt)
        evaluations += done.evaluations
        path, lack = _ended(problem, done)
        left = math.hypot(problem.goal_x - path[-1, 0], problem.goal_y - path[-1, 1])
        badness = lack + (0.0 if done.reached else left)
        if best is None or badness < best[0]:
            best = badness, done, path
        if badness == 0.0:
            break
    assert best is not None
    badness, done, path = best
    return account(
        name,
        task,
        problem,
        path,
        lack_m=badness,
        evaluations=evaluations,
        generations=done.generations,
        candidates_m=done.candidates,
    )


class WalkingPlanner:
    """Keeps `simloop.planners.protocol.Planner`; a subclass says how a view is walked."""

    name: ClassVar[str] = ""

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._overhang = max(vehicle.footprint_offsets_m)

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """As the protocol says; ``previous`` is not used. A walk that does not get to the goal
        makes a plan that ends where it did, and is not safe."""
        task = replace(task, world=self._seen(task.world))
        problem = problem_of(self._config, self._overhang, task)
        return plan_by_walking(self.name, task, problem, self._walker(task.world, rng))

    def _seen(self, world: WorldView) -> WorldView:
        """The view as this planner can take it."""
        return world

    def _walker(self, world: WorldView, rng: np.random.Generator) -> Callable[[Problem, int], Walk]:
        """What walks, see `plan_by_walking`."""
        raise NotImplementedError


def _ended(p: Problem, done: Walk) -> tuple[FloatArray, float]:
    """The thinned path, with two points at least, and exactly at the goal where it got there; and
    what clearance it lacks, m."""
    path, lack = done.path, np.inf
    for share in THIN_SHARES:
        path = thin(np.ascontiguousarray(done.path), share * p.safe_m)
        if len(path) == 1:  # it never got away: what is shown is where it wanted to go
            path = np.array([path[0], (p.goal_x, p.goal_y)])
        if done.reached:
            path[-1] = p.goal_x, p.goal_y
        lack = lack_of(p, path)
        if lack == 0.0:
            break
    return path, lack
