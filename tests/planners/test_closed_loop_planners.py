"""Every planner drives: by name, charged for what it tries, late in the same way on each run."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.loop import Simulation
from simloop.messages import Plan, SmoothPath
from simloop.planners import registry
from simloop.scenario.load import load
from simloop.truth import Truth


def drive(scenario, planner="tlbo", *overrides, seed=1000):
    heard = []
    simulation = Simulation(load(scenario, overrides, seed=seed, planner=planner), [heard.append])
    return simulation.run(), heard


def plans_of(heard):
    return [m for m in heard if isinstance(m, Plan)]


@pytest.mark.parametrize("name", registry.available())
def test_every_planner_drives(name):
    """For two seconds; whatever it thinks of the way, it says so and breaks nothing."""
    settings = ("time_limit_s=2.0", "planner.max_evaluations=2000")
    result, heard = drive("experiment", name, *settings)
    plans = plans_of(heard)
    assert plans and {plan.planner for plan in plans} == {name}
    assert all(np.isfinite(plan.waypoints_m).all() and plan.evaluations > 0 for plan in plans)
    assert result.outcome == "timeout" and result.metrics["contact_count"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.available())
def test_no_planner_harms_the_robot(name):
    for seed in (1000, 1001):
        result, _ = drive("experiment", name, seed=seed)
        assert result.metrics["contact_count"] == 0


def test_a_slow_planner_arrives_late_in_the_same_way_each_time():
    settings = ("planner.latency=per_evaluation", "planner.latency_s=5e-5")
    quick, _ = drive("open")
    late, heard = drive("open", "de", *settings)
    again, _ = drive("open", "de", *settings)
    assert quick.reached and late.reached
    assert late.metrics["state_hash"] == again.metrics["state_hash"]
    first = plans_of(heard)[0]
    moved = next(m.t_ns for m in heard if isinstance(m, Truth) and m.velocity_body[0] > 0.01)
    assert moved >= first.t_ns + 5e-5 * first.evaluations * 1e9 - 10_000_000
    assert late.metrics["sim_time_s"] > quick.metrics["sim_time_s"] + 0.1


def test_all_that_a_frame_tried_is_charged():
    """The plan that is taken is often the second of two: both have cost their time."""
    _, heard = drive("experiment", "de", "time_limit_s=1.0", "planner.max_evaluations=2000")
    assert plans_of(heard)[0].evaluations > 2000


def test_the_papers_pace():
    """1.34 s of each 1.83 s frame are spent planning, at 0.12 m/s at most."""
    result, heard = drive("experiment_paper_pace", "tlbo", "time_limit_s=8.0", seed=0)
    plan = plans_of(heard)[0]
    truths = [m for m in heard if isinstance(m, Truth)]
    moved = next(m.t_ns for m in truths if m.velocity_body[0] > 0.01)
    assert 1.30e9 < moved - plan.t_ns < 1.50e9
    assert 0.10 < max(m.velocity_body[0] for m in truths) < 0.14  # a tenth too fast for a moment
    assert result.outcome == "timeout"
    assert any(isinstance(m, SmoothPath) for m in heard)
