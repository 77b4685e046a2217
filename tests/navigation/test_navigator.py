"""Navigation: every plan that was made counts, beliefs are tried in turn, paths are said."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.paths import view_of

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.messages import Estimate, Event, Plan, SmoothPath, WorldView
from simloop.navigation import gap_choice
from simloop.navigation.navigator import (
    Navigator,
    PlanReason,
    Progress,
    Surroundings,
    plan_heading,
)

GOAL = np.array([2.0, 0.0])
WALLED = view_of([(0.8, y, 0.15) for y in np.arange(-3.0, 3.0, 0.1)])
OPEN = view_of()
GUESSED, SEEN = np.ones((1, 2)), np.zeros((1, 2))


class CountingPlanner:
    """Goes straight; safe only in an open world; each plan has one evaluation more."""

    name = "counting"

    def __init__(self):
        self.tasks = []

    def plan(self, task, rng):
        self.tasks.append(task)
        points = np.array([task.start[:2], task.goal])
        safe = bool(task.world.distance_m.min() > 1.0)
        return Plan(
            task.world.t_ns, points, 1.0, 1.0, 0.0, safe, len(self.tasks), 0, self.name,
            task.reason, safe_distance_m=task.safe_distance_m,
        )  # fmt: skip


@pytest.fixture
def planner(monkeypatch):
    made = CountingPlanner()
    monkeypatch.setattr(gap_choice, "make_planner", lambda *_: made)
    return made


def navigator():
    return Navigator(Config(), GOAL, 0.1, np.random.default_rng(0), Profiler())


def estimate_at(t_s=0.0):
    state = np.zeros(9)
    state[6] = 1.2
    return Estimate(round(t_s * 1e9), state, np.eye(9))


def surroundings(view, standing=(None,), new_scan=True):
    return Surroundings(new_scan, None, standing, view)


NO_PATH = Progress(None, 0, False, True)


def test_it_plans_first_without_a_path_and_smooths_what_it_planned(planner):
    it = navigator()
    plan = it.step(estimate_at(0.1), surroundings(lambda *_: OPEN), NO_PATH)
    assert plan is not None and plan.reason == PlanReason.FIRST
    assert plan_heading(plan) == 0.0
    path = it.smooth(estimate_at(0.1), reverses=False)
    assert path.safe and it.path_ns == 100_000_000
    assert [type(m) for m in it.messages] == [Plan, WorldView, SmoothPath]
    progress = Progress(path, 0, False, True)
    assert it.step(estimate_at(0.2), surroundings(lambda *_: OPEN), progress) is None
    again = it.step(estimate_at(1.83), surroundings(lambda *_: OPEN), progress)
    assert again is not None and again.reason == PlanReason.FRAME


def test_what_is_guessed_is_left_out_where_it_leaves_no_way_and_all_plans_count(planner):
    seen = []

    def view(place, standing):
        seen.append(standing)
        return WALLED if standing is GUESSED else OPEN

    plan = navigator().step(estimate_at(0.1), surroundings(view, (GUESSED, SEEN)), NO_PATH)
    assert plan is not None and plan.safe
    assert seen[0] is GUESSED and seen[1] is SEEN
    made = len(planner.tasks)
    assert made > 2
    assert plan.evaluations == made * (made + 1) // 2


def test_nothing_is_planned_while_the_robot_is_not_to(planner):
    waiting = Progress(None, 0, False, False)
    assert navigator().step(estimate_at(), surroundings(lambda *_: OPEN), waiting) is None
    assert planner.tasks == []


def test_an_old_path_and_a_lost_one_are_reasons_to_plan(planner):
    it = navigator()
    it.step(estimate_at(0.1), surroundings(lambda *_: OPEN), NO_PATH)
    path = it.smooth(estimate_at(0.1), reverses=False)
    old = it.step(estimate_at(0.2), surroundings(lambda *_: OPEN), Progress(path, 0, True, True))
    assert old is not None and old.reason == PlanReason.STALE
    it.smooth(estimate_at(0.2), reverses=False)
    lost = it.step(estimate_at(0.3), surroundings(lambda *_: OPEN), NO_PATH)
    assert lost is not None and lost.reason == PlanReason.RECOVERED


def test_an_unsafe_plan_is_said_and_the_best_is_followed(planner):
    it = navigator()
    plan = it.step(estimate_at(0.1), surroundings(lambda *_: WALLED), NO_PATH)
    assert plan is not None and not plan.safe
    assert any("no safe path" in m.text for m in it.messages if isinstance(m, Event))


def test_a_smoothed_path_that_lost_what_the_plan_kept_is_said(planner, monkeypatch):
    it = navigator()
    it.step(estimate_at(0.1), surroundings(lambda *_: OPEN), NO_PATH)
    samples = np.linspace(0.0, 2.0, 5)
    path = SmoothPath(
        0, np.stack([samples, 0 * samples], axis=1), *np.zeros((2, 5)), samples, np.ones(5), False
    )
    monkeypatch.setattr("simloop.navigation.bezier_smoother.Smoother.smooth", lambda *_: path)
    assert it.smooth(estimate_at(0.1), reverses=False) is path
    assert any("safety distance" in m.text for m in it.messages if isinstance(m, Event))


def test_the_next_place_on_the_path_is_a_little_way_ahead(planner):
    it = navigator()
    it.step(estimate_at(0.1), surroundings(lambda *_: OPEN), NO_PATH)
    path = it.smooth(estimate_at(0.1), reverses=False)
    place = it.next_place(np.zeros(3), Progress(path, 0, False, True))
    assert place == pytest.approx([0.42, 0.0], abs=0.03)
    assert it.next_place(np.zeros(3), NO_PATH) is None


def test_after_it_was_told_to_forget_it_plans_as_at_first(planner):
    it = navigator()
    it.step(estimate_at(0.1), surroundings(lambda *_: OPEN), NO_PATH)
    it.forget()
    plan = it.step(estimate_at(0.2), surroundings(lambda *_: OPEN), NO_PATH)
    assert plan is not None and plan.reason == PlanReason.FIRST
