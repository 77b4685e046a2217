"""Update rules against other libraries' on standard functions: the same distribution of results.

Not run for run: both draw otherwise. A two-sample test (Kolmogorov & Smirnov) of the best values of
60 runs each must not tell ours from theirs, and must tell a rule that has been tampered with.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.standard_functions import StandardFunction
from scipy.stats import ks_2samp

from simloop.planners import registry
from simloop.planners.metaheuristics import rule_tlbo
from simloop.planners.metaheuristics.population import Population, minimise
from simloop.planners.splitmix import make_state

counterparts = pytest.importorskip("helpers.counterparts")  # mealpy, pymoo

RUNS, DIMENSIONS = 60, 4
ALIKE, APART = 0.01, 1e-3
OPTIONS = {"avoa": {"levy_step": 1.0}, "abc": {"limit": 10**5}}
# Mealpy's learners learn one after the other, the paper's all at once: on the sphere that shows.
FUNCTIONS = dict.fromkeys(counterparts.COUNTERPARTS, ("rosenbrock", "rastrigin", "sphere"))
for rule in ("ga", "avoa"):  # whose spread on the others hides much
    FUNCTIONS[rule] = ("sphere", "rosenbrock", "rastrigin")
FUNCTIONS["tlbo_paper"] = ("rosenbrock", "rastrigin")
TAMPERED = {
    "de": {"factor": 0.9},
    "avoa": {"levy_step": 1.0, "p2": 0.0, "p3": 0.0},
    "ga": {"crossover": 0.0},
    "pso": {"social": 0.3},
    "abc": {"limit": 1},
}


@cache
def theirs(name, function):
    run = counterparts.COUNTERPARTS[name]
    return [run(StandardFunction(function, DIMENSIONS), seed) for seed in range(RUNS)]


def ours(rule_class, function, **options):
    values = []
    for seed in range(RUNS):
        size, generations = counterparts.SIZE, counterparts.GENERATIONS
        budget = round(size * (1 + rule_class.evaluations * generations))
        population = Population(
            StandardFunction(function, DIMENSIONS), size, budget,
            make_state(np.random.default_rng(seed)),
        )  # fmt: skip
        minimise(rule_class(rule_class.Options(**options)), population)
        values.append(population.best_cost)
    return values


def alike(name, function):
    return ks_2samp(ours(registry.load(name), function, **OPTIONS.get(name, {})),
                    theirs(name, function)).pvalue  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_rule_is_not_to_be_told_from_its_counterpart(name):
    assert alike(name, FUNCTIONS[name][0]) > ALIKE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "function"), [(n, f) for n, functions in FUNCTIONS.items() for f in functions[1:]]
)
def test_nor_on_other_functions(name, function):
    assert alike(name, function) > ALIKE


@pytest.mark.parametrize("name", TAMPERED)
def test_a_rule_that_was_tampered_with_is_told_apart(name):
    function = FUNCTIONS[name][0]
    tampered = ours(registry.load(name), function, **TAMPERED[name])
    assert ks_2samp(tampered, theirs(name, function)).pvalue < APART


class WithoutLearning(rule_tlbo.TlboPaper):
    """The teacher's phase alone, twice."""

    def generation(self, population):
        p = population
        for _ in range(2):
            rule_tlbo.teach(p.x, p.cost, p.candidate, 1.0, 0.0, p.state)
            p.offer()


def test_a_class_that_does_not_learn_from_each_other_is_told_apart():
    values = ours(WithoutLearning, "rosenbrock")
    assert ks_2samp(values, theirs("tlbo_paper", "rosenbrock")).pvalue < APART
