"""What each replan came to: its account, and its gap to the exact optimum in the same view."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from simloop.benchmarks.planners.scenes import scene
from simloop.cli.main import run_scenario
from simloop.config import PlannerConfig, VehicleConfig
from simloop.evaluation import plan_gap
from simloop.evaluation.plan_gap import PlanLog, least_cost
from simloop.planners.protocol import PlanningTask
from simloop.planners.reference.exact import exact_path
from simloop.planners.registry import make_planner

POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
CONFIG = PlannerConfig(safe_distance_m=0.3, start_turn_weight=0.0)


def planned(seed=0, config=CONFIG, **changes):
    """S1 and a plan for it; changes: of the task."""
    one = scene("S1")[0]
    task = replace(PlanningTask(one.world, one.start, one.goal, one.safe_m), **changes)
    return one, make_planner(config, POINT).plan(task, np.random.default_rng(seed))


def test_a_record_holds_the_plans_account_and_its_gap():
    one, plan = planned()
    log = PlanLog(CONFIG)
    for at in (1, 5):
        log.offer(replace(plan, t_ns=at))
        log.offer(replace(one.world, t_ns=at))
    first, second = log.records()
    assert replace(first, t_s=0.0) == replace(second, t_s=0.0)
    assert (first.cost, first.evaluations) == (plan.cost, plan.evaluations)
    assert first.exact_cost == pytest.approx(4.4250, abs=1e-4)  # J* of S1
    assert first.gap_percent == pytest.approx(100.0 * (plan.cost / 4.4250 - 1.0), abs=3e-3)
    assert -0.01 < first.gap_percent < 0.2


def recorded(one, plan, config=CONFIG):
    """The record of one plan."""
    log = PlanLog(config)
    log.offer(plan)
    log.offer(one.world)
    return log.records()[0]


def test_the_optimum_keeps_the_plans_safe_distance_and_not_the_usual_one():
    """Else a plan through a gap that is tight, or with more room, is measured against another."""
    for safe_m in (0.25, 0.34):
        one, plan = planned(safe_distance_m=safe_m)
        record = recorded(one, plan)
        assert plan.safe and record.safe_distance_m == safe_m != CONFIG.safe_distance_m
        assert -0.01 < record.gap_percent < 0.3


def test_the_gap_leaves_the_start_turn_out_and_the_record_shows_it():
    """The optimum knows no heading: its J has no start turn."""
    config = replace(CONFIG, start_turn_weight=0.1)
    one = scene("S1")[0]
    one, plan = planned(config=config, start=np.array([*one.start[:2], 3.0]))
    record = recorded(one, plan, config)
    assert 0.2 < record.start_turn_cost < 0.4 and record.cost == plan.cost
    assert plan.cost > record.exact_cost + 0.2
    assert -0.01 < record.gap_percent < 1.0


def test_a_plan_that_is_not_safe_has_no_gap():
    one, plan = planned()
    log = PlanLog(CONFIG)
    log.offer(replace(plan, safe=False))
    log.offer(one.world)
    assert log.records()[0].gap_percent is None and log.records()[0].exact_cost is not None


def test_a_start_too_close_to_a_disc_makes_that_disc_alone_smaller():
    one = scene("S1")[0]
    start = np.array([3.2, 0.6 + 0.30 + 0.1])  # 0.1 m from the first disc
    best = least_cost(CONFIG, one.world, start, one.goal, safe_distance_m=0.3)
    without = exact_path(one.world.discs_xyr_m[1:], one.world.bounds_m, start, one.goal, safe_m=0.3)
    assert best is not None and best >= without.cost - 1e-9
    as_it_is = exact_path(one.world.discs_xyr_m, one.world.bounds_m, start, one.goal, safe_m=0.3)
    assert as_it_is is None
    assert least_cost(CONFIG, one.world, one.goal, one.goal, safe_distance_m=0.3) is None


def test_the_result_of_a_run_holds_each_replan(tmp_path):
    file = tmp_path / "result.json"
    run_scenario("open", json_file=file, quiet=True)
    figures = json.loads(file.read_text())
    plans = figures["plans"]
    assert len(plans) == figures["replans"] + 1
    assert sum(p["evaluations"] for p in plans) == figures["plan_evaluations"]
    assert plans[0]["reason"] == "first" and plans[0]["planner"] == "tlbo"
    assert all(p["cost"] > 0.0 for p in plans)
    assert any(p["gap_percent"] is not None for p in plans)


def log_of(count, discs=None):
    """A log of plans with one view each, of a given number of discs."""
    one, plan = planned()
    view = one.world
    if discs is not None:
        xyr = np.column_stack([np.linspace(0.0, 9.0, discs), np.full(discs, 50.0), np.ones(discs)])
        view = replace(view, discs_xyr_m=xyr)
    log = PlanLog(CONFIG)
    for at in range(count):
        log.offer(replace(plan, t_ns=at))
        log.offer(replace(view, t_ns=at))
    return log


def test_the_optima_of_a_run_can_be_stopped():
    asked = []
    records = log_of(6).records(stop=lambda: asked.append(0) or len(asked) > 2)
    assert [r.exact_cost is not None for r in records] == [True, True, False, False, False, False]
    assert all(r.gap_percent is None for r in records[2:]) and records[5].cost == records[0].cost


def test_optima_have_a_budget_and_are_spread_over_a_long_run(monkeypatch):
    log = log_of(40, discs=300)
    assert (log.plans, log.optima) == (40, 20)  # 300^3 x 40 is above the budget
    assert log_of(3, discs=500).optima == 0  # one alone would take too long
    discs = len(planned()[0].world.discs_xyr_m)
    monkeypatch.setattr(plan_gap, "_MOST_WORK", 4 * (discs + 2) ** 3)
    known = [record.exact_cost is not None for record in log_of(9).records()]
    assert known == [at % 4 == 0 for at in range(9)]


def test_a_log_keeps_little_of_each_plan():
    log = log_of(1)
    kept = log._plans[0]
    assert kept.candidates_m == () and len(kept.history) == 0
