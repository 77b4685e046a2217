"""Recovery: notices that nothing comes of it, finds the free arc, and does not try for ever."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.tracking import VEHICLE, allowed, arbiter_of, monitor_of, situation

from simloop.config import RecoveryConfig
from simloop.control.arbiter import STILL, VelocityArbiter
from simloop.control.recovery import Recovery
from simloop.ekf import GAUGE
from simloop.geometry.footprint import room_after
from simloop.loop import Simulation
from simloop.messages import Estimate, Event, Mode
from simloop.scenario.load import load

CONFIG = RecoveryConfig()
HALF_LENGTH, HALF_WIDTH = 0.5 * VEHICLE.length_m, 0.5 * VEHICLE.width_m
TICK_NS = 10_000_000


def estimate_at(t_ns, pose=(0.0, 0.0, 0.0)):
    state = np.zeros(7)
    state[:3], state[GAUGE] = pose, 1.23
    return Estimate(t_ns, state, np.eye(7))


def seen_from(pose, points):
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def recover(points, towards=None, attempt=1):
    """One recovery of a robot at the origin that moves just as the monitor allows: its poses."""
    points, pose = np.array(points, float).reshape(-1, 2), np.zeros(3)
    monitor, arbiter, last = monitor_of(), arbiter_of(), STILL
    recovery, poses = Recovery(CONFIG), [pose.copy()]
    for _ in range(attempt):
        recovery.start(estimate_at(0), None if towards is None else np.array(towards, float))
    for tick in range(2000):
        if tick % 10 == 0:
            monitor.observe(seen_from(pose, points), pose)
        t_ns = tick * TICK_NS
        if not recovery.goes_on(estimate_at(t_ns, pose)):
            return np.array(poses)
        seen = monitor.points_at(pose)
        now = situation(pose, seen, t_ns, stuck=True, towards=recovery.towards)
        last, _ = arbiter.choose(STILL, last, now)
        speed, rate = last
        middle = pose[2] + 0.005 * rate
        pose += 0.01 * np.array([speed * math.cos(middle), speed * math.sin(middle), rate])
        poses.append(pose.copy())
    raise AssertionError("the recovery never ended")


def line(a, b, n=60):
    return np.linspace(a, b, n)


def least_room(points, poses):
    limits = (0.0, 0.0, HALF_LENGTH, HALF_WIDTH)
    return min(room_after(seen_from(pose, points), *limits) for pose in poses)


def test_before_a_wall_it_backs_off():
    wall = line((HALF_LENGTH + 0.012, -1.0), (HALF_LENGTH + 0.012, 1.0))
    poses = recover(wall)
    assert poses[-1, 0] < -0.15
    assert least_room(wall, poses) > 0.008


def test_with_something_close_behind_it_goes_on():
    wall = line((-HALF_LENGTH - 0.012, -1.0), (-HALF_LENGTH - 0.012, 1.0))
    assert recover(wall)[-1, 0] > 0.15


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_blocked_at_both_ends_it_finds_the_arc_that_is_free(side):
    """Before one corner and behind the one across: only turning away from both leads out."""
    end = HALF_LENGTH + 0.0105
    points = np.concatenate(
        [line((s * end, s * side * 0.12), (s * end, s * side * 0.4)) for s in (-1.0, 1.0)]
    )
    monitor = monitor_of()
    monitor.observe(points, np.zeros(3))
    assert allowed(monitor, 0.12, 0.0, np.zeros(3))[0] == 0.0
    assert allowed(monitor, -0.12, 0.0, np.zeros(3))[0] == 0.0
    poses = recover(points)
    assert side * poses[-1, 2] > 0.2
    assert least_room(points, poses[-1:]) > least_room(points, poses[:1]) + 0.01
    assert least_room(points, poses) > 0.005


def test_in_a_narrow_lane_it_takes_the_end_that_its_path_leads_to():
    lane = np.concatenate([line((-1, s * 0.26), (1, s * 0.26), 120) for s in (-1, 1)])
    assert recover(lane, towards=(-0.4, 0.0))[-1, 0] < -0.2
    assert recover(lane, towards=(0.4, 0.0))[-1, 0] > 0.2


def test_walled_in_it_stands_still_and_ends():
    box = np.concatenate(
        [line((s * (HALF_LENGTH + 0.01), -0.3), (s * (HALF_LENGTH + 0.01), 0.3)) for s in (-1, 1)]
        + [line((-0.3, s * (HALF_WIDTH + 0.01)), (0.3, s * (HALF_WIDTH + 0.01))) for s in (-1, 1)]
    )
    poses = recover(box)
    assert np.abs(poses[:, :2]).max() < 0.01
    assert len(poses) <= 2.0 * CONFIG.back_off_m / CONFIG.back_off_mps / 0.01 + 2


def test_it_ends_when_it_has_come_its_way():
    poses = recover(line((HALF_LENGTH + 0.012, -1.0), (HALF_LENGTH + 0.012, 1.0)))
    assert math.dist(poses[-1, :2], (0, 0)) == pytest.approx(CONFIG.back_off_m, abs=0.005)


def watched(poses_of, wants_to_move=True, seconds=10.0):
    """Seconds until a robot that moves as ``poses_of(t)`` says is called stuck; inf if never."""
    recovery = Recovery(CONFIG)
    for tick in range(round(seconds * 100)):
        if recovery.is_stuck(estimate_at(tick * TICK_NS, poses_of(0.01 * tick)), wants_to_move):
            return 0.01 * tick
    return math.inf


def test_who_stands_still_against_its_will_is_stuck_soon():
    assert watched(lambda t: (0, 0, 0)) == pytest.approx(CONFIG.stuck_s, abs=0.05)


def test_who_waits_drives_or_turns_once_is_not_stuck():
    assert watched(lambda t: (0, 0, 0), wants_to_move=False) == math.inf
    assert watched(lambda t: (0.05 * t, 0, 0)) == math.inf
    assert watched(lambda t: (0, 0, 1.2 * t), seconds=math.pi / 1.2) == math.inf


def test_slow_progress_is_progress_and_a_crawl_is_not():
    assert watched(lambda t: (0.04 * t, 0, 0)) == math.inf
    assert watched(lambda t: (0, 0, 0.2 * t), seconds=3.5) == math.inf
    assert watched(lambda t: (0.005 * t, 0, 0)) == pytest.approx(CONFIG.stuck_s, abs=0.05)


def test_who_turns_to_and_fro_is_stuck_in_the_end():
    assert CONFIG.stuck_s < watched(lambda t: (0, 0, 0.4 * math.sin(2.0 * t))) < 6.0


def test_a_run_whose_robot_is_held_for_ever_ends_stuck(monkeypatch):
    held = lambda self, asked, last, now: (STILL, Mode.HELD)  # noqa: E731
    monkeypatch.setattr(VelocityArbiter, "choose", held)
    events = []
    listen = [lambda m: events.append(m) if isinstance(m, Event) else None]
    result = Simulation(load("open"), listeners=listen).run()
    assert result.outcome == "stuck"
    assert sum("stuck" in e.text for e in events) == CONFIG.attempts + 1
