"""The potential field whose attraction a genetic algorithm deforms.

Source: Mohamed & Abbas 2012. Obstacles that stand on the direct line from start to goal are
frontal, one gene each: an angle in [-pi/2, pi/2] by which the attraction is turned until the point
has crossed that obstacle's frontal line, the perpendicular to the direct line through its centre.
The point moves by Euler steps of H = share x d, d being the distance to the nearest obstacle. The
genetic algorithm is a steady state one: each generation the worst are discarded and replaced by
offspring of tournament winners.

Read differently than printed:
- Eqs. 15-16 as printed move away from the goal and into obstacles, for Eqs. 5 and 14 already hold
  the forces and not the gradients; the step is H x (Eq. 8 + Eq. 14).
Filled in, for the text leaves it open:
- epsilon (said to be .001 to .1) is .03, in units of a hundredth of the direct line (their maps are
  60 to 120 wide); the share is .5, the largest that does not oscillate; no step is longer than .9
  d, so that none ends in an obstacle; the last one ends at the goal, if the way there is free.
- mu of Eq. 18 is 10; half of the population is discarded; of the offspring 16 in 17 come from
  crossover, the rest from mutation (the rates are .8 and .05); a chromosome that is alone in its
  length 1 is not crossed. It ends when ``idle_generations`` bring less than 1e-4, or at the budget.
- The adjacent distance is twice the largest radius; a path that leaves that strip is not valid.
  Where no valid path is found it is doubled (the text: "twice (or more)"), up to three times.
- Radii are grown by the safe distance. Among polygons and in a distance field the nearest surface
  repels; frontal obstacles are the view's discs, or circles about the field's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.config import PlannerConfig, VehicleConfig
from simloop.geometry.discs import discs_of
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.account import lack_of
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.rollout import Walk, WalkingPlanner, inside_bounds, surface
from simloop.planners.splitmix import State, below, make_state, uniform

POPULATION = 50
TOURNAMENT = 3
CROSSOVER, MUTATION = 0.8, 0.05
DISCARDED = 0.5
EPSILON = 0.03
STEP_SHARE = 0.5
MU = 10.0
_MOST_OF_GAP = 0.9
_MOST_STEPS = 4000
_STILL_STEPS = 64  # who comes nowhere in so many steps stays where the forces cancel
_TOLERANCE = 1e-4
_WIDENINGS = 3
_UNITS = 100.0
_LEAST_UNITS = 5.0  # of a safe distance: near the goal the field does not shrink with the way left


class Classes(NamedTuple):
    """Obstacles sorted by what they mean for the direct line.

    along: (F,) where along the direct line, m, the frontal lines cross it, ascending. frontal,
    adjacent: (K,) bool. adjacent_m: half width of the strip that holds the adjacent ones.
    """

    along: FloatArray
    frontal: np.ndarray
    adjacent: np.ndarray
    adjacent_m: float


def classify(
    discs: FloatArray, start: FloatArray, goal: FloatArray, safe_m: float, widen: float = 1.0
) -> Classes:
    """Frontal, adjacent and (all others) unrelated discs (K, 3), grown by ``safe_m``."""
    line = np.asarray(goal, dtype=np.float64)[:2] - np.asarray(start, dtype=np.float64)[:2]
    reach = float(np.hypot(*line))
    ux, uy = line / reach if reach > 0.0 else (1.0, 0.0)
    dx, dy = discs[:, 0] - start[0], discs[:, 1] - start[1]
    along, across = ux * dx + uy * dy, np.abs(uy * dx - ux * dy)
    radius = discs[:, 2] + safe_m
    between = (along > 0.0) & (along < reach)
    crossed = between & (across <= radius)
    largest = radius[crossed].max(initial=0.0)
    frontal = between & ((across <= radius) | (across <= largest)) if largest > 0.0 else crossed
    adjacent_m = widen * 2.0 * float(radius.max(initial=safe_m))
    adjacent = across <= adjacent_m
    return Classes(np.sort(along[frontal]), frontal, adjacent, adjacent_m)


class Field(NamedTuple):
    """What a path is rolled out in. epsilon, m^2; strip: the adjacent distance, m."""

    p: Problem
    along: FloatArray
    epsilon: float
    strip: float


@njit(cache=True)
def roll_out(f: Field, genes: FloatArray, path: FloatArray) -> tuple[int, float, bool]:
    """Eqs. 4-17: the path (n, 2) of a chromosome (F,); its count of points, length, and whether
    it ends at the goal. One that leaves the strip or the bounds ends there."""
    p = f.p
    dx, dy = p.goal_x - p.start_x, p.goal_y - p.start_y
    reach = math.hypot(dx, dy)
    ux, uy = dx / reach, dy / reach
    x, y, length = p.start_x, p.start_y, 0.0
    path[0, 0], path[0, 1] = x, y
    for n in range(1, path.shape[0]):
        gx, gy = p.goal_x - x, p.goal_y - y
        left = math.hypot(gx, gy)
        gap, nx, ny = surface(p, x, y)
        if left <= gap or left < 1e-9:
            path[n, 0], path[n, 1] = p.goal_x, p.goal_y
            return n + 1, length + left, True
        gap = max(gap, 1e-3 * p.safe_m)
        s = ux * (x - p.start_x) + uy * (y - p.start_y)
        turn = 0.0
        for j in range(f.along.size):
            if s < f.along[j]:
                turn = genes[j]
                break
        theta = math.atan2(gy, gx) + turn
        push = f.epsilon / (gap * gap)
        fx, fy = math.cos(theta) + push * nx, math.sin(theta) + push * ny
        step = STEP_SHARE * gap
        size = step * math.hypot(fx, fy)
        if size > _MOST_OF_GAP * gap:
            step *= _MOST_OF_GAP * gap / size
        x, y = x + step * fx, y + step * fy
        length += step * math.hypot(fx, fy)
        across = abs(uy * (x - p.start_x) - ux * (y - p.start_y))
        if across > f.strip or not inside_bounds(p, x, y):
            return n, length, False
        path[n, 0], path[n, 1] = x, y
        if n % _STILL_STEPS == 0:
            back = path[n - _STILL_STEPS]
            if math.hypot(x - back[0], y - back[1]) < math.sqrt(f.epsilon):
                return n + 1, length, False
    return path.shape[0], length, False


@njit(cache=True)
def fitness(f: Field, genes: FloatArray, path: FloatArray) -> float:
    """Eq. 18: the inverse of the length; of length and mu x what is left, where it fails."""
    f.p.trials[0] += 1
    n, length, reached = roll_out(f, genes, path)
    if not reached:
        last = path[n - 1]
        length += MU * math.hypot(f.p.goal_x - last[0], f.p.goal_y - last[1])
    return 1.0 / max(length, 1e-9)


@njit(cache=True)
def tournament(fit: FloatArray, count: int, state: State) -> int:
    """The fittest of three of the first ``count``, drawn uniformly."""
    best = below(state, count)
    for _ in range(TOURNAMENT - 1):
        k = below(state, count)
        if fit[k] > fit[best]:
            best = k
    return best


@njit(cache=True)
def breed(genes: FloatArray, fit: FloatArray, kept: int, state: State) -> None:
    """Fill the rows from ``kept`` on with offspring of the others."""
    size, count = genes.shape
    row = kept
    while row < size:
        if count > 1 and uniform(state) * (CROSSOVER + MUTATION) < CROSSOVER:
            a, b = tournament(fit, kept, state), tournament(fit, kept, state)
            cut = 1 + below(state, count - 1)
            for first, second in ((a, b), (b, a)):
                if row < size:
                    for j in range(count):
                        genes[row, j] = genes[first, j] if j < cut else genes[second, j]
                    row += 1
        else:
            a = tournament(fit, kept, state)
            for j in range(count):
                genes[row, j] = genes[a, j]
            genes[row, below(state, count)] = math.pi * (uniform(state) - 0.5)
            row += 1


@njit(cache=True)
def evolve(
    f: Field,
    genes: FloatArray,
    fit: FloatArray,
    idle_limit: int,
    budget: int,
    path: FloatArray,
    state: State,
) -> int:
    """Steady-state genetic algorithm; genes (n, F) and fit (n,) end sorted, the fittest first.
    How many generations; ``budget`` counts roll-outs."""
    size, count = genes.shape
    for k in range(size):
        for j in range(count):
            genes[k, j] = math.pi * (uniform(state) - 0.5)
        fit[k] = fitness(f, genes[k], path)
    kept = size - int(DISCARDED * size)
    spent, idle, generations = size, 0, 0
    order = np.argsort(-fit, kind="mergesort")
    genes[:], fit[:] = genes[order], fit[order]
    best = fit[0]
    while idle < idle_limit and spent + size - kept <= budget:
        breed(genes, fit, kept, state)
        for k in range(kept, size):
            fit[k] = fitness(f, genes[k], path)
        spent += size - kept
        order = np.argsort(-fit, kind="mergesort")
        genes[:], fit[:] = genes[order], fit[order]
        generations += 1
        idle = 0 if fit[0] > best * (1.0 + _TOLERANCE) else idle + 1
        best = max(best, fit[0])
    return generations


class GaApf(WalkingPlanner):
    """The field of a view's discs, deformed anew for each plan."""

    name = "ga_apf"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._path = np.zeros((_MOST_STEPS, 2))

    def _walker(self, world: WorldView, rng: np.random.Generator) -> Callable[[Problem, int], Walk]:
        discs, state = _discs(world), make_state(rng)
        return lambda p, attempt: self._search(p, discs, state)

    def _search(self, p: Problem, discs: FloatArray, state: State) -> Walk:
        """Evolve in the strip, and in wider ones as long as nothing gets to the goal safely."""
        start, goal = np.array([p.start_x, p.start_y]), np.array([p.goal_x, p.goal_y])
        reach = math.dist(start, goal)
        if reach < 1e-9:
            return Walk(np.vstack([start, goal]), True, 0)
        unit = max(reach, _LEAST_UNITS * p.safe_m) / _UNITS
        before, generations = int(p.trials[0]), 0
        done = Walk(start[None], False, 0)
        for widening in range(1 + _WIDENINGS):
            found = classify(discs, start, goal, p.safe_m, 2.0**widening)
            field = Field(
                _among(p, discs, found.adjacent), found.along, EPSILON * unit**2, found.adjacent_m
            )
            size = POPULATION if len(found.along) else 1
            genes, fit = np.zeros((size, len(found.along))), np.zeros(size)
            idle = self._config.idle_generations if len(found.along) else 0
            left = self._config.max_evaluations - (int(p.trials[0]) - before)
            if left < size:
                break
            generations += evolve(field, genes, fit, idle, left, self._path, state)
            done = self._fittest(field, p, genes)
            if done.reached and lack_of(p, done.path) == 0.0:
                break
        return done._replace(evaluations=int(p.trials[0]) - before, generations=generations)

    def _fittest(self, field: Field, p: Problem, genes: FloatArray) -> Walk:
        """The fittest chromosome whose whole path is safe, else the fittest."""
        walks = []
        for row in genes[:12]:
            count, _, reached = roll_out(field, row, self._path)
            walks.append(Walk(self._path[:count].copy(), reached, 0))
        shown = tuple(walk.path for walk in walks)
        for walk in walks:
            if walk.reached and lack_of(p, walk.path) == 0.0:
                return walk._replace(candidates=shown)
        return walks[0]._replace(candidates=shown)


def _discs(world: WorldView) -> FloatArray:
    """The view's discs (K, 3); where it has a distance field alone, circles about what it holds."""
    discs = np.asarray(world.discs_xyr_m, dtype=np.float64).reshape(-1, 3)
    if len(discs) or not world.distance_m.size:
        return discs
    return discs_of(world.distance_m <= 0.0, world.origin_m, world.resolution_m)


def _among(p: Problem, discs: FloatArray, keep: np.ndarray) -> Problem:
    """The problem with the adjacent discs alone; in a distance field there is nothing to leave."""
    if p.field.size or len(discs) != p.discs.shape[1]:
        return p
    return p._replace(discs=np.ascontiguousarray(discs[keep].T))
