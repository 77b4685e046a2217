"""The robot's software as a whole, in a world of mere kinematics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.kinematic import ROOM, TICK_NS, KinematicRun
from helpers.rooms import Room, box

from simloop.config import Config
from simloop.messages import (
    Estimate,
    Event,
    GoalReading,
    MapUpdate,
    Mode,
    Plan,
    RobotStatus,
    SmoothPath,
    WorldView,
)


def test_its_status_can_be_asked_before_its_first_step():
    run = KinematicRun()
    assert run.robot.status is RobotStatus.DRIVING
    assert run.robot.messages == []


def test_it_stands_until_its_first_scan_and_then_plans_and_drives():
    run = KinematicRun()
    for _ in range(9):
        assert run.step().mode is Mode.STOP
    assert not run.said(Plan)
    run.run(2.0)
    plans = run.said(Plan)
    assert [p.reason for p in plans[:2]] == ["first", "frame"]
    assert plans[0].t_ns == 10 * TICK_NS
    assert len(run.said(WorldView)) == len(run.said(MapUpdate)) == len(plans)
    assert run.said(SmoothPath) and run.commands[-1].mode is Mode.FOLLOW


def test_it_arrives_where_it_was_sent_and_says_so():
    run = KinematicRun().run(12.0)
    assert run.robot.status is RobotStatus.ARRIVED
    assert math.dist(run.pose[:2], (2.5, 0.0)) < 0.1
    assert run.commands[-1].mode is Mode.ARRIVED
    assert run.commands[-1].voltage_v.tolist() == [0.0, 0.0]


def test_one_estimate_is_published_each_period():
    run = KinematicRun().run(0.5)
    stamps = [message.t_ns for message in run.said(Estimate)]
    assert stamps == [TICK_NS * k for k in range(1, 51)]


def test_each_command_keeps_the_limits_of_acceleration():
    drive = Config().drive
    run = KinematicRun(goal=(2.0, 1.2)).run(10.0)
    speed = np.array([c.speed_mps for c in run.commands])
    rate = np.array([c.yaw_rate_radps for c in run.commands])
    assert np.diff(speed, prepend=0.0).max() <= drive.max_accel_mps2 * 0.01 + 1e-9
    assert np.diff(speed, prepend=0.0).min() >= -drive.max_brake_mps2 * 0.01 - 1e-9
    assert np.abs(np.diff(rate, prepend=0.0)).max() <= drive.max_yaw_accel_radps2 * 0.01 + 1e-9
    assert speed.max() > 0.4


def test_without_scans_it_brakes_stands_and_says_why():
    run = KinematicRun().run(3.0)
    assert run.commands[-1].speed_mps > 0.3
    run.run(1.5, scans=False)
    assert run.velocity == (0.0, 0.0)
    assert run.commands[-1].mode is Mode.DEGRADED
    assert any("no scans" in event.text for event in run.said(Event))
    before = run.pose.copy()
    run.run(1.0)
    assert math.dist(run.pose[:2], before[:2]) > 0.05


class ShortSighted(Room):
    """A room of which a scan shows only what is near."""

    def ranges(self, pose, most=1.3):
        return super().ranges(pose, most)


def test_a_wall_that_comes_into_sight_on_its_path_makes_it_plan_anew():
    walls = (*box(-1.0, -1.0, 4.0, 1.4), *box(1.6, -1.0, 1.7, 0.4))
    run = KinematicRun(room=ShortSighted(*walls)).run(4.0)
    assert "blocked" in [p.reason for p in run.said(Plan)]


def test_a_goal_that_is_walled_in_is_called_unreachable():
    cage = Room(*box(-1.0, -2.0, 4.0, 2.0), *box(2.1, -0.4, 2.9, 0.4))
    run = KinematicRun(room=cage).run(20.0)
    assert run.robot.status is RobotStatus.UNREACHABLE


def test_news_of_a_goal_that_moves_are_followed():
    run = KinematicRun().run(1.0)
    for k in range(400):
        goal = GoalReading(run.t_ns + TICK_NS, np.array([2.5, 0.002 * k]))
        run.step(goal=goal)
    end = [p.waypoints_m[-1, 1] for p in run.said(Plan)]
    assert end[0] == pytest.approx(0.0, abs=0.01) and end[-1] > 0.3


def test_a_charged_latency_delays_the_path_and_counts_every_plan_that_was_made():
    planner = replace(Config().planner, latency="per_evaluation", latency_s=1e-5)
    run = KinematicRun(config=replace(Config(), planner=planner)).run(2.0)
    plan, path = run.said(Plan)[0], run.said(SmoothPath)[0]
    charged = round(plan.evaluations * 1e-5 / 0.01) * TICK_NS
    assert charged > 0
    taken = next(c.t_ns for c in run.commands if c.mode is not Mode.STOP)
    assert taken - plan.t_ns == charged
    assert path.t_ns == plan.t_ns


def test_it_does_not_touch_the_room():
    run = KinematicRun(goal=(3.2, 1.4)).run(15.0)
    assert run.robot.status is RobotStatus.ARRIVED
    assert ROOM.ranges(run.pose).min() > 0.25


LANE = Room(*box(-3.0, -0.33, 0.6, 0.33))


@pytest.mark.parametrize("camera", [False, True])
def test_out_of_a_dead_end_it_reverses_only_where_it_has_been_or_sees_all_round(camera):
    """Too narrow to turn in, with the goal behind: a camera looks ahead only."""
    run = KinematicRun(goal=(-2.0, 0.0), room=LANE, camera=camera).run(4.0)
    slowest = min(command.speed_mps for command in run.commands)
    assert slowest >= 0.0 if camera else slowest < -0.1


def test_with_a_camera_it_drives_and_arrives_too():
    run = KinematicRun(camera=True).run(12.0)
    assert run.robot.status is RobotStatus.ARRIVED


def test_put_down_elsewhere_it_stands_finds_itself_and_arrives():
    walls = (*box(-1.0, -2.0, 4.0, 2.0), *box(-1.0, 0.6, 1.2, 2.0))
    run = KinematicRun(goal=(3.0, 1.0), room=Room(*walls)).run(3.0)
    run.pose = np.array([3.2, -1.2, 2.0])
    run.run(3.0)
    texts = [event.text for event in run.said(Event)]
    assert any("found its pose" in text for text in texts), texts
    run.run(20.0)
    assert run.robot.status is RobotStatus.ARRIVED
    assert math.dist(run.pose[:2], (3.0, 1.0)) < 0.12
