"""Population engine of all metaheuristics: evaluation, bounds, duplicates, budget and history.

How a rule plugs in
-------------------
Subclass `Rule`. Give it a ``name``, ``Options`` (a frozen dataclass of its parameters with their
usual values) and ``generation(population)``. That method does two things:
1. It calls the rule's own compiled kernel, which reads ``population.x`` (n, d) and
   ``population.cost`` (n,) and writes ``population.candidate`` (n, d).
2. It calls ``population.offer()`` (greedy: each candidate replaces its own parent if it is better)
   or ``population.replace()`` (generational).

The engine and `population_planner` handle drawing, bounds, evaluation, budget and history.
Add an entry for the rule to ``simloop/planners/registry.py``.

The budget counts evaluations of whole candidates and is never exceeded. A candidate beyond the
budget costs infinity. All randomness comes from ``population.state`` (`simloop.planners.splitmix`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.splitmix import State, below, uniform


class Objective(Protocol):
    """A function to minimise over a box.

    Attributes:
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
    """

    low: FloatArray
    high: FloatArray

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """Compute the cost of each vector.

        Args:
            x: (n, d) vectors within the box.
            out: (n,) receives the costs.
            bounds: (n,) costs above which the exact value does not matter; any value above the
                bound is then allowed.
        """
        ...


@runtime_checkable
class SelectiveObjective(Objective, Protocol):
    """An objective that finds the best or the worst of many faster than all costs."""

    def best_costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray, keep: int) -> None:
        """Compute the cost of each vector, exact if it is one of the best or within its bound.

        Args:
            x: (n, d) vectors within the box.
            out: (n,) receives the costs; where the exact value does not matter, any value above the
                bound and above the ``keep`` least costs.
            bounds: (n,) costs above which the exact value does not matter.
            keep: Number of least costs that must be exact all the same.
        """
        ...

    def worst(self, x: FloatArray) -> int:
        """Find the first vector with the greatest cost.

        Args:
            x: (n, d) vectors within the box.

        Returns:
            Index of the vector.
        """
        ...


@njit(cache=True)
def draw_uniform(x: FloatArray, low: FloatArray, high: FloatArray, state: State) -> None:
    """Fill an array with vectors drawn uniformly from a box.

    Args:
        x: (n, d) receives the vectors.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        state: (1,) state of the random generator.
    """
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[k, j] = low[j] + uniform(state) * (high[j] - low[j])


@njit(cache=True)
def _keep_inside(x: FloatArray, low: FloatArray, high: FloatArray, reflect: bool) -> None:
    """Clip to the box, or reflect at its walls; a value that is not finite goes to the middle."""
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            value = x[k, j]
            if not np.isfinite(value):
                value = 0.5 * (low[j] + high[j])
            if reflect and value < low[j]:
                value = 2.0 * low[j] - value
            elif reflect and value > high[j]:
                value = 2.0 * high[j] - value
            x[k, j] = min(max(value, low[j]), high[j])


@njit(cache=True)
def _accept(
    x: FloatArray,
    cost: FloatArray,
    candidate: FloatArray,
    offered: FloatArray,
    improved: FloatArray,
) -> None:
    """Accept candidates greedily, one by one; improved[k] is 1 if candidate k was accepted."""
    for k in range(cost.size):
        improved[k] = 1.0 if offered[k] < cost[k] else 0.0
        if offered[k] < cost[k]:
            cost[k] = offered[k]
            x[k] = candidate[k]


@njit(cache=True)
def _move_duplicates(
    x: FloatArray, cost: FloatArray, low: FloatArray, high: FloatArray, state: State
) -> int:
    """Redraw one coordinate of each row that equals another row, and set its cost to NaN.

    Returns the number of redrawn rows.
    """
    moved = 0
    order = np.argsort(cost, kind="mergesort")
    for i in range(1, cost.size):
        a, b = order[i - 1], order[i]
        same = True
        for j in range(x.shape[1]):
            if x[a, j] != x[b, j]:
                same = False
                break
        if same:
            j = below(state, x.shape[1])
            x[a, j] = low[j] + uniform(state) * (high[j] - low[j])
            cost[a] = np.nan
            moved += 1
    return moved


class Population:
    """A population over a box, its budget, and the best individual found so far.

    Attributes:
        objective: The function to minimise.
        state: (1,) state of the random generator.
        budget: Number of evaluations allowed.
        spent: Number of evaluations made.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        x: (n, d) the individuals.
        cost: (n,) their costs.
        candidate: (n, d) the candidates that a rule writes.
        offered: (n,) costs of the candidates.
        improved: (n,) 1 if the last candidate was accepted, else 0.
        best_x: (d,) the best vector found so far.
        best_cost: Its cost.
        history: Number of evaluations and best cost, one entry for each gain.
        generation: Number of generations begun.
        generations: Number of generations that the budget allows: the horizon of rules with a
            schedule.
    """

    def __init__(
        self, objective: Objective, size: int, budget: int, state: State, *, reflect: bool = False
    ) -> None:
        d = len(objective.low)
        self.objective, self.state, self.budget, self.spent = objective, state, budget, 0
        self.low = np.array(objective.low, dtype=np.float64)
        self.high = np.array(objective.high, dtype=np.float64)
        self.x, self.cost = np.zeros((size, d)), np.full(size, np.inf)
        self.candidate, self.offered = np.zeros((size, d)), np.full(size, np.inf)
        self.improved = np.zeros(size)
        self.best_x, self.best_cost = np.zeros(d), np.inf
        self.history: list[tuple[int, float]] = []
        self.generation, self.generations = 0, 1
        self._reflect = reflect
        self._selective = objective if isinstance(objective, SelectiveObjective) else None

    @property
    def size(self) -> int:
        """Number of individuals."""
        return len(self.cost)

    @property
    def progress(self) -> float:
        """Elapsed share of the schedule, 0 to 1."""
        return min(1.0, self.generation / self.generations)

    @property
    def exhausted(self) -> bool:
        """Whether no evaluation is left."""
        return self.spent >= self.budget

    def draw(self, first: FloatArray | None = None) -> None:
        """Draw and evaluate the first population.

        Args:
            first: (m, d) given individuals, of which at most n are used; the others are drawn.
        """
        draw_uniform(self.x, self.low, self.high, self.state)
        if first is not None:
            count = min(len(first), self.size)
            self.x[:count] = first[:count]
        _keep_inside(self.x, self.low, self.high, False)
        self.evaluate(self.x, self.cost)

    def evaluate(
        self, x: FloatArray, out: FloatArray, bounds: FloatArray | None = None, keep: int = 0
    ) -> None:
        """Evaluate vectors while the budget lasts, and update the best and the history.

        Args:
            x: (m, d) vectors.
            out: (m,) receives their costs; infinity where the budget is spent.
            bounds: (m,) costs above which the exact value does not matter; by default none.
            keep: Number of least costs that are exact all the same.
        """
        count = min(len(x), max(0, self.budget - self.spent))
        limit = np.full(len(x), np.inf) if bounds is None else bounds
        out[count:] = np.inf
        if count == 0:
            return
        if keep == 0:
            self.objective.costs(x[:count], out[:count], limit[:count])
        elif self._selective is not None:
            self._selective.best_costs(x[:count], out[:count], limit[:count], keep)
        else:
            self.objective.costs(x[:count], out[:count], np.full(count, np.inf))
        self.spent += count
        k = int(np.argmin(out[:count]))
        if out[k] < self.best_cost:
            self.best_cost = float(out[k])
            self.best_x[:] = x[k]
            self.history.append((self.spent, self.best_cost))

    def offer(self) -> None:
        """Evaluate the candidates; each replaces its own parent if it is better."""
        _keep_inside(self.candidate, self.low, self.high, self._reflect)
        self.evaluate(self.candidate, self.offered, self.cost)
        _accept(self.x, self.cost, self.candidate, self.offered, self.improved)

    def price(self, bounds: FloatArray | None = None, keep: int = 0) -> None:
        """Keep the candidates inside the box and write their costs into ``offered``.

        Args:
            bounds: (n,) costs above which the exact value does not matter; by default none.
            keep: Number of least costs that are exact all the same.
        """
        _keep_inside(self.candidate, self.low, self.high, self._reflect)
        self.evaluate(self.candidate, self.offered, bounds, keep)

    def replace(self, bounds: FloatArray | None = None, keep: int = 0) -> None:
        """Replace the population by the candidates, better or not.

        Args:
            bounds: (n,) costs above which the exact value does not matter to the rule; by default
                none.
            keep: Number of least costs that are exact all the same.
        """
        self.price(bounds, keep)
        self.x[:], self.cost[:] = self.candidate, self.offered

    def exact_costs(self) -> FloatArray:
        """Compute the costs of the population that bounds left inexact; not charged to the budget.

        Returns:
            (n,) the costs.
        """
        costs = np.empty(self.size)
        self.objective.costs(self.x, costs, np.full(self.size, np.inf))
        return costs

    def worst(self) -> int:
        """Find the worst after `replace` with ``keep``; this is not charged to the budget.

        Without a `SelectiveObjective` all costs are exact then.

        Returns:
            Its index.
        """
        if self._selective is not None:
            return self._selective.worst(self.x)
        return int(np.argmax(self.cost))

    def remove_duplicates(self) -> int:
        """Mutate one coordinate of each individual that equals another one.

        Returns:
            Number of mutated individuals.
        """
        moved = _move_duplicates(self.x, self.cost, self.low, self.high, self.state)
        if moved:
            at = np.flatnonzero(np.isnan(self.cost))
            costs = np.empty(len(at))
            self.evaluate(self.x[at], costs)
            self.cost[at] = costs
        return moved


@dataclass(frozen=True, slots=True)
class NoOptions:
    """A rule without parameters of its own."""


class Rule:
    """Base of the update rules. Each plan makes a new one, so a rule may keep memory."""

    name: ClassVar[str] = ""
    Options: ClassVar[Any] = NoOptions
    coding: ClassVar[str] = "box"
    """Name of the coding of the paths, see `codings`."""
    points: ClassVar[int] = 8
    """Number of inner waypoints of a path."""
    seeding: ClassVar[str] = "seeded"
    """Source of the first population, see `population_planner.Setup`."""
    evaluations: ClassVar[float] = 1.0
    """Evaluations per individual and generation."""
    scheduled: ClassVar[bool] = False
    """Whether the rule has a schedule over the whole budget; idle generations do not end it."""
    reflect: ClassVar[bool] = False

    def __init__(self, options: Any = None) -> None:
        self.options = self.Options() if options is None else options

    @property
    def examined(self) -> int | None:
        """Number of examined points within a segment; None for the clearance of the whole path."""
        return None

    def begin(self, population: Population) -> None:
        """Prepare for the first generation; called once, after the first evaluation.

        Args:
            population: The evaluated first population.
        """

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.

        Raises:
            NotImplementedError: If the rule does not define it.
        """
        raise NotImplementedError


def minimise(
    rule: Rule, population: Population, first: FloatArray | None = None, *, idle: int = 10**9
) -> int:
    """Run a rule until the budget is spent or too many consecutive generations bring no gain.

    Args:
        rule: The rule.
        population: The population; it is drawn anew.
        first: (m, d) given individuals of the first population.
        idle: Number of generations without a gain that ends a rule without a schedule.

    Returns:
        Number of generations.
    """
    population.draw(first)
    each = max(1, round(rule.evaluations * population.size))
    left = population.budget - population.spent
    population.generations = max(1, left // each)
    rule.begin(population)
    idling, last = 0, population.best_cost
    while not population.exhausted and (rule.scheduled or idling < idle):
        spent = population.spent
        population.generation += 1
        rule.generation(population)
        idling = 0 if population.best_cost < last else idling + 1
        last = population.best_cost
        if population.spent == spent and idling > idle:
            break
    return population.generation
