"""The account of what the robot reported about its localisation, on cases made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.evaluation.health_account import health_account
from simloop.messages import Health, HealthReason, HealthState

A, B = HealthReason.GYRO, HealthReason.MISFIT
T_NS = np.arange(1, 101) * 10_000_000


def account(reports, wrong_from=100, moves=True, turns_radps=0.0):
    """One second; from an index on, the pose is 0.2 m off."""
    error, truth = np.zeros((100, 3)), np.zeros((100, 3))
    error[wrong_from:, 0] = 0.2
    if moves:
        truth[:, 0] = 0.01 * np.arange(100)
    truth[:, 2] = (3.0 + turns_radps * 0.01 * np.arange(100) + np.pi) % (2.0 * np.pi) - np.pi
    return health_account(reports, T_NS, error, truth)


def test_no_report_is_ok_all_the_time():
    found = account([])
    assert (found["ok_s"], found["degraded_s"], found["lost_s"]) == pytest.approx((1.0, 0.0, 0.0))
    assert found["final"] == "ok" and found["reasons_s"] == {} and found["unsaid_s"] == 0.0


def test_each_state_and_reason_lasts_until_the_next_report():
    reports = [
        Health(T_NS[19], HealthState.DEGRADED, (A, B), False),
        Health(T_NS[59], HealthState.LOST, (B,), True),
        Health(T_NS[89], HealthState.OK, (), False),
    ]
    found = account(reports)
    seconds = found["ok_s"], found["degraded_s"], found["lost_s"]
    assert seconds == pytest.approx((0.19 + 0.11, 0.4, 0.3))
    assert found["reasons_s"] == pytest.approx({A.value: 0.4, B.value: 0.7})
    assert found["final"] == "ok"


def test_a_wrong_pose_counts_while_the_robot_moves_and_reports_ok():
    assert account([], wrong_from=40)["unsaid_s"] == pytest.approx(0.6)
    assert account([], wrong_from=40, moves=False)["unsaid_s"] == 0.0
    warned = [Health(T_NS[69], HealthState.DEGRADED, (A,), False)]
    assert account(warned, wrong_from=40)["unsaid_s"] == pytest.approx(0.29)


@pytest.mark.parametrize(
    ("turns_radps", "unsaid_s"), [(0.0, 0.0), (0.04, 0.0), (-0.06, 0.6), (0.5, 0.6)]
)
def test_a_wrong_pose_counts_while_the_robot_turns_on_the_spot(turns_radps, unsaid_s):
    found = account([], wrong_from=40, moves=False, turns_radps=turns_radps)
    assert found["unsaid_s"] == pytest.approx(unsaid_s)
