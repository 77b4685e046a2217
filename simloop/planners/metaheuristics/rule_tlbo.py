"""Teaching-learning-based rules.

As the 2022 papers print it, elitist (Rao & Patel 2012), and with nonlinear inertia weights (Wu
2016).
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
    """Teacher phase, Eqs. 20-23: candidate = weight x + r (teacher - T_f mean), one r a subject.

    As printed: weight 1, floor 0. Wu's Eqs. 2 and 5: weight w, floor 1/2.

    Args:
        x: (n, d) the learners.
        cost: (n,) their costs.
        candidate: (n, d) takes what is offered.
        weight: Inertia weight.
        floor: Least value of r; the greatest is 1.
        state: (1,) of the random generator.
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
    """Learner phase, Eq. 25 (Wu's Eq. 6): away from a worse fellow, towards a better one.

    Args:
        x: (n, d) the learners.
        cost: (n,) their costs.
        candidate: (n, d) takes what is offered; as it was where both are equal.
        weight: Inertia weight.
        floor: Least value of r; the greatest is 1.
        state: (1,) of the random generator.
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
    """Run both phases; each learner keeps the better (Eq. 24).

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
    """Parameters of the printed rule.

    Attributes:
        examined: Points within each segment at which the distance d_j "during the vehicle motion"
            is
            examined besides the waypoints. With 0 it is the waypoints alone, as the index of Eq. 8
            says; most paths then cut through obstacles, which those of the papers' figures do not.
    """

    examined: int = 30


class TlboPaper(Rule):
    """TLBO as Sabiha 2022 prints it, its defects included.

    Clearance is examined at some points only, one term an obstacle (Eqs. 8, 16), and not between
    them. Points beyond the box are clipped to its wall (Eq. 26), where many coincide and hide their
    turning. The teacher's step depends on where the origin is (Eq. 21 with T_f = 2). There are two
    evaluations a
    learner a generation. M is not given: a path has six points, of which four are sought.
    """

    name = "tlbo_paper"
    Options = PaperOptions
    points = 4
    seeding = "uniform"
    evaluations = 2.0

    @property
    def examined(self) -> int:
        """At how many points within a segment clearance is examined."""
        return int(self.options.examined)

    def generation(self, population: Population) -> None:
        """Make one generation.

        Args:
            population: The population; changed.
        """
        teach_and_learn(population, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class ElitistOptions:
    """Parameters of the elitist rule.

    Attributes:
        elites: How many of the best replace the worst (Rao & Patel 2012 try 0, 4, 8, 12, 16).
    """

    elites: int = 4


class TlboElitist(Rule):
    """Rao & Patel 2012: the last generation's elite replaces the worst, and twins are mutated."""

    name = "tlbo_elitist"
    Options = ElitistOptions
    evaluations = 2.0

    def generation(self, population: Population) -> None:
        """Make one generation.

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
    """Wu 2016, Eqs. 2-7: nonlinear inertia weight, random factor in [1/2, 1], twins mutated."""

    name = "niwtlbo"
    Options = NiwOptions
    coding = "crosslines"
    points = 14
    evaluations = 2.0
    scheduled = True

    def generation(self, population: Population) -> None:
        """Make one generation, the inertia weight by Eq. 4.

        Args:
            population: The population; changed.
        """
        p = population
        share = p.generation / (p.generations / 8.0)
        weight = 1.0 - math.exp(-0.5 * share * share) * (1.0 - self.options.w_min)  # Eq. 4
        teach_and_learn(p, weight, 0.5)
        p.remove_duplicates()
