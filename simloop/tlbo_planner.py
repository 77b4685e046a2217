"""The lead planner: teaching-learning-based optimisation of the whole path, in milliseconds.

Source: Sabiha 2022 (online TLBO), Sections 3-4. One call refines paths from coarse to fine:

    routes of different homotopy, and the best mixture of them
    -> routes pulled taut, with split bends
    -> a class of learners about each promising route, optimised by TLBO
    -> the best learner of all classes

The remaining part of the previous plan competes as one more route, with a small bonus. The robot
therefore keeps its way unless it is blocked or a clearly better one exists.
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
_MENDED = 2  # largest number of routes without enough clearance that get a class
_ROUTES, _ROUTES_PRECISE = 12, 24
_LOYALTY = 0.98
"""A new way replaces the old one if it costs less than this share of it."""


class Tuning(NamedTuple):
    """Effort of each step: one set for a normal plan, one for ``precise``.

    Attributes:
        idle: Number of idle generations after which TLBO stops.
        tolerance: Gain, as a share of J, below which a generation is idle.
        budget: Largest number of trials.
        nodes: Approximate number of nodes in the lattice of the route search.
        rivals: Largest number of routes that get a class because they are cheap.
        rival_margin: Extra cost over the best route that such a route may have, as a share.
        splits: Number of times that bends are split, see `refine`.
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
    """Scratch arrays of a planner; they carry nothing over from one call to the next.

    Attributes:
        learners: The class.
        lines: The coded path.
        stack: Scratch for the clearance of segments.
        routes: (K, MAX_POINTS, 2) the routes, m.
        counts: (K,) number of points of each route.
        costs: (K,) J of each route.
        scratch: (2, MAX_POINTS, 2) for `settle`.
        best: (MAX_POINTS, 2) the old way at first, the best path at the end, m.
        shown: (., MAX_POINTS, 2) paths of some learners, for display, m.
        state: (1,) state of the random generator.
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
        learners: Number of learners in a class.
        routes: Largest number of routes. There is room for three more: their best mixture, the
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
    """Fill b.routes with all candidates for a class, the cheapest first; return their number.

    warm: number of points of the old way in b.best, 0 for none. solid: see `make_lattice`.
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
    # The straight line, if it keeps the safe distance.
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
    """Optimise a class about route k; if it beats ``least``, write its best path to b.best.

    Returns its cost (inf if it does not beat ``least``), its number of points, the number of
    generations, and the number of learners that are shown.
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
    """Whether route k has too little clearance but would otherwise be much cheaper than ``least``.

    A class may find the missing clearance.
    """
    length, turning = length_and_turning(b.routes[k], b.counts[k])
    plain = p.length_weight * length + p.turning_weight * turning
    unsafe = b.costs[k] > plain + 0.5 * p.penalty * LEAST_INTRUSION_M
    return unsafe and plain < _LOYALTY * least


@njit(cache=True)
def _solve(p: Problem, tune: Tuning, warm: int, b: Buffers) -> tuple[int, int, int]:
    """Plan into b.best; return its number of points, of generations, and of learners shown.

    The cheapest routes get a class, then the routes with too little clearance, because a class may
    find it. If nothing safe is found, a finer lattice is tried, in which no wall is too thin to
    stop the wave.
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
    """Write the paths of some learners into b.shown, for display; return their number."""
    for k in range(min(_SHOWN, b.learners.cost.size)):
        decode(p, b.lines, b.learners.subject[k], free, m, b.shown[k])
    return min(_SHOWN, b.learners.cost.size)


def _tuning(config: PlannerConfig) -> Tuning:
    """Choose the effort that a config allows.

    A normal plan has little time: it allows a fifteenth of the idle generations, ``precise`` a
    third. It also tries fewer and coarser routes.
    """
    idle, budget = config.idle_generations, config.max_evaluations
    if config.precise:
        return Tuning(max(1, idle // 3), 1e-5, budget, 8000, 4, 0.02, 3, 0.05)
    return Tuning(max(1, idle // 15), 1e-3, budget, 4000, 3, 0.01, 2, 0.2)


class TlboPlanner:
    """The lead planner; it implements `simloop.planners.protocol.Planner`."""

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
            task: The task. For a start that is too close to an obstacle see `make_problem`.
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
        """Put the remaining part of the previous plan into b.best.

        Returns its number of points: 0 if it is no longer safe or leads elsewhere.
        """
        path = way_ahead(problem, previous)
        if path is None or len(path) > MAX_POINTS - 1:
            return 0
        b = self._buffers
        b.best[: len(path)] = path
        if intrusion(problem, b.best, len(path), np.inf, b.stack) > 0.0:
            return 0
        return len(path)
