"""Costs that are computed only as far as they matter, against costs computed in full."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.plain_objective import PlainObjective
from helpers.population_paths import RULES, instances

from simloop.benchmarks.planners.scenes import box_world
from simloop.config import PlannerConfig
from simloop.planners.metaheuristics import population_planner
from simloop.planners.metaheuristics.codings import PathObjective, make_coding
from simloop.planners.metaheuristics.rule_swarm import evolutionary_factor
from simloop.planners.problem.account import problem_of
from simloop.planners.problem.flat_problem import make_problem, sample_field
from simloop.planners.problem.windows import surely_keeps, window_minima
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner

TASKS = {one.name: (one, vehicle) for one, vehicle in instances()}
FEW = ("sabiha4", "wu180", "S3-0", "S4a", "S4a-robot", "S4b-robot")


def problem_at(name):
    one, vehicle = TASKS[name]
    config = PlannerConfig(safe_distance_m=one.safe_m, start_turn_weight=0.1)
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    return problem_of(config, max(vehicle.footprint_offsets_m), task)


def some_vectors(p, coding, rng, n=200):
    """Vectors from all over the box, and ever closer to the straight line; some at its walls."""
    share = np.arange(1, coding.points + 1)[:, None] / (coding.points + 1)
    ends = np.array([[p.start_x, p.start_y], [p.goal_x, p.goal_y]])
    line = ((1.0 - share) * ends[0] + share * ends[1]).ravel()
    wide = (coding.high - coding.low) * rng.uniform(0.0, 1.0, (n, 1)) ** 3
    return np.clip(line + wide * rng.normal(size=(n, line.size)), coding.low, coding.high)


@pytest.mark.parametrize("name", FEW)
@pytest.mark.parametrize("examined", [None, 0, 3, 30])
def test_a_cost_within_its_bound_is_exact(name, examined):
    rng, p = np.random.default_rng(1), problem_at(name)
    coding = make_coding(p, "box", 5)
    x = some_vectors(p, coding, rng)
    x[:5, 2:4] = x[:5, :2]  # segments without a length
    full, out = np.empty(len(x)), np.empty(len(x))
    PlainObjective(p, coding, examined).costs(x, full, full)
    objective = PathObjective(p, coding, examined)
    objective.costs(x, out, np.full(len(x), np.inf))
    np.testing.assert_array_equal(out, full)
    for bounds in (full, full * rng.uniform(0.5, 1.5, len(x)), np.full(len(x), np.median(full))):
        objective.costs(x, out, bounds)
        within = full <= bounds
        np.testing.assert_array_equal(out[within], full[within])
        assert (out[~within] > bounds[~within]).all() and within.any()


@pytest.mark.parametrize("name", FEW)
@pytest.mark.parametrize("keep", [1, 2, 50, 300])
def test_the_best_and_the_worst_are_those_of_all_costs(name, keep):
    rng, p = np.random.default_rng(2), problem_at(name)
    coding = make_coding(p, "box", 8)
    x = some_vectors(p, coding, rng)
    x[150:] = x[:50]  # equal costs
    full, out = np.empty(len(x)), np.empty(len(x))
    PlainObjective(p, coding).costs(x, full, full)
    objective = PathObjective(p, coding)
    bounds = np.where(rng.uniform(size=len(x)) < 0.5, full * rng.uniform(0.5, 1.5, len(x)), -np.inf)
    objective.best_costs(x, out, bounds, keep)
    last = np.sort(full)[min(keep, len(x)) - 1]
    matter = (full <= last) | (full <= bounds)
    np.testing.assert_array_equal(out[matter], full[matter])
    assert (out[~matter] > np.maximum(last, bounds[~matter])).all()
    for rows in (slice(None), slice(0, 100), slice(40, 50), slice(149, 151)):
        assert objective.worst(x[rows]) == np.argmax(full[rows])


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("where", ["sabiha4", "S4a-robot"])
def test_a_rule_finds_the_same_with_costs_in_full(monkeypatch, name, where):
    one, vehicle = TASKS[where]
    config = PlannerConfig(name=name, safe_distance_m=one.safe_m, max_evaluations=6050)
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    quick = make_planner(config, vehicle).plan(task, np.random.default_rng(5))
    monkeypatch.setattr(population_planner, "PathObjective", PlainObjective)
    full = make_planner(config, vehicle).plan(task, np.random.default_rng(5))
    assert quick.waypoints_m.tobytes() == full.waypoints_m.tobytes()
    assert quick.history.tobytes() == full.history.tobytes()
    for a, b in zip(quick.candidates_m, full.candidates_m, strict=True):
        assert a.tobytes() == b.tobytes()


def test_windows_prove_only_what_holds():
    rng = np.random.default_rng(3)
    world = box_world(rng.uniform(0.0, 5.0, (12, 1)) + np.array([0.0, 0.3, 0.4, 0.9]), 6.0, 0.05)
    p = make_problem(world, np.zeros(3), np.ones(2), safe_m=0.26)
    lows, proved = window_minima(p.field), 0
    for a, b in rng.uniform(-1.0, 7.0, (1500, 2, 2)):
        b = a + (b - a) * rng.uniform() ** 2
        if surely_keeps(p, lows, *a, *b, 0.2):
            proved += 1
            points = a + np.linspace(0.0, 1.0, 300)[:, None] * (b - a)
            assert min(sample_field(p, x, y) for x, y in points) >= 0.2
    assert proved > 300


def test_the_evolutionary_factor_is_that_of_a_plain_double_loop():
    x = np.random.default_rng(4).normal(size=(37, 5))
    means = []
    for a in x:
        total = 0.0
        for b in x:
            square = 0.0
            for u, v in zip(a.tolist(), b.tolist(), strict=True):
                square += (u - v) * (u - v)
            total += math.sqrt(square)
        means.append(total / (len(x) - 1))
    for best in (0, 17, 36):
        expected = (means[best] - min(means)) / (max(means) - min(means))
        assert evolutionary_factor(x, best) == expected
