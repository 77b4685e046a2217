"""Differential evolution (Storn, Price 1997) and artificial bee colony (Karaboga, Basturk 2007)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule, draw_uniform
from simloop.planners.splitmix import State, below, uniform


@dataclass(frozen=True, slots=True)
class DeOptions:
    """Parameters of DE/rand/1/bin (Storn & Price 1997; Wu 2016 uses 0.5 and 0.4).

    Attributes:
        factor: F, the weight of the difference.
        crossover: CR, the chance that a coordinate is taken over.
    """

    factor: float = 0.5
    crossover: float = 0.9


@njit(cache=True)
def mix(x: FloatArray, candidate: FloatArray, f: float, cr: float, state: State) -> None:
    """Compute DE/rand/1/bin: a + f (b - c) in at least one coordinate; a, b, c and k differ.

    Args:
        x: (n, d) the individuals.
        candidate: (n, d) receives the candidates.
        f: Weight of the difference.
        cr: Chance that a coordinate is taken over.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    for k in range(n):
        a = b = c = k
        while a == k:
            a = below(state, n)
        while b in (k, a):
            b = below(state, n)
        while c in (k, a, b):
            c = below(state, n)
        sure = below(state, d)
        for j in range(d):
            taken = uniform(state) < cr or j == sure
            candidate[k, j] = x[a, j] + f * (x[b, j] - x[c, j]) if taken else x[k, j]


class DifferentialEvolution(Rule):
    """DE/rand/1/bin with greedy acceptance."""

    name = "de"
    Options = DeOptions

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p = population
        mix(p.x, p.candidate, self.options.factor, self.options.crossover, p.state)
        p.offer()


@dataclass(frozen=True, slots=True)
class AbcOptions:
    """Parameters of the bee colony.

    Attributes:
        limit: Failures after which a source is abandoned; 0 for the usual sources x dimensions.
    """

    limit: int = 0


@njit(cache=True)
def forage(
    x: FloatArray, cost: FloatArray, source: FloatArray, candidate: FloatArray, state: State
) -> None:
    """Move one coordinate of each bee's source by phi (x_i - x_q), phi in [-1, 1].

    Args:
        x: (n, d) the sources.
        cost: (n,) their costs.
        source: (n,) the source that each bee visits.
        candidate: (n, d) receives the sources that the bees find.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    for k in range(n):
        i = int(source[k])
        q = (i + 1 + below(state, n - 1)) % n
        j = below(state, d)
        candidate[k] = x[i]
        candidate[k, j] += (2.0 * uniform(state) - 1.0) * (x[i, j] - x[q, j])


@njit(cache=True)
def onlook(cost: FloatArray, source: FloatArray, state: State) -> None:
    """Let each onlooker choose a source, with a chance proportional to its fitness.

    The fitness is 1/(1 + J), or 1 + |J| if J is negative.

    Args:
        cost: (n,) costs of the sources.
        source: (n,) receives the source that each bee visits.
        state: (1,) state of the random generator.
    """
    n = cost.size
    sums = np.empty(n)
    total = 0.0
    for k in range(n):
        total += 1.0 / (1.0 + cost[k]) if cost[k] >= 0.0 else 1.0 - cost[k]
        sums[k] = total
    for k in range(n):
        source[k] = min(n - 1, np.searchsorted(sums, uniform(state) * total, side="right"))


@njit(cache=True)
def settle_bees(
    x: FloatArray,
    cost: FloatArray,
    source: FloatArray,
    candidate: FloatArray,
    offered: FloatArray,
    failures: FloatArray,
) -> None:
    """Choose greedily at each bee's source; a candidate that is no better counts as a failure.

    Args:
        x: (n, d) the sources; changed.
        cost: (n,) their costs; changed.
        source: (n,) the source that each bee visited.
        candidate: (n, d) the sources that the bees found.
        offered: (n,) costs of the candidates.
        failures: (n,) consecutive failures at each source; changed.
    """
    for k in range(cost.size):
        i = int(source[k])
        if offered[k] < cost[i]:
            cost[i] = offered[k]
            x[i] = candidate[k]
            failures[i] = 0.0
        else:
            failures[i] += 1.0


class BeeColony(Rule):
    """Employed bees, onlookers, and at most one scout per generation."""

    name = "abc"
    Options = AbcOptions
    evaluations = 2.0

    def begin(self, population: Population) -> None:
        """Send one employed bee to each source.

        Args:
            population: The population.
        """
        self._failures = np.zeros(population.size)
        self._source = np.arange(population.size, dtype=np.float64)

    def generation(self, population: Population) -> None:
        """Compute one generation: employed bees, onlookers, then a scout for an abandoned source.

        Args:
            population: The population; changed.
        """
        p, failures, source = population, self._failures, self._source
        limit = self.options.limit or p.size * p.x.shape[1]
        for onlookers in (False, True):
            if onlookers:
                onlook(p.cost, source, p.state)
            else:
                source[:] = np.arange(p.size)
            forage(p.x, p.cost, source, p.candidate, p.state)
            p.price()
            settle_bees(p.x, p.cost, source, p.candidate, p.offered, failures)
        worst = int(np.argmax(failures))
        if failures[worst] > limit:
            scout = slice(worst, worst + 1)
            draw_uniform(p.x[scout], p.low, p.high, p.state)
            p.evaluate(p.x[scout], p.cost[scout])
            failures[worst] = 0.0
