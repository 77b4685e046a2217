"""Genetic algorithm with its usual real-valued operators, and its hybrid with a particle swarm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule
from simloop.planners.metaheuristics.rule_swarm import fly
from simloop.planners.splitmix import State, below, uniform


@dataclass(frozen=True, slots=True)
class GaOptions:
    """Parameters of the genetic algorithm (Deb & Agrawal 1995; Deb 2001).

    Attributes:
        crossover: Share of pairs that are crossed.
        crossover_index: Distribution index of the simulated binary crossover.
        mutation_index: Distribution index of the polynomial mutation.
    """

    crossover: float = 0.9
    crossover_index: float = 15.0
    mutation_index: float = 20.0


@njit(cache=True)
def _spread(beta: float, eta: float, u: float) -> float:
    """Compute Deb's spread factor, bounded so that the child stays in the box."""
    alpha = 2.0 - beta ** -(eta + 1.0)
    if u <= 1.0 / alpha:
        return (u * alpha) ** (1.0 / (eta + 1.0))
    return (1.0 / (2.0 - u * alpha)) ** (1.0 / (eta + 1.0))


@njit(cache=True)
def cross(
    a: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, eta: float, state: State
) -> None:
    """Cross two rows in place by simulated binary crossover, each coordinate with chance 1/2.

    Args:
        a: (d,) one parent; becomes a child.
        b: (d,) the other; becomes the other child.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        eta: Distribution index.
        state: (1,) state of the random generator.
    """
    for j in range(a.size):
        if uniform(state) >= 0.5 or abs(a[j] - b[j]) <= 1e-14:
            continue
        y1, y2 = min(a[j], b[j]), max(a[j], b[j])
        u, apart = uniform(state), y2 - y1
        left = _spread(1.0 + 2.0 * (y1 - low[j]) / apart, eta, u)
        right = _spread(1.0 + 2.0 * (high[j] - y2) / apart, eta, u)
        c1 = 0.5 * (y1 + y2 - left * apart)
        c2 = 0.5 * (y1 + y2 + right * apart)
        if uniform(state) < 0.5:
            c1, c2 = c2, c1
        a[j] = min(max(c1, low[j]), high[j])
        b[j] = min(max(c2, low[j]), high[j])


@njit(cache=True)
def mutate(
    row: FloatArray, low: FloatArray, high: FloatArray, chance: float, eta: float, state: State
) -> None:
    """Mutate a row in place by polynomial mutation.

    Args:
        row: (d,) the individual; changed.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        chance: Chance that a coordinate is mutated.
        eta: Distribution index.
        state: (1,) state of the random generator.
    """
    for j in range(row.size):
        wide = high[j] - low[j]
        if uniform(state) >= chance or wide <= 0.0:
            continue
        u = uniform(state)
        if u <= 0.5:
            rest = 1.0 - (row[j] - low[j]) / wide
            step = (2.0 * u + (1.0 - 2.0 * u) * rest ** (eta + 1.0)) ** (1.0 / (eta + 1.0)) - 1.0
        else:
            rest = 1.0 - (high[j] - row[j]) / wide
            step = 1.0 - (2.0 * (1.0 - u) + 2.0 * (u - 0.5) * rest ** (eta + 1.0)) ** (
                1.0 / (eta + 1.0)
            )
        row[j] = min(max(row[j] + step * wide, low[j]), high[j])


@njit(cache=True)
def tournament(cost: FloatArray, state: State) -> int:
    """Return the better of two individuals drawn at random.

    Args:
        cost: (n,) costs of the individuals.
        state: (1,) state of the random generator.

    Returns:
        Index of the better one.
    """
    a, b = below(state, cost.size), below(state, cost.size)
    return a if cost[a] <= cost[b] else b


