"""The lead planner: teaching-learning-based optimisation of the whole path, in milliseconds.

Source: Sabiha 2022 (online TLBO), Sections 3-4. One call goes from coarse to fine:

    routes of different homotopy, and the best mixture of them
    -> pulled taut, their bends split
    -> a class of learners about each route that may yet win, taught by TLBO
    -> the best learner of all

What lies ahead of the previous plan competes as one more route, with a small bonus. The robot
therefore keeps its way unless that is blocked or a clearly better one has opened.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, Plan
from simloop.planners.problem.account import account, problem_of
from simloop.planners.problem.bends import MAX_POINTS, copy_path, refine, settle, without_twins
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import (
    LEAST_INTRUSION_M,
    evaluate,
    intrusion,
    length_and_turning,
    make_stack,
)
from simloop.planners.protocol import PlanningTask
from simloop.planners.splitmix import State, make_state
from simloop.planners.tlbo.lines import Lines, decode, encode, make_lines, nearby
from simloop.planners.tlbo.recombine import recombine
from simloop.planners.tlbo.routes import find_routes, sort_routes
from simloop.planners.tlbo.tlbo import Class, make_class, tlbo
from simloop.planners.tlbo.warm import way_ahead

_SWEEPS = 4
_SHOWN = 12
_HERE_M = 1e-6
_MENDED = 2  # most routes without clearance that get a class
_ROUTES, _ROUTES_PRECISE = 12, 24
_LOYALTY = 0.98
"""Below this share of the old way's cost a new one is taken."""


class Tuning(NamedTuple):
    """How much work each step does: one set for a normal plan, one for ``precise``.

    Attributes:
        idle: Idle generations that end TLBO.
        tolerance: Gain, as a share of J, below which a generation is idle.
        budget: Most trials.
        nodes: About how many nodes the lattice of the route search has.
        rivals: How many routes at most get a class.
        rival_margin: How much costlier than the best a rival may be, as a share.
        splits: How often bends are split, see `refine`.
        least_turn: Turn below which a bend is not split, rad.
    """

    idle: int
    tolerance: float
    budget: int
    nodes: int
    rivals: int
    rival_margin: float
    splits: int
    least_turn: float


class Buffers(NamedTuple):
    """Scratch that a planner owns; nothing in it outlives a call.

    Attributes:
        learners: The class.
        lines: The coded path.
        stack: Scratch for the clearance of segments.
        routes: (K, MAX_POINTS, 2) the routes, m.
        counts: (K,) how many points each route has.
        costs: (K,) J of each route.
        scratch: (2, MAX_POINTS, 2) for `settle`.
        best: (MAX_POINTS, 2) the old way at first, the best path in the end, m.
        shown: (., MAX_POINTS, 2) some learners' paths, to look at, m.
        state: (1,) of the random generator.
    """

    learners: Class
    lines: Lines
    stack: FloatArray
    routes: FloatArray
    counts: NDArray[np.int32]
    costs: FloatArray
    scratch: FloatArray
    best: FloatArray
    shown: FloatArray
    state: State


def make_buffers(learners: int, routes: int) -> Buffers:
    """Make the buffers of a planner.

    Args:
        learners: How many learners a class has.
        routes: How many routes are sought. There is room for three more: their best mixture, the
            straight line and the old way.

    Returns:
        The buffers.
    """
    stack = make_stack()
    return Buffers(
        learners=make_class(learners, stack),
        lines=make_lines(),
        stack=stack,
        routes=np.zeros((routes + 3, MAX_POINTS, 2)),
        counts=np.zeros(routes + 3, dtype=np.int32),
        costs=np.zeros(routes + 3),
        scratch=np.zeros((2, MAX_POINTS, 2)),
        best=np.zeros((MAX_POINTS, 2)),
        shown=np.zeros((_SHOWN, MAX_POINTS, 2)),
        state=np.zeros(1, dtype=np.uint64),
    )


@njit(cache=True)
def _gather(p: Problem, nodes: int, warm: int, solid: bool, b: Buffers) -> int:
    """Fill b.routes, cheapest first, with all that may be worth a class; how many.

    warm: how many points of the old way lie in b.best, 0 for none. solid: see `make_lattice`.
    """
    most = b.counts.size - 3
    found = find_routes(
        p, nodes, _SWEEPS, b.routes[:most], b.counts[:most], b.costs[:most], b.stack, solid
    )
    # The best mixture of the routes.
    m = recombine(p, b.routes, b.counts, found, np.inf, b.routes[found], b.stack)
    if m > 0:
        b.counts[found], b.costs[found] = settle(p, b.routes[found], m, _SWEEPS, b.scratch, b.stack)
        found += 1
    # The straight line, if it is clear.
    line = b.routes[found]
    line[0, 0], line[0, 1] = p.start_x, p.start_y
    line[1, 0], line[1, 1] = p.goal_x, p.goal_y
    b.counts[found], b.costs[found] = 2, evaluate(p, line, 2, np.inf, b.stack)
    if intrusion(p, line, 2, np.inf, b.stack) == 0.0:
        found += 1
    # The old way, with a bonus.
    if warm > 0:
        copy_path(b.best, warm, b.routes[found])
        m, cost = settle(p, b.routes[found], warm, _SWEEPS, b.scratch, b.stack)
        b.counts[found], b.costs[found] = m, cost * _LOYALTY
        found += 1
    sort_routes(b.routes, b.counts, b.costs, found)
    return found


