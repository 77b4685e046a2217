"""The population engine, and every rule on it: budget, bounds, chance, duplicates, progress."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.standard_functions import NAMES, StandardFunction

from simloop.benchmarks.planners.scenes import scene
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners import registry
from simloop.planners.metaheuristics.population import Population, minimise
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner
from simloop.planners.splitmix import make_state

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
RULES = [n for n in registry.available() if registry.info(n).update_rule]


class Watched(StandardFunction):
    """Counts, and sees that nothing outside the box is ever asked for."""

    count = 0

    def costs(self, x, out, bounds):
        assert np.isfinite(x).all() and (x >= self.low).all() and (x <= self.high).all()
        self.count += len(x)
        super().costs(x, out, bounds)


def run(name, objective, budget=3000, size=20, seed=0, first=None):
    state = make_state(np.random.default_rng(seed))
    population = Population(objective, size, budget, state)
    minimise(registry.load(name)(), population, first)
    return population


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("budget", [7, 20, 61, 1013])
def test_the_budget_is_never_exceeded_nor_left_unused(name, budget):
    watched = Watched("rastrigin", 5)
    population = run(name, watched, budget)
    assert watched.count == population.spent == budget
    assert population.history[-1][0] <= budget


@pytest.mark.parametrize("name", RULES)
def test_every_rule_improves_and_keeps_its_history(name):
    for function in NAMES:
        objective = StandardFunction(function, 5)
        population = run(name, objective)
        evaluations, best = np.array(population.history).T
        assert (np.diff(best) < 0.0).all() and (np.diff(evaluations) > 0).all()
        assert population.best_cost == best[-1] < 0.5 * best[0]
        out = np.empty(1)
        objective.costs(population.best_x[None], out, np.full(1, np.inf))
        assert out[0] == population.best_cost


@pytest.mark.parametrize("name", RULES)
def test_the_same_seed_gives_the_same_and_another_does_not(name):
    first, again, other = (run(name, StandardFunction("ackley", 4), seed=s) for s in (3, 3, 4))
    assert first.history == again.history and first.x.tobytes() == again.x.tobytes()
    assert first.history != other.history


def test_duplicates_are_moved_and_priced_and_no_others():
    objective = Watched("sphere", 3)
    population = Population(objective, 8, 100, make_state(np.random.default_rng(1)))
    population.draw()
    population.x[5] = population.x[6] = population.x[2]
    population.cost[5] = population.cost[6] = population.cost[2]
    before = population.x.copy()
    assert population.remove_duplicates() == 2
    assert len(np.unique(population.x, axis=0)) == 8
    changed = (population.x != before).sum(axis=1)
    assert changed.sum() == 2 and changed.max() == 1
    np.testing.assert_allclose(population.cost, (population.x**2).sum(axis=1))
    assert population.spent == objective.count == 10


@pytest.mark.parametrize("name", RULES)
def test_every_rule_plans_and_the_account_is_honest(name):
    one = scene("S1")[0]
    config = PlannerConfig(
        name=name, start_turn_weight=0.0, safe_distance_m=one.safe_m, max_evaluations=6000
    )
    planner = make_planner(config, POINT)
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    found, again = (planner.plan(task, np.random.default_rng(1000)) for _ in range(2))
    assert found.waypoints_m.tobytes() == again.waypoints_m.tobytes()
    assert found.evaluations <= 6000 and found.planner == name
    assert found.safe or name == "tlbo_paper"
    assert np.array_equal(found.waypoints_m[[0, -1]], [one.start[:2], one.goal])
    if name != "tlbo_paper":  # which does not see the whole curve
        assert found.cost == pytest.approx(found.history[-1, 1], abs=1e-9)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"factr": 0.5}, "unknown option 'factr'.*factor"),
        ({"factor": "high"}, "option factor: must be a number"),
        ({"coding": "spiral"}, "none of box, crosslines"),
        ({"points": 101}, "points: must be between 0 and 100"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_line(options, said):
    with pytest.raises(ValueError, match=said) as error:
        registry.check_options("de", options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "other"), [("de", "ga"), ("ga", "ga"), ("niwtlbo", "niwtlbo")])
def test_the_old_way_is_one_of_the_first_population(name, other):
    """With no evaluation left but the first population's, a good old way is what is found."""
    one = scene("S1")[0]
    config = PlannerConfig(
        name=name, start_turn_weight=0.0, safe_distance_m=one.safe_m, max_evaluations=100
    )
    good = make_planner(replace(config, name=other, max_evaluations=40_000), POINT)
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    old = good.plan(task, np.random.default_rng(0))
    planner = make_planner(config, POINT)
    cold = planner.plan(task, np.random.default_rng(1))
    warm = planner.plan(replace(task, previous=old), np.random.default_rng(1))
    assert warm.cost <= old.cost * (1.0 + 1e-9) < cold.cost
    elsewhere = replace(old, waypoints_m=old.waypoints_m[:-1])
    for useless in (elsewhere, replace(old, safe=False)):
        again = planner.plan(replace(task, previous=useless), np.random.default_rng(1))
        assert again.waypoints_m.tobytes() == cold.waypoints_m.tobytes()


def test_what_leaves_the_box_is_clipped_or_folded_back():
    """Beyond a wall by less than the box is wide: to the wall, or as far inside as it was out."""
    for reflect, expected in ((False, [-4.0, 6.0, 1.0, 1.0]), (True, [-3.5, 4.0, 1.0, 1.0])):
        population = Population(
            StandardFunction("sphere", 4), 4, 100, make_state(np.random.default_rng(0)),
            reflect=reflect,
        )  # fmt: skip
        population.draw()
        population.candidate[:] = [-4.5, 8.0, 1.0, np.nan]
        population.replace()
        np.testing.assert_allclose(population.x, np.tile(expected, (4, 1)))
