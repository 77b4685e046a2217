"""The choice among gaps: one with room where it costs little more, a tight one for a long way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.paths import view_of

from simloop.config import Config, PlannerConfig, SmootherConfig, VehicleConfig
from simloop.navigation.bezier_smoother import Smoother
from simloop.navigation.gap_choice import GapChooser, remaining_length

START, GOAL = np.array([-1.5, 0.0, 0.0]), np.array([1.5, 0.0])


def wall_with_gaps(*gaps):
    """A wall of discs across the way, open at each (y, half width), m.

    Each y is the centre of a cell: between two the field knows no ridge.
    """
    ends, r = sorted((y - half, y + half) for y, half in gaps), 0.15
    low, discs = -3.0, []
    for a, b in [*ends, (3.0, 3.0)]:
        discs += [(0.0, y, r) for y in np.arange(a - r, low + r, -0.15)]
        discs.append((0.0, low + r, r))
        low = b
    return view_of(discs)


def crossing(view, pose=START, stuck=False, **settings):
    """Where, y in m, the plan crosses the wall; and its length, m."""
    planner = replace(PlannerConfig(), **settings)
    chooser = GapChooser(replace(Config(), planner=planner), np.random.default_rng(0))
    if stuck:
        chooser.stop_trying_tight_gaps()
    plan = chooser.plan(view, pose, GOAL, None, "test")
    path = Smoother(SmootherConfig(), VehicleConfig()).smooth(plan, view, pose)
    assert plan.safe
    return float(path.xy_m[np.argmin(np.abs(path.xy_m[:, 0])), 1]), plan.length_m


TWO_GAPS = wall_with_gaps((0.475, 0.32), (-0.625, 0.45))


def test_a_gap_with_room_is_taken_where_it_costs_little_more():
    assert crossing(TWO_GAPS, prefer_m=0.08)[0] < 0.0
    assert crossing(TWO_GAPS, prefer_m=0.0)[0] > 0.0
    assert crossing(TWO_GAPS, prefer_m=0.02)[0] > 0.0  # the nearer gap has that too


def test_a_gap_that_is_wide_enough_is_taken_where_the_other_costs_more():
    assert crossing(TWO_GAPS, prefer_m=0.08, prefer_share=0.001)[0] > 0.0


def test_a_gap_that_is_a_little_too_narrow_is_taken_where_the_way_round_is_long():
    view = wall_with_gaps((0.475, 0.256), (-2.225, 0.5))
    assert crossing(view)[0] > 0.0
    assert crossing(view, squeeze_m=0.0)[0] < 0.0


def test_whoever_got_stuck_no_longer_squeezes():
    view = wall_with_gaps((0.475, 0.256), (-2.225, 0.5))
    assert crossing(view, stuck=True)[0] < 0.0


def test_a_hard_plan_gets_no_second_one(monkeypatch):
    monkeypatch.setattr("simloop.navigation.gap_choice._HARD", 0)
    assert crossing(TWO_GAPS, prefer_m=0.08)[0] > 0.0


@pytest.mark.parametrize(("x", "left"), [(-1.5, 3.0), (-0.5, 2.0), (1.0, 0.5), (2.0, 0.0)])
def test_what_is_left_of_a_plan(x, left):
    chooser = GapChooser(Config(), np.random.default_rng(0))
    plan = chooser.plan(view_of(), START, GOAL, None, "test")
    assert remaining_length(plan, np.array([x, 0.02, 0.0])) == pytest.approx(left, abs=1e-3)
