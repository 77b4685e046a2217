"""The lead planner: teaching-learning-based optimisation of the whole path, in milliseconds.

Source: Sabiha 2022 (online TLBO), Sections 3-4. One call goes from coarse to fine:

    routes of different homotopy -> a coarse class -> TLBO -> drop points that are not needed
    -> split the bends -> a fine class about the winner -> TLBO

A previous plan, cut to what lies ahead, skips the first two steps as long as it is safe.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.bends import MAX_POINTS, copy_path, pad_points, split_bends, tighten
from simloop.planners.objective import (
    Problem,
    evaluate,
    intrusion,
    length_and_turning,
    make_problem,
    make_stack,
)
from simloop.planners.routes import find_routes
from simloop.planners.splitmix import State, make_state
from simloop.planners.tlbo import draw_class, draw_near, tlbo

_ROUTES = 8
_SHOWN = 12


class Tuning(NamedTuple):
    """How much work each step does: one set for a frame, one for ``precise``."""

    learners: int
    idle: int
    budget: int
    nodes: int
    coarse_idle: int
    coarse_tolerance: float
    fine_idle: int
    fine_tolerance: float
    splits: int
    least_turn: float


class Buffers(NamedTuple):
    """Scratch that a planner owns: nothing in it outlives a call."""

    path: FloatArray
    cost: FloatArray
    mean: FloatArray
    candidate: FloatArray
    stack: FloatArray
    routes: FloatArray
    counts: NDArray[np.int32]
    costs: FloatArray
    best: FloatArray
    state: State


def make_buffers(learners: int) -> Buffers:
    """Buffers for a class of ``learners``."""
    return Buffers(
        path=np.zeros((learners, MAX_POINTS, 2)),
        cost=np.zeros(learners),
        mean=np.zeros((MAX_POINTS, 2)),
        candidate=np.zeros((MAX_POINTS, 2)),
        stack=make_stack(),
        routes=np.zeros((_ROUTES, MAX_POINTS, 2)),
        counts=np.zeros(_ROUTES, dtype=np.int32),
        costs=np.zeros(_ROUTES),
        best=np.zeros((MAX_POINTS, 2)),
        state=np.zeros(1, dtype=np.uint64),
    )


@njit(cache=True)
def _coarse(p: Problem, tune: Tuning, b: Buffers) -> tuple[int, int, int]:
    """Routes and the straight line make the first class; the winner goes to b.best. Returns its
    count of points, generations and evaluations."""
    found = find_routes(p, tune.nodes, 4, b.routes, b.counts, b.costs, b.stack)
    kept = 1
    while kept < found and b.costs[kept] < 1.15 * b.costs[0]:
        kept += 1
    m = 4
    for k in range(kept):
        m = max(m, b.counts[k])
    chord = np.hypot(p.goal_x - p.start_x, p.goal_y - p.start_y)
    line = b.candidate
    line[0, 0], line[0, 1] = p.start_x, p.start_y
    line[1, 0], line[1, 1] = p.goal_x, p.goal_y
    pad_points(line, 2, m)
    share = tune.learners // (kept + 1)
    draw_class(p, line, 0, share, m, 0.2 * chord, b.state, b.path)
    for k in range(kept):
        pad_points(b.routes[k], b.counts[k], m)
        last = tune.learners if k == kept - 1 else (k + 2) * share
        draw_class(p, b.routes[k], (k + 1) * share, last, m, 0.05 * chord, b.state, b.path)
    k, generations, evaluations = tlbo(
        p, b.path, b.cost, tune.learners, m, tune.coarse_idle, tune.coarse_tolerance,
        0.1 * chord, tune.budget, b.state, b.mean, b.candidate, b.stack,
    )
    copy_path(b.path[k], m, b.best)
    return m, generations, evaluations


@njit(cache=True)
def _fine(p: Problem, tune: Tuning, m: int, budget: int, b: Buffers) -> tuple[int, int, int]:
    """Split the bends of b.best[:m] and let a class about it learn. As `_coarse`."""
    m = tighten(p, b.best, m, 2, b.stack)
    generations, evaluations = 0, 0
    for _ in range(tune.splits):
        m = split_bends(p, b.best, m, tune.least_turn, b.stack)
    draw_near(b.best, m, tune.learners, 0.03, b.state, b.path)
    k, g, e = tlbo(
        p, b.path, b.cost, tune.learners, m, tune.fine_idle, tune.fine_tolerance,
        0.01, budget, b.state, b.mean, b.candidate, b.stack,
    )
    copy_path(b.path[k], m, b.best)
    return m, generations + g, evaluations + e


@njit(cache=True)
def _solve(p: Problem, tune: Tuning, warm: int, b: Buffers) -> tuple[int, int, int]:
    """Plan into b.best; ``warm``: how many points of a previous plan lie there (0: none)."""
    generations, evaluations = 0, 0
    m = warm
    if warm == 0:
        m, generations, evaluations = _coarse(p, tune, b)
    m, g, e = _fine(p, tune, m, tune.budget - evaluations, b)
    return m, generations + g, evaluations + e


@njit(cache=True)
def _account(p: Problem, path: FloatArray, m: int, stack: FloatArray) -> tuple[float, float, float]:
    """Length, turning and summed intrusion of a path."""
    length, turning = length_and_turning(path, m)
    return length, turning, intrusion(p, path, m, np.inf, stack)


def _tuning(config: PlannerConfig) -> Tuning:
    idle = config.idle_generations
    if config.precise:
        return Tuning(
            config.learners, idle, config.max_evaluations, 12000, idle, 1e-4, idle, 1e-5, 3, 0.05
        )
    return Tuning(
        config.learners, idle, config.max_evaluations, 6000, max(1, idle // 3), 1e-3,
        max(1, idle // 3), 3e-4, 2, 0.1,
    )


class TlboPlanner:
    """Keeps `simloop.planners.protocol.Planner`; its state between calls is scratch only."""

    name = "tlbo"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._overhang = max(vehicle.footprint_offsets_m)
        self._tuning = _tuning(config)
        self._buffers = make_buffers(config.learners)

    def plan(
        self,
        world: WorldView,
        start: FloatArray,
        goal: FloatArray,
        rng: np.random.Generator,
        *,
        previous: Plan | None = None,
        reason: str = "frame",
    ) -> Plan:
        """As the protocol says. A start too close to something: see `make_problem`."""
        config, b = self._config, self._buffers
        problem = make_problem(
            world,
            start,
            goal,
            safe_m=config.safe_distance_m,
            overhang_m=self._overhang,
            length_weight=config.length_weight,
            turning_weight=config.turning_weight,
            start_turn_weight=config.start_turn_weight,
            penalty=config.penalty,
        )
        b.state[:] = make_state(rng)
        warm = self._warm(problem, previous)
        m, generations, evaluations = _solve(problem, self._tuning, warm, b)
        length, turning, lack = _account(problem, b.best, m, b.stack)
        cost = config.length_weight * length + config.turning_weight * turning
        order = np.argsort(b.cost, kind="stable")[:_SHOWN]
        return Plan(
            t_ns=world.t_ns,
            waypoints_m=b.best[:m].copy(),
            cost=cost + config.penalty * lack,
            length_m=length,
            turning_rad=turning,
            safe=lack == 0.0,
            evaluations=evaluations,
            generations=generations,
            planner=self.name,
            reason=reason,
            candidates_m=tuple(b.path[k, :m].copy() for k in order),
        )

    def _warm(self, problem: Problem, previous: Plan | None) -> int:
        """Put what lies ahead of the previous plan into the buffers; 0 if it is of no use."""
        if previous is None or not previous.safe or len(previous.waypoints_m) > MAX_POINTS - 2:
            return 0
        old = np.asarray(previous.waypoints_m)
        goal = np.array([problem.goal_x, problem.goal_y])
        if np.hypot(*(old[-1] - goal)) > 0.05:
            return 0
        here = np.array([problem.start_x, problem.start_y])
        edges = old[1:] - old[:-1]
        squares = np.maximum((edges**2).sum(axis=1), 1e-18)
        t = np.clip(((here - old[:-1]) * edges).sum(axis=1) / squares, 0.0, 1.0)
        nearest = int(np.argmin(np.hypot(*(old[:-1] + t[:, None] * edges - here).T)))
        path = np.vstack([here, old[nearest + 1 : -1], goal])
        b = self._buffers
        b.best[: len(path)] = path
        if intrusion(problem, b.best, len(path), np.inf, b.stack) > 0.0:
            return 0
        return len(path)
