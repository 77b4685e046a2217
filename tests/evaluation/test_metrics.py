"""The figures of a run, each checked on a case with a known answer."""

from __future__ import annotations

import json
import math
from time import perf_counter

import numpy as np
import pytest

from simloop.common.profiler import NullProfiler, Profiler
from simloop.evaluation.metrics import RunMetrics
from simloop.evaluation.provenance import machine, versions
from simloop.evaluation.referee import Outcome
from simloop.messages import Estimate, Plan
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.truth import Truth
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import Section, rasterise
from simloop.worlds.outline_gap import clearances, least_clearance

BODY = Body(0.49, 0.465, 0.2)
TICK_NS = 10_000_000


def truth(tick, x, y, yaw=0.0, contacts=0, energy=0.0):
    three, two = np.zeros(3), np.zeros(2)
    return Truth(
        tick * TICK_NS, np.array([x, y, yaw]), three, np.zeros(4), np.zeros(6), three,
        two, two, two, two, energy, contacts, False,
    )  # fmt: skip


def estimate(tick, x, y, yaw, variance=1e-4):
    state = np.array([x, y, yaw, 0.0, 0.0, 0.0, 1.0])
    return Estimate(tick * TICK_NS, state, variance * np.eye(7))


def plan(evaluations):
    points = np.zeros((2, 2))
    return Plan(0, points, 0.0, 0.0, 0.0, True, evaluations, 1, "tlbo", safe_distance_m=0.26)


@pytest.fixture(scope="module")
def floor():
    return build_world(load("open")).floor


def metrics_of(floor, messages, outcome=Outcome.REACHED, overrides=(), **kwargs):
    metrics = RunMetrics(load("open", ["goal=[3.0, 4.0]", *overrides]), floor, BODY)
    for message in messages:
        metrics.offer(message)
    arguments = {"state_hash": "abc", "wall_time_s": 0.5, "plan_ms": [1.0, 2.0, 3.0]} | kwargs
    return metrics.result(outcome=outcome, **arguments)


def straight(share, ticks=100, **kwargs):
    return [truth(i, 3 * share * i / ticks, 4 * share * i / ticks, **kwargs)
            for i in range(ticks + 1)]  # fmt: skip


def test_a_straight_run_to_the_goal(floor):
    result = metrics_of(floor, straight(0.99))
    assert result["outcome"] == "reached"
    assert result["sim_time_s"] == 1.0 and result["real_time_factor"] == 2.0
    assert result["path_length_m"] == pytest.approx(4.95)
    assert result["shortest_path_m"] == pytest.approx(4.9)  # to the tolerance's circle
    assert result["spl"] == pytest.approx(4.9 / 4.95)
    assert result["min_clearance_m"] is None  # there is no obstacle
    assert (result["plan_ms_p50"], result["plan_ms_p99"]) == (2.0, pytest.approx(2.98))


def test_a_detour_lowers_spl_and_a_failure_makes_it_zero(floor):
    there_and_back = [*straight(0.5), *reversed(straight(0.5)), *straight(1.0)]
    renumbered = [truth(i, *at.pose_xyyaw[:2]) for i, at in enumerate(there_and_back)]
    result = metrics_of(floor, renumbered)
    assert result["path_length_m"] == pytest.approx(10.0)
    assert result["spl"] == pytest.approx(0.49)
    for outcome in Outcome:
        result = metrics_of(floor, renumbered, outcome)
        assert (result["spl"] > 0.0) == outcome.success


def test_the_outcome_is_the_referees_and_a_plain_word(floor):
    for outcome in Outcome:
        word = metrics_of(floor, straight(0.99), outcome)["outcome"]
        assert word == outcome and type(word) is str


def test_a_goal_that_moved_is_measured_to_where_it_is(floor):
    result = metrics_of(floor, straight(0.99), goal=np.array([6.0, 0.0]))
    assert result["distance_to_go_m"] == pytest.approx(math.dist((2.97, 3.96), (6.0, 0.0)))
    assert result["shortest_path_m"] == pytest.approx(5.9)


def test_estimation_errors(floor):
    truths = straight(0.99)
    estimates = [
        estimate(i, t.pose_xyyaw[0] + 0.03, t.pose_xyyaw[1] - 0.04, 2 * math.pi - 0.02)
        for i, t in enumerate(truths)
    ]
    result = metrics_of(floor, [m for pair in zip(truths, estimates, strict=True) for m in pair])
    assert result["ate_rmse_m"] == pytest.approx(0.05)
    assert result["yaw_rmse_rad"] == pytest.approx(0.02)
    assert result["nees_mean"] == pytest.approx((0.03**2 + 0.04**2 + 0.02**2) / 1e-4)


def test_estimates_are_compared_at_their_own_instants(floor):
    truths = straight(0.99)[::10]
    estimates = [estimate(i, 3 * 0.99 * i / 100, 4 * 0.99 * i / 100, 0.0) for i in range(101)]
    assert metrics_of(floor, truths + estimates)["ate_rmse_m"] == pytest.approx(0.0, abs=1e-12)


def test_a_yaw_that_wraps_is_no_error(floor):
    yaws = [3.1 + 0.01 * i for i in range(10)]
    truths = [truth(2 * i, 0, 0, math.remainder(yaw, 2 * math.pi)) for i, yaw in enumerate(yaws)]
    estimates = [
        estimate(2 * i + 1, 0, 0, math.remainder(yaw + 0.005, 2 * math.pi))
        for i, yaw in enumerate(yaws[:-1])
    ]
    result = metrics_of(floor, truths + estimates)
    assert result["yaw_rmse_rad"] == pytest.approx(0.0, abs=1e-9)