@njit(cache=True)
def breed(
    x: FloatArray,
    cost: FloatArray,
    candidate: FloatArray,
    low: FloatArray,
    high: FloatArray,
    rate: float,
    cross_eta: float,
    mutation_eta: float,
    state: State,
) -> None:
    """Fill rows with children of parents chosen by tournament.

    Args:
        x: (n, d) the parents.
        cost: (n,) their costs.
        candidate: (any number, d) receives the children.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        rate: Share of pairs that are crossed.
        cross_eta: Distribution index of the crossover.
        mutation_eta: Distribution index of the mutation.
        state: (1,) state of the random generator.
    """
    n, d = candidate.shape
    spare = np.empty(d)
    for k in range(0, n, 2):
        first = candidate[k]
        second = candidate[k + 1] if k + 1 < n else spare
        first[:] = x[tournament(cost, state)]
        second[:] = x[tournament(cost, state)]
        if uniform(state) < rate:
            cross(first, second, low, high, cross_eta, state)
        mutate(first, low, high, 1.0 / d, mutation_eta, state)
        mutate(second, low, high, 1.0 / d, mutation_eta, state)


class GeneticAlgorithm(Rule):
    """Tournament, simulated binary crossover and polynomial mutation.

    The best of parents and children survive.
    """

    name = "ga"
    Options = GaOptions

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p, o = population, self.options
        breed(
            p.x, p.cost, p.candidate, p.low, p.high,
            o.crossover, o.crossover_index, o.mutation_index, p.state,
        )  # fmt: skip
        p.price(np.full(p.size, p.cost.max()))  # a child worse than all parents does not survive
        everyone, costs = np.vstack([p.x, p.candidate]), np.concatenate([p.cost, p.offered])
        best = np.argsort(costs, kind="mergesort")[: p.size]
        p.x[:], p.cost[:] = everyone[best], costs[best]


@dataclass(frozen=True, slots=True)
class GaPsoOptions:
    """Parameters of the hybrid.

    Attributes:
        crossover: See `GaOptions`.
        crossover_index: See `GaOptions`.
        mutation_index: See `GaOptions`.
        inertia: See `rule_swarm.PsoOptions`.
        own: See `rule_swarm.PsoOptions`.
        social: See `rule_swarm.PsoOptions`.
        speed_limit: See `rule_swarm.PsoOptions`.
    """

    crossover: float = 0.9
    crossover_index: float = 15.0
    mutation_index: float = 20.0
    inertia: float = 0.729
    own: float = 1.49445
    social: float = 1.49445
    speed_limit: float = 0.5


class GaPso(Rule):
    """Juang 2004: the better half moves as a particle swarm, and the other half is bred from it."""

    name = "ga_pso"
    Options = GaPsoOptions

    def begin(self, population: Population) -> None:
        """Start every particle with zero velocity and its own position as its best.

        Args:
            population: The population.
        """
        self._speed = np.zeros_like(population.x)
        self._own_x, self._own_cost = population.x.copy(), population.cost.copy()

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p, o = population, self.options
        half = p.size // 2
        order = np.argsort(p.cost, kind="mergesort")[:half]
        for rows in (p.x, p.cost, self._speed, self._own_x, self._own_cost):
            rows[:half] = rows[order]
        fly(
            p.x[:half], self._speed[:half], self._own_x[:half], p.best_x, p.candidate[:half],
            p.low, p.high, o.inertia, o.own, o.social, o.speed_limit, p.state,
        )  # fmt: skip
        breed(
            p.x[:half], p.cost[:half], p.candidate[half:], p.low, p.high,
            o.crossover, o.crossover_index, o.mutation_index, p.state,
        )  # fmt: skip
        # The next generation takes the better half in order, and forgets the rest.
        self._own_cost[half:] = -np.inf
        p.replace(self._own_cost, keep=half)
        self._speed[half:] = 0.0
        self._own_cost[half:] = np.inf
        better = p.cost < self._own_cost
        self._own_x[better], self._own_cost[better] = p.x[better], p.cost[better]
