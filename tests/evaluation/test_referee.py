"""The referee: every outcome, every status of the robot, and which of two comes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.truths import truth_at

from simloop.evaluation.referee import Outcome, Referee, distance_to_go_m
from simloop.messages import RobotStatus

GOAL = np.array([2.0, 0.0])
NEAR, FAR = (1.95, 0.0, 0.0), (1.0, 0.0, 0.0)
DRIVING, ARRIVED = RobotStatus.DRIVING, RobotStatus.ARRIVED


def judge(status, pose=FAR, speed=0.0, contacts=0, t_s=1.0, goal_moves=False, goal=GOAL):
    truth = replace(truth_at(t_s, pose, rates=(speed, 0, 0, 0, 0, 0)), contact_count=contacts)
    return Referee(0.1, 5.0, goal_moves).judge(truth, status, goal)


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (RobotStatus.DRIVING, None),
        (RobotStatus.ARRIVED, Outcome.MISSED),
        (RobotStatus.LOST, Outcome.LOST),
        (RobotStatus.UNREACHABLE, Outcome.UNREACHABLE),
        (RobotStatus.GAVE_UP, Outcome.STUCK),
    ],
)
def test_each_status_far_from_the_goal(status, expected):
    assert judge(status) is expected


def test_each_status_is_judged():
    """A new status without an outcome would raise here."""
    assert all(judge(status) is not None for status in RobotStatus if status is not DRIVING)


@pytest.mark.parametrize(
    ("pose", "speed", "expected"),
    [
        (NEAR, 0.0, Outcome.REACHED),
        ((2.0, 0.09, 0.0), -0.009, Outcome.REACHED),
        ((1.89, 0.0, 0.0), 0.0, Outcome.MISSED),
        (NEAR, 0.02, None),  # it rolls still
        (NEAR, -0.02, None),
    ],
)
def test_a_robot_that_reports_arrival(pose, speed, expected):
    assert judge(ARRIVED, pose, speed) is expected


def test_a_robot_must_report_arrival_to_have_reached_its_goal():
    assert judge(DRIVING, NEAR) is None


def test_a_robot_need_not_stand_at_a_goal_that_moves():
    assert judge(ARRIVED, NEAR, speed=0.3, goal_moves=True) is Outcome.REACHED
    assert judge(ARRIVED, FAR, speed=0.3, goal_moves=True) is Outcome.MISSED
    assert judge(ARRIVED, FAR, goal=np.array([1.05, 0.0])) is Outcome.REACHED


@pytest.mark.parametrize("status", list(RobotStatus))
@pytest.mark.parametrize("pose", [NEAR, FAR])
def test_a_collision_comes_before_everything(status, pose):
    assert judge(status, pose, contacts=1, t_s=9.0) is Outcome.COLLISION


@pytest.mark.parametrize("status", list(RobotStatus))
def test_unstable_physics_comes_before_a_collision(status):
    truth = replace(truth_at(1.0, NEAR), contact_count=1, unstable="MuJoCo warns")
    assert Referee(0.1, 5.0, False).judge(truth, status, GOAL) is Outcome.UNSTABLE
    assert not Outcome.UNSTABLE.success


def test_the_time_limit_comes_after_the_robots_report():
    assert judge(DRIVING, t_s=4.99) is None
    assert judge(DRIVING, t_s=5.0) is Outcome.TIMEOUT
    assert judge(ARRIVED, NEAR, t_s=5.0) is Outcome.REACHED
    assert judge(ARRIVED, NEAR, speed=0.3, t_s=5.0) is Outcome.TIMEOUT
    assert judge(RobotStatus.GAVE_UP, t_s=5.0) is Outcome.STUCK


def test_outcomes_have_words_and_one_is_a_success():
    words = "reached collision stuck unreachable lost missed timeout unstable interrupted"
    assert sorted(Outcome) == sorted(words.split())
    assert [outcome for outcome in Outcome if outcome.success] == [Outcome.REACHED]
    assert len({outcome.description for outcome in Outcome}) == len(Outcome)


def test_the_distance_to_go_is_straight():
    assert distance_to_go_m(truth_at(pose=(-1.0, 4.0, 2.0)), GOAL) == pytest.approx(5.0)
