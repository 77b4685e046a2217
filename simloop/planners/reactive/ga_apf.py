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
  no path reaches the goal, the distance is doubled (the paper: "twice (or more)"), up to three
  times.
- A gene turns the attraction by a right angle at most, so no path leads backwards out of a pocket
  between two obstacles. The paper's starts are in none, but a vehicle that finds a gap closed is.
  Its path then begins with a straight leg sidewards or backwards, after which the search is tried
  again.
- Radii are grown by the safe distance. Among polygons and in a distance field the nearest surface
  repels. Frontal obstacles are then the view's discs, or circles about the field's obstacles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from simloop.config import PlannerConfig, VehicleConfig
from simloop.geometry.discs import discs_of
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.account import lack_of
from simloop.planners.problem.clearance import Problem
from simloop.planners.reactive.deformed_field import MOST_STEPS, Field, walk
from simloop.planners.reactive.evolution import POPULATION, Herd, evolve, make_herd
from simloop.planners.reactive.rollout import RollOut, Rollout, RolloutPlanner
from simloop.planners.reactive.surface import inside_bounds
from simloop.planners.splitmix import State, make_state

EPSILON = 0.03
"""epsilon of Eq. 13, in squared hundredths of the direct line."""
_WIDENINGS = 3
_UNITS = 100.0
_LEAST_UNITS = 5.0  # for a goal nearer than this, in safe distances, the unit does not shrink
_FINALISTS = 12
_BACK_SAFE = (4.0, 8.0, 12.0)  # lengths of the leg back, in safe distances
_BACK_RAD = (0.0, 0.25 * math.pi, -0.25 * math.pi, 0.5 * math.pi, -0.5 * math.pi)
_MOST_BACK = 6


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


class GaApf(RolloutPlanner):
    """Deforms the field of the view's discs anew for each plan."""

    name = "ga_apf"
    keeps_way = True

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._path = np.zeros((MOST_STEPS, 2))

    def _make_rollout(self, world: WorldView, rng: np.random.Generator) -> RollOut:
        discs, state = _discs(world), make_state(rng)
        return lambda p, attempt, most_m: self._search_with_way_back(p, discs, state)

    def _search_with_way_back(self, p: Problem, discs: FloatArray, state: State) -> Rollout:
        """Search from the start and, if no path of a vehicle reaches the goal, from behind it."""
        done = self._search(p, discs, state)
        if done.reached or p.overhang_m == 0.0:
            return done
        here, spent = np.array([p.start_x, p.start_y]), done.evaluations
        for x, y in _places_behind(p):
            behind = p._replace(start_x=x, start_y=y, start_slack=0.0)
            other = self._search(behind, discs, state)
            spent += other.evaluations
            if other.reached:
                return other._replace(
                    path=np.vstack([here, other.path]),
                    others=tuple(np.vstack([here, path]) for path in other.others),
                    evaluations=spent,
                )
        return done._replace(evaluations=spent)

    def _search(self, p: Problem, discs: FloatArray, state: State) -> Rollout:
        """Evolve in the strip, and in wider strips while no path reaches the goal in safety.

        A path may leave the strip, where the field does not know the discs.
        """
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
            idle = self._config.idle_generations if len(found.along) else 0
            left = self._config.max_evaluations - (int(p.trials[0]) - before)
            if left < size:
                break
            herd = make_herd(size, len(found.along))
            generations += evolve(field, herd, idle, left, state)
            fittest = self._fittest(field, herd)
            done = fittest if fittest.reached or not done.reached else done
            if fittest.reached and _is_clear(p, fittest):
                break
        return done._replace(evaluations=int(p.trials[0]) - before, generations=generations)

    def _fittest(self, field: Field, herd: Herd) -> Rollout:
        """Return the fittest chromosome that reaches the goal, and the others that do, in order."""
        rollouts: list[Rollout] = []
        rows = herd.genes[:_FINALISTS]
        for k, row in enumerate(rows):
            if k and np.array_equal(row, rows[k - 1]):
                rollouts.append(rollouts[-1])
                continue
            count, _, reached, _ = walk(field, row, herd.notes[k], 0, np.inf, self._path)
            rollouts.append(Rollout(self._path[:count].copy(), reached, 0))
        shown = tuple(one.path for one in rollouts)
        valid = [one for one in rollouts if one.reached]
        if not valid:
            return rollouts[0]._replace(candidates=shown)
        others = {id(one.path): one.path for one in valid[1:] if one.path is not valid[0].path}
        return valid[0]._replace(candidates=shown, others=tuple(others.values()))


def _is_clear(p: Problem, done: Rollout) -> bool:
    """Return whether one of the paths keeps the safe distance as a point's path."""
    if p.field.size:  # it holds all obstacles, so the walk has kept clear of them
        return True
    point = p._replace(overhang_m=0.0)
    return any(lack_of(point, path) == 0.0 for path in (done.path, *done.others))


def _places_behind(p: Problem) -> list[tuple[float, float]]:
    """Return places beside and behind the start, as seen from the goal, that a leg reaches."""
    away = math.atan2(p.start_y - p.goal_y, p.start_x - p.goal_x)
    places: list[tuple[float, float]] = []
    for reach in _BACK_SAFE:
        for turn in _BACK_RAD:
            x = p.start_x + reach * p.safe_m * math.cos(away + turn)
            y = p.start_y + reach * p.safe_m * math.sin(away + turn)
            if inside_bounds(p, x, y) and not lack_of(
                p, np.array([[p.start_x, p.start_y], [x, y]])
            ):
                places.append((x, y))
    return places[:_MOST_BACK]


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
