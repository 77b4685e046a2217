"""Potential field whose attraction is deformed by a genetic algorithm.

Source: Mohamed & Abbas 2012. Obstacles on the direct line from start to goal are "frontal". Each
has one gene, an angle in [-pi/2, pi/2] that turns the attraction (Eq. 8) until the point has
crossed that obstacle's frontal line, the perpendicular to the direct line through its centre. The
point moves by Euler steps (Eq. 16) of size H = share x d (Eq. 17), where d is the distance to the
nearest obstacle. The genetic algorithm is of the steady-state type: each generation replaces the
worst chromosomes by offspring of tournament winners.

Differs from the paper: Eqs. 15 and 16 as printed move away from the goal and into obstacles,
because Eqs. 5 and 14 already give the forces and not the gradients. The step here is
H x (Eq. 8 + Eq. 14).

Chosen here, because the paper leaves it open:
- epsilon of Eq. 13 (printed: 0.001 to 0.1) is 0.03, where the unit of length is a hundredth of the
  direct line (the paper's direct lines are 20 to 93 long). The share of Eq. 17 is 0.5, the
  largest that does not oscillate. No step is longer than 0.9 d, so that none ends in an
  obstacle. The last step ends at the goal if the way to it is free.
- mu of Eq. 18 is 10. Half of the population is discarded. 16 in 17 offspring come from crossover,
  the rest from mutation (printed rates: 0.8 and 0.05). Chromosomes of a single gene are not
  crossed. The search ends after ``idle_generations`` consecutive generations that improve by less
  than 1e-4, or at the budget.
- The adjacent distance is twice the largest radius; a path that leaves that strip is invalid. If
  no valid path is found, the distance is doubled (the paper: "twice (or more)"), up to three times.
- Radii are grown by the safe distance. Among polygons and in a distance field the nearest surface
  repels. Frontal obstacles are then the view's discs, or circles about the field's obstacles.
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
from simloop.planners.reactive.rollout import (
    Rollout,
    RolloutPlanner,
    inside_bounds,
    nearest_surface,
)
from simloop.planners.splitmix import State, below, make_state, uniform

POPULATION = 50
TOURNAMENT = 3
CROSSOVER, MUTATION = 0.8, 0.05
DISCARDED = 0.5
EPSILON = 0.03
"""epsilon of Eq. 13, in squared hundredths of the direct line."""
STEP_SHARE = 0.5
"""The share of Eq. 17 (printed there as a partial derivative sign)."""
MU = 10.0
"""mu of Eq. 18: weight of the distance to the goal in an invalid path."""
_MOST_OF_GAP = 0.9
_MOST_STEPS = 4000
_STILL_STEPS = 64  # after this many steps without progress, the forces cancel
_TOLERANCE = 1e-4
_WIDENINGS = 3
_UNITS = 100.0
_LEAST_UNITS = 5.0  # for a goal nearer than this, in safe distances, the unit does not shrink
_FINALISTS = 12


class Classes(NamedTuple):
    """Obstacles classified by their distance from the direct line (Mohamed 2012, Section V.1a).

    Attributes:
        along: (F,) distances from the start at which the frontal lines cross the direct line, m,
            ascending.
        frontal: (K,) whether each disc is frontal.
        adjacent: (K,) whether each disc is adjacent.
        adjacent_m: Half width of the strip that holds the adjacent discs, m.
    """

    along: FloatArray
    frontal: np.ndarray
    adjacent: np.ndarray
    adjacent_m: float


def classify(
    discs: FloatArray, start: FloatArray, goal: FloatArray, safe_m: float, widen: float = 1.0
) -> Classes:
    """Classify discs as frontal, adjacent or, for all others, unrelated.

    Args:
        discs: (K, 3) x, y, radius, m, map frame.
        start: (>= 2,) x, y of the start, m, map frame.
        goal: (>= 2,) x, y of the goal, m, map frame.
        safe_m: Safe distance by which the radii grow, m.
        widen: Factor on the adjacent distance.

    Returns:
        The classes.
    """
    line = np.asarray(goal, dtype=np.float64)[:2] - np.asarray(start, dtype=np.float64)[:2]
    reach = float(np.hypot(*line))
    ux, uy = line / reach if reach > 0.0 else (1.0, 0.0)
    dx, dy = discs[:, 0] - start[0], discs[:, 1] - start[1]
    along, across = ux * dx + uy * dy, np.abs(uy * dx - ux * dy)
    radius = discs[:, 2] + safe_m
    between = (along > 0.0) & (along < reach)
    crossed = between & (across <= radius)
    # Discs no farther away than the radius of the largest disc on the line are frontal, too.
    largest = radius[crossed].max(initial=0.0)
    frontal = between & ((across <= radius) | (across <= largest)) if largest > 0.0 else crossed
    adjacent_m = widen * 2.0 * float(radius.max(initial=safe_m))
    adjacent = across <= adjacent_m
    return Classes(np.sort(along[frontal]), frontal, adjacent, adjacent_m)


class Field(NamedTuple):
    """The force field that a point follows.

    Attributes:
        p: The planning problem, with the obstacles that repel.
        along: (F,) distances from the start at which the frontal lines cross the direct line, m.
        epsilon: Strength of the repulsion (Eq. 13), m^2.
        strip: Largest distance from the direct line, m.
    """

    p: Problem
    along: FloatArray
    epsilon: float
    strip: float


@njit(cache=True)
def roll_out(f: Field, genes: FloatArray, path: FloatArray) -> tuple[int, float, bool]:
    """Follow the field that a chromosome deforms (Mohamed 2012, Eqs. 4-17).

    A path that leaves the strip or the bounds ends there.

    Args:
        f: The field.
        genes: (F,) turns of the attraction, rad, one for each frontal obstacle.
        path: (n, 2) receives the points, m, map frame.

    Returns:
        Number of points, length of the path, m, and whether it ends at the goal.
    """
    p = f.p
    dx, dy = p.goal_x - p.start_x, p.goal_y - p.start_y
    reach = math.hypot(dx, dy)
    ux, uy = dx / reach, dy / reach
    x, y, length = p.start_x, p.start_y, 0.0
    path[0, 0], path[0, 1] = x, y
    for n in range(1, path.shape[0]):
        gx, gy = p.goal_x - x, p.goal_y - y
        left = math.hypot(gx, gy)
        gap, nx, ny = nearest_surface(p, x, y)
        # If the goal is nearer than any obstacle, the straight way to it is free.
        if left <= gap or left < 1e-9:
            path[n, 0], path[n, 1] = p.goal_x, p.goal_y
            return n + 1, length + left, True
        gap = max(gap, 1e-3 * p.safe_m)
        s = ux * (x - p.start_x) + uy * (y - p.start_y)
        # The gene of the next frontal line applies; there is no deformation beyond the last line.
        turn = 0.0
        for j in range(f.along.size):
            if s < f.along[j]:
                turn = genes[j]
                break
        # Attraction of unit size (Eqs. 7, 8) plus repulsion from the nearest surface (Eq. 14).
        theta = math.atan2(gy, gx) + turn
        push = f.epsilon / (gap * gap)
        fx, fy = math.cos(theta) + push * nx, math.sin(theta) + push * ny
        # Eq. 17, shortened so that the step does not end in the obstacle.
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
    """Compute the fitness of a chromosome (Mohamed 2012, Eq. 18); counts as a trial.

    Args:
        f: The field.
        genes: (F,) turns of the attraction, rad.
        path: (n, 2) scratch for the points.

    Returns:
        1 / length of a valid path; 1 / (length + mu x distance left) of an invalid one, 1/m.
    """
    f.p.trials[0] += 1
    n, length, reached = roll_out(f, genes, path)
    if not reached:
        last = path[n - 1]
        length += MU * math.hypot(f.p.goal_x - last[0], f.p.goal_y - last[1])
    return 1.0 / max(length, 1e-9)


@njit(cache=True)
def tournament(fit: FloatArray, count: int, state: State) -> int:
    """Draw `TOURNAMENT` chromosomes uniformly, with replacement, and select the fittest.

    Args:
        fit: (n,) fitness.
        count: Number of chromosomes, from the first, that take part.
        state: (1,) random state, advanced.

    Returns:
        Index of the winner.
    """
    best = below(state, count)
    for _ in range(TOURNAMENT - 1):
        k = below(state, count)
        if fit[k] > fit[best]:
            best = k
    return best


@njit(cache=True)
def breed(genes: FloatArray, fit: FloatArray, kept: int, state: State) -> None:
    """Replace the discarded chromosomes by offspring of the kept ones.

    Args:
        genes: (n, F) population, rad; the rows from ``kept`` on are overwritten.
        fit: (n,) fitness.
        kept: Number of chromosomes that stay.
        state: (1,) random state, advanced.
    """
    size, count = genes.shape
    row = kept
    while row < size:
        if count > 1 and uniform(state) * (CROSSOVER + MUTATION) < CROSSOVER:
            # One-point crossover: two parents, two children with the tails swapped.
            a, b = tournament(fit, kept, state), tournament(fit, kept, state)
            cut = 1 + below(state, count - 1)
            for first, second in ((a, b), (b, a)):
                if row < size:
                    for j in range(count):
                        genes[row, j] = genes[first, j] if j < cut else genes[second, j]
                    row += 1
        else:
            # Mutation: one gene of a copied winner is drawn again.
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
    """Run the steady-state genetic algorithm from a random population.

    Args:
        f: The field.
        genes: (n, F) receives the last population, rad, the fittest first.
        fit: (n,) receives its fitness, 1/m.
        idle_limit: Number of generations without improvement after which the search ends.
        budget: Largest number of fitness evaluations.
        path: (m, 2) scratch for the points.
        state: (1,) random state, advanced.

    Returns:
        Number of generations after the first.
    """
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


class GaApf(RolloutPlanner):
    """Deforms the field of the view's discs anew for each plan."""

    name = "ga_apf"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._path = np.zeros((_MOST_STEPS, 2))

    def _make_rollout(
        self, world: WorldView, rng: np.random.Generator
    ) -> Callable[[Problem, int], Rollout]:
        discs, state = _discs(world), make_state(rng)
        return lambda p, attempt: self._search(p, discs, state)

    def _search(self, p: Problem, discs: FloatArray, state: State) -> Rollout:
        """Evolve in the strip, and in wider strips while no path reaches the goal safely."""
        start, goal = np.array([p.start_x, p.start_y]), np.array([p.goal_x, p.goal_y])
        reach = math.dist(start, goal)
        if reach < 1e-9:
            return Rollout(np.vstack([start, goal]), True, 0)
        unit = max(reach, _LEAST_UNITS * p.safe_m) / _UNITS
        before, generations = int(p.trials[0]), 0
        done = Rollout(start[None], False, 0)
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

    def _fittest(self, field: Field, p: Problem, genes: FloatArray) -> Rollout:
        """Return the fittest chromosome whose whole path is safe, else the fittest."""
        rollouts = []
        for row in genes[:_FINALISTS]:
            count, _, reached = roll_out(field, row, self._path)
            rollouts.append(Rollout(self._path[:count].copy(), reached, 0))
        shown = tuple(one.path for one in rollouts)
        for one in rollouts:
            if one.reached and lack_of(p, one.path) == 0.0:
                return one._replace(candidates=shown)
        return rollouts[0]._replace(candidates=shown)


def _discs(world: WorldView) -> FloatArray:
    """Return the view's discs (K, 3), or circles about the obstacles of a mere distance field."""
    discs = np.asarray(world.discs_xyr_m, dtype=np.float64).reshape(-1, 3)
    if len(discs) or not world.distance_m.size:
        return discs
    return discs_of(world.distance_m <= 0.0, world.origin_m, world.resolution_m)


def _among(p: Problem, discs: FloatArray, keep: np.ndarray) -> Problem:
    """Return the problem with only the adjacent discs; a distance field stays as it is."""
    if p.field.size or len(discs) != p.discs.shape[1]:
        return p
    return p._replace(discs=np.ascontiguousarray(discs[keep].T))