@njit(cache=True)
def _teach(
    p: Problem, tune: Tuning, k: int, least: float, b: Buffers
) -> tuple[float, int, int, int]:
    """Let a class about route k learn; where it beats ``least``, its best path goes to b.best.

    Returns its cost (inf where it does not), its count of points, the generations, and how many
    learners are shown.
    """
    m = refine(p, b.routes[k], b.counts[k], tune.splits, tune.least_turn, b.stack)
    m = without_twins(b.routes[k], m)
    free = encode(p, b.routes[k], m, b.lines, b.stack)
    plain = evaluate(p, b.routes[k], m, np.inf, b.stack)
    teacher, generations, cost = 0, 0, np.inf
    if free > 0:
        near = nearby(p, b.routes[k], m)
        teacher, generations = tlbo(
            near, b.lines, b.learners, free, m, tune.idle, tune.tolerance, tune.budget, b.state
        )
        cost = b.learners.cost[teacher]
    if min(cost, plain) >= least:
        return np.inf, 0, generations, 0
    if plain <= cost:
        copy_path(b.routes[k], m, b.best)
        return plain, m, generations, 0
    decode(p, b.lines, b.learners.subject[teacher], free, m, b.best)
    return cost, m, generations, _show(p, b, free, m)


@njit(cache=True)
def _deserves_class(p: Problem, k: int, least: float, b: Buffers) -> bool:
    """Whether route k would be much cheaper than ``least`` if it did not lack clearance."""
    length, turning = length_and_turning(b.routes[k], b.counts[k])
    plain = p.length_weight * length + p.turning_weight * turning
    unsafe = b.costs[k] > plain + 0.5 * p.penalty * LEAST_INTRUSION_M
    return unsafe and plain < _LOYALTY * least


@njit(cache=True)
def _solve(p: Problem, tune: Tuning, warm: int, b: Buffers) -> tuple[int, int, int]:
    """Plan into b.best; its count of points, the generations, and how many learners are shown.

    The cheapest routes get a class, then those that lack some clearance, because a class may find
    it. If nothing safe is found, a finer lattice is tried in which no wall is too thin to stop the
    wave.
    """
    if math.hypot(p.goal_x - p.start_x, p.goal_y - p.start_y) < _HERE_M:
        b.best[0, 0], b.best[0, 1] = p.start_x, p.start_y
        b.best[1, 0], b.best[1, 1] = p.goal_x, p.goal_y
        return 2, 0, 0
    least, best_m, generations, shown = np.inf, 0, 0, 0
    for attempt in range(2):
        if attempt > 0 and intrusion(p, b.best, best_m, np.inf, b.stack) == 0.0:
            break
        nodes = tune.nodes if attempt == 0 else tune.nodes * 3 // 2
        found = _gather(p, nodes, warm if attempt == 0 else 0, attempt > 0, b)
        mended = 0
        for k in range(found):
            good = k < tune.rivals and b.costs[k] <= (1.0 + tune.rival_margin) * b.costs[0]
            if not good:
                if mended == _MENDED or not _deserves_class(p, k, least, b):
                    continue
                mended += 1
            cost, m, spent, seen = _teach(p, tune, k, least, b)
            generations += spent
            if m > 0:
                least, best_m, shown = cost, m, seen
    return best_m, generations, shown


@njit(cache=True)
def _show(p: Problem, b: Buffers, free: int, m: int) -> int:
    """Write the paths of some learners into b.shown, to look at; how many."""
    for k in range(min(_SHOWN, b.learners.cost.size)):
        decode(p, b.lines, b.learners.subject[k], free, m, b.shown[k])
    return min(_SHOWN, b.learners.cost.size)


def _tuning(config: PlannerConfig) -> Tuning:
    """The work for a config.

    A normal plan has little time: it waits for a fifteenth of the idle generations, ``precise``
    for a third, and it tries fewer and coarser routes.
    """
    idle, budget = config.idle_generations, config.max_evaluations
    if config.precise:
        return Tuning(max(1, idle // 3), 1e-5, budget, 8000, 4, 0.02, 3, 0.05)
    return Tuning(max(1, idle // 15), 1e-3, budget, 4000, 3, 0.01, 2, 0.2)


class TlboPlanner:
    """The lead planner; it follows `simloop.planners.protocol.Planner`."""

    name = "tlbo"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._overhang = max(vehicle.footprint_offsets_m)
        self._tuning = _tuning(config)
        routes = _ROUTES_PRECISE if config.precise else _ROUTES
        self._buffers = make_buffers(config.learners, routes)

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """Plan a path for a task.

        Args:
            task: Where to plan. If the start is too close to something: see `make_problem`.
            rng: The only source of randomness; one number is drawn.

        Returns:
            The plan, with some of the last class as its candidates.
        """
        b = self._buffers
        problem = problem_of(self._config, self._overhang, task)
        b.state[:] = make_state(rng)
        warm = self._warm(problem, task.previous)
        m, generations, shown = _solve(problem, self._tuning, warm, b)
        return account(
            self.name,
            task,
            problem,
            b.best[:m].copy(),
            evaluations=int(problem.trials[0]),
            generations=generations,
            candidates_m=tuple(b.shown[k, :m].copy() for k in range(shown)),
        )

    def _warm(self, problem: Problem, previous: Plan | None) -> int:
        """Put what lies ahead of the previous plan into b.best.

        Returns how many points it has: 0 if it is no longer safe or leads elsewhere.
        """
        path = way_ahead(problem, previous)
        if path is None or len(path) > MAX_POINTS - 1:
            return 0
        b = self._buffers
        b.best[: len(path)] = path
        if intrusion(problem, b.best, len(path), np.inf, b.stack) > 0.0:
            return 0
        return len(path)
