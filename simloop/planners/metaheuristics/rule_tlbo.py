"""Teaching-learning-based rules.

Three variants: as in the 2022 papers, elitist (Rao & Patel 2012), and with nonlinear inertia
weights (Wu 2016).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule
from simloop.planners.splitmix import State, below, uniform


@njit(cache=True)
def teach(
    x: FloatArray,
    cost: FloatArray,
    candidate: FloatArray,
    weight: float,
    floor: float,
    state: State,
) -> None:
    """Run the teacher phase, Eqs. 20-23: candidate = weight x + r (teacher - T_f mean).

    There is one r per subject. In the 2022 papers: weight 1, floor 0. In Wu's Eqs. 2 and 5:
    weight w, floor 1/2.

    Args:
        x: (n, d) the learners.
        cost: (n,) their costs.
        candidate: (n, d) receives the candidates.
        weight: Inertia weight.
        floor: Least value of r; the largest is 1.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    teacher = np.argmin(cost)
    mean = np.zeros(d)
    for k in range(n):
        for j in range(d):
            mean[j] += x[k, j] / n
    for k in range(n):
        factor = 1.0 + below(state, 2)
        for j in range(d):
            r = floor + (1.0 - floor) * uniform(state)
            candidate[k, j] = weight * x[k, j] + r * (x[teacher, j] - factor * mean[j])


@njit(cache=True)
def learn(
    x: FloatArray,
    cost: FloatArray,
    candidate: FloatArray,
    weight: float,
    floor: float,
    state: State,
) -> None:
    """Run the learner phase, Eq. 25 (Wu's Eq. 6): away from worse learners, towards better ones.

    Args:
        x: (n, d) the learners.
        cost: (n,) their costs.
        candidate: (n, d) receives the candidates; unchanged where both learners are equal.
        weight: Inertia weight.
        floor: Least value of r; the largest is 1.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    for k in range(n):
        q = (k + 1 + below(state, n - 1)) % n
        side = 1.0 if cost[k] < cost[q] else -1.0
        if cost[k] == cost[q] and weight == 1.0:
            side = 0.0
        for j in range(d):
            r = floor + (1.0 - floor) * uniform(state)
            candidate[k, j] = weight * x[k, j] + side * r * (x[k, j] - x[q, j])


def teach_and_learn(p: Population, weight: float, floor: float) -> None:
    """Run both phases; each learner keeps the better solution (Eq. 24).

    Args:
        p: The population; changed.
        weight: Inertia weight.
        floor: Least random factor.
    """
    teach(p.x, p.cost, p.candidate, weight, floor, p.state)
    p.offer()
    learn(p.x, p.cost, p.candidate, weight, floor, p.state)
    p.offer()


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """Parameters of the rule as in the papers.

    Attributes:
        examined: Number of points within each segment, besides the waypoints, at which the
            distance d_j "during the vehicle motion" is examined. 0 examines the waypoints alone,
            as the index of Eq. 8 says. Most paths then cut through obstacles, unlike those in
            the papers' figures.
    """

    examined: int = 30


class TlboPaper(Rule):
    """TLBO as in Sabiha 2022, with its defects.

    - Clearance is examined at some points only, one term per obstacle (Eqs. 8, 16).
    - Points beyond the box are clipped to its wall (Eq. 26). Many coincide there, which hides their
      turning.
    - The teacher's step depends on the position of the origin (Eq. 21 with T_f = 2).
    - Each learner needs two evaluations per generation.
    - M is not given: here a path has six points, of which four are searched.
    """

    name = "tlbo_paper"
    Options = PaperOptions
    points = 4
    seeding = "uniform"
    evaluations = 2.0

    @property
    def examined(self) -> int:
        """Number of examined points within a segment."""
        return int(self.options.examined)

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        teach_and_learn(population, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class ElitistOptions:
    """Parameters of the elitist rule.

    Attributes:
        elites: Number of the best that replace the worst (Rao & Patel 2012 try 0, 4, 8, 12, 16).
    """

    elites: int = 4


class TlboElitist(Rule):
    """Rao & Patel 2012: the last generation's elite replaces the worst; duplicates are mutated."""

    name = "tlbo_elitist"
    Options = ElitistOptions
    evaluations = 2.0

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p, elites = population, min(self.options.elites, population.size // 2)
        best = np.argsort(p.cost, kind="mergesort")[:elites]
        kept_x, kept_cost = p.x[best].copy(), p.cost[best].copy()
        teach_and_learn(p, 1.0, 0.0)
        if elites:
            worst = np.argsort(p.cost, kind="mergesort")[-elites:]
            p.x[worst], p.cost[worst] = kept_x, kept_cost
        p.remove_duplicates()


@dataclass(frozen=True, slots=True)
class NiwOptions:
    """Parameters of the rule with inertia weights.

    Attributes:
        w_min: Least inertia weight (Wu 2016: 0.6).
    """

    w_min: float = 0.6


class Niwtlbo(Rule):
    """Wu 2016, Eqs. 2-7: nonlinear inertia weight, r in [1/2, 1], duplicates mutated."""

    name = "niwtlbo"
    Options = NiwOptions
    coding = "crosslines"
    points = 14
    evaluations = 2.0
    scheduled = True

    def generation(self, population: Population) -> None:
        """Compute one generation, with the inertia weight by Eq. 4.

        Args:
            population: The population; changed.
        """
        p = population
        share = p.generation / (p.generations / 8.0)
        weight = 1.0 - math.exp(-0.5 * share * share) * (1.0 - self.options.w_min)  # Eq. 4
        teach_and_learn(p, weight, 0.5)
        p.remove_duplicates()
