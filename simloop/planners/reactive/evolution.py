"""The steady-state genetic algorithm of `simloop.planners.reactive.ga_apf`.

Source: Mohamed & Abbas 2012, Section V.2. No chromosome is rated twice. Once the population has
become alike, most offspring are copies, or differ from another one in their last genes only: see
`simloop.planners.reactive.deformed_field`. Offspring that cannot be among those that are kept are
not followed to their end. Neither changes the search: every chromosome that is ever selected has
the fitness of its whole walk.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.reactive.deformed_field import NOTES, Field, walk
from simloop.planners.splitmix import State, below, uniform

POPULATION = 50
TOURNAMENT = 3
CROSSOVER, MUTATION = 0.8, 0.05
DISCARDED = 0.5
_TOLERANCE = 1e-4


class Herd(NamedTuple):
    """A population of chromosomes.

    Attributes:
        genes: (n, F) turns of the attraction, rad.
        fit: (n,) fitness (Eq. 18), 1/m; 0 for a chromosome that is certain to be discarded.
        notes: (n, F, NOTES) what is known of each walk, see `deformed_field.walk`.
        noted: (n,) number of genes that have a note.
    """

    genes: FloatArray
    fit: FloatArray
    notes: FloatArray
    noted: NDArray[np.int64]


def make_herd(size: int, count: int) -> Herd:
    """Make an empty population.

    Args:
        size: Number of chromosomes.
        count: Number of genes of each.

    Returns:
        The population.
    """
    return Herd(
        np.zeros((size, count)),
        np.zeros(size),
        np.zeros((size, count, NOTES)),
        np.zeros(size, np.int64),
    )


@njit(cache=True)
def rate(f: Field, herd: Herd, k: int, limit: float, path: FloatArray) -> None:
    """Compute the fitness of a chromosome (Mohamed 2012, Eq. 18); counts as a trial.

    Args:
        f: The field.
        herd: The population; rows before ``k`` are rated. Row k receives its fitness: 1 / length
            of a valid path, 1 / (length + mu x distance left) of an invalid one, 1/m; 0 if
            the denominator is greater than the limit.
        k: The chromosome.
        limit: Length plus mu times the distance left above which the value does not matter, m.
        path: (0, 2) no points are kept.
    """
    f.p.trials[0] += 1
    count = herd.genes.shape[1]
    # The rated chromosome that has the most leading genes in common with this one.
    like, known = 0, 0
    for i in range(k):
        j = 0
        while j < count and herd.genes[i, j] == herd.genes[k, j]:
            j += 1
        if j > known:
            like, known = i, j
        if known == count:
            break
    if known > 0:
        herd.noted[k] = min(known, herd.noted[like])
        for j in range(min(known + 1, herd.noted[like])):
            herd.notes[k, j] = herd.notes[like, j]
        # The other one's walk has ended before it came to a gene that differs.
        if known == count or herd.noted[like] <= known:
            herd.noted[k], herd.fit[k] = herd.noted[like], herd.fit[like]
            return
    _, cost, _, noted = walk(f, herd.genes[k], herd.notes[k], known, limit, path)
    herd.noted[k], herd.fit[k] = noted, 1.0 / max(cost, 1e-9)


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
def _sort(herd: Herd) -> None:
    """Sort a population, the fittest first."""
    order = np.argsort(-herd.fit, kind="mergesort")
    herd.genes[:], herd.fit[:] = herd.genes[order], herd.fit[order]
    herd.notes[:], herd.noted[:] = herd.notes[order], herd.noted[order]


@njit(cache=True)
def evolve(f: Field, herd: Herd, idle_limit: int, budget: int, state: State) -> int:
    """Run the steady-state genetic algorithm from a random population.

    Args:
        f: The field.
        herd: Receives the last population, the fittest first.
        idle_limit: Number of generations without improvement after which the search ends.
        budget: Largest number of fitness evaluations.
        state: (1,) random state, advanced.

    Returns:
        Number of generations after the first.
    """
    genes, fit = herd.genes, herd.fit
    size, count = genes.shape
    kept = size - int(DISCARDED * size)
    nowhere, limit = np.zeros((0, 2)), np.inf
    for k in range(size):
        for j in range(count):
            genes[k, j] = math.pi * (uniform(state) - 0.5)
    for k in range(size):
        # Half of the first population is discarded: a chromosome matters only among the best half.
        if k >= kept:
            limit = 1.0 / max(np.sort(fit[:k])[k - kept], 1e-300)
        rate(f, herd, k, limit, nowhere)
    spent, idle, generations = size, 0, 0
    _sort(herd)
    best = fit[0]
    while idle < idle_limit and spent + size - kept <= budget:
        breed(genes, fit, kept, state)
        # An offspring that is worse than all the kept ones will be discarded with the next sort.
        limit = 1.0 / fit[kept - 1]
        for k in range(kept, size):
            rate(f, herd, k, limit, nowhere)
        spent += size - kept
        _sort(herd)
        generations += 1
        idle = 0 if fit[0] > best * (1.0 + _TOLERANCE) else idle + 1
        best = max(best, fit[0])
    return generations