def test_plans_and_energy_are_counted(floor):
    result = metrics_of(floor, [plan(100), plan(50), plan(7), truth(5, 0, 0, energy=12.5)])
    assert result["replans"] == 2 and result["plan_evaluations"] == 157
    assert result["energy_j"] == 12.5 and result["contact_count"] == 0


def test_a_run_without_messages_has_figures(floor):
    result = metrics_of(floor, [], plan_ms=[], outcome=Outcome.INTERRUPTED)
    assert result["path_length_m"] == 0.0 and result["replans"] == 0
    assert result["plan_ms_p50"] is None and result["ate_rmse_m"] is None
    json.dumps(result, allow_nan=False)


def test_all_documented_figures_are_there(floor):
    promised = """outcome sim_time_s wall_time_s real_time_factor path_length_m shortest_path_m spl
        min_clearance_m contact_count ate_rmse_m yaw_rmse_rad nees_mean replans plan_ms_p50
        plan_ms_p99 plan_evaluations energy_j state_hash seed scenario planner versions"""
    result = metrics_of(floor, straight(1.0))
    assert set(promised.split()) <= set(result)
    assert result["state_hash"] == "abc" and result["scenario"] == "open"
    assert {"python", "simloop", "mujoco", "numpy"} <= set(versions())
    assert set(machine()) == {"cpu", "cores", "platform"}
    json.dumps(result, allow_nan=False)


def test_listening_is_cheap(floor):
    metrics = RunMetrics(load("open"), floor, BODY)
    messages = [m for i in range(2000) for m in (truth(i, 0, 0), estimate(i, 0, 0, 0))]
    costs = []
    for _ in range(5):
        began = perf_counter()
        for message in messages:
            metrics.offer(message)
        costs.append((perf_counter() - began) / 2000)
    assert min(costs) < 5e-6  # a control tick: one truth and one estimate


def square(x, y, side):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Section("box", 0.5 * side * corners + [x, y])


@pytest.mark.parametrize(
    ("section", "pose", "gap"),
    [
        (square(1.0, 0.0, 0.2), (0, 0, 0), 0.9 - 0.245),
        (square(1.0, 0.0, 0.2), (0, 0, math.pi / 2), 0.9 - 0.2325),
        (square(0.0, -1.0, 0.2), (0, 0, 0), 0.9 - 0.2325),
        (Section("disc", np.array([[1.0, 0.0]]), 0.1), (0, 0, 0), 0.9 - 0.245),
        (square(1.0, 1.0, 0.2), (0, 0, 0), math.hypot(0.9 - 0.245, 0.9 - 0.2325)),
        (Section("disc", np.array([[1.0, 0.0]]), 0.1), (0, 0, math.atan2(0.2325, 0.245)),
         0.9 - math.hypot(0.245, 0.2325)),
    ],
)  # fmt: skip
def test_gap_between_outline_and_obstacle(section, pose, gap):
    floor = rasterise([section], (-2, -2, 2, 2), 0.5)
    assert clearances(floor, np.array([pose], float), BODY)[0] == pytest.approx(gap)


@pytest.mark.parametrize(
    "section",
    [
        square(0.25, 0.0, 0.2),  # a corner of each inside the other's
        square(0.0, 0.0, 0.1),  # inside the robot's outline
        square(0.0, 0.0, 2.0),  # around the robot
        Section("wall", np.array([[0.1, -1], [0.12, -1], [0.12, 1], [0.1, 1]])),  # across it
        Section("disc", np.array([[0.0, 0.0]]), 0.05),
    ],
)
def test_overlap_is_no_clearance(section):
    floor = rasterise([section], (-2, -2, 2, 2), 0.5)
    assert clearances(floor, np.zeros((1, 3)), BODY)[0] <= 0.0


def test_the_least_clearance_of_many_is_that_of_all():
    floor = build_world(load("experiment")).floor
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(0, 4, (300, 2)), rng.uniform(-3, 3, 300)])
    for chosen in (poses, poses[clearances(floor, poses, BODY) > 0.05]):
        expected = clearances(floor, chosen, BODY).min()
        assert least_clearance(floor, chosen, BODY) == expected


def test_profiler_times_stages_and_its_absence_costs_nothing():
    profiler = Profiler()
    double = profiler.wrap("double", lambda x: 2 * x)
    assert [double(i) for i in range(3)] == [0, 2, 4]
    with pytest.raises(KeyError), profiler.stage("failing"):
        raise KeyError
    summary = profiler.summary(wall_time_s=1.0)
    assert summary["double"]["calls"] == 3 and summary["failing"]["calls"] == 1
    assert 0 < summary["double"]["mean_ms"] <= summary["double"]["worst_ms"]
    total_ms = summary["double"]["mean_ms"] * 3
    assert summary["double"]["share"] == pytest.approx(total_ms * 1e-3)
    assert profiler.stage("double").milliseconds == pytest.approx(
        [ns * 1e-6 for ns in profiler.stage("double").durations_ns]
    )
    function = len
    assert NullProfiler().wrap("any", function) is function
    with NullProfiler().stage("any"):
        pass
