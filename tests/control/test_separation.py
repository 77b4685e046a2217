"""How the robot sees what moves, foresees it, keeps apart from it, and meets a goal that moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from simloop.config import TrackerConfig, VehicleConfig
from simloop.control.collision_monitor import CollisionMonitor
from simloop.control.separation import (
    Separation,
    discs_at,
    gap_after,
    least_gap,
    safe_part,
    stays_clear,
)
from simloop.messages import GoalReading, MoverTracks, WorldView
from simloop.navigation.moving_goal import Pursuit
from simloop.navigation.planner_world import foresee, meeting_time, put_discs

LIMITS = np.array([0.15, 1.0, 6.0, 0.245, 0.2325, 0.06])
HALF = LIMITS[3:5]
SCAN_NS = 100_000_000
coordinate = st.floats(-2.0, 2.0)
speeds = st.floats(-0.45, 0.45)
rates = st.floats(-1.6, 1.6)


def tracks_of(*rows, t_ns=0):
    """Tracks from rows of x, y, vx, vy, radius."""
    table = np.array(rows, float)
    return MoverTracks(
        t_ns, np.arange(len(rows)), table[:, :2].copy(), table[:, 2:4].copy(),
        table[:, 4].copy(), np.zeros(len(rows)), np.hypot(*table[:, 2:4].T),
    )  # fmt: skip


@given(coordinate, coordinate, speeds, speeds, st.floats(0.1, 0.6))
def test_at_the_meeting_both_have_come_as_far(x, y, vx, vy, pace):
    place, velocity = np.array([x, y]), np.array([vx, vy])
    when = meeting_time(place, velocity, np.zeros(3), pace)
    if when is None:
        assert math.hypot(vx, vy) > pace * 0.99
        return
    assert when >= 0.0
    assume(when < 1e3)
    assert np.hypot(*(place + when * velocity)) == pytest.approx(pace * when, rel=1e-6, abs=1e-6)


def view_of(distance):
    bounds = np.array([-1.0, -1.0, 1.0, 1.0])
    return WorldView(0, np.array([-2.0, -2.0]), 0.05, distance, np.zeros((0, 3)), bounds)


def test_discs_are_put_into_the_field_exactly():
    rng = np.random.default_rng(0)
    field = rng.uniform(0.0, 2.0, (80, 80)).astype(np.float32)
    discs = np.column_stack([rng.uniform(-2, 2, (5, 2)), rng.uniform(0.1, 0.4, 5)])
    found = field.copy()
    put_discs(found, -2.0, -2.0, 0.05, discs)
    at = -2.0 + 0.05 * (np.arange(80) + 0.5)
    x, y = np.meshgrid(at, at)
    each = np.hypot(x[..., None] - discs[:, 0], y[..., None] - discs[:, 1]) - discs[:, 2]
    assert found == pytest.approx(np.minimum(field, np.maximum(each.min(axis=-1), 0.0)), abs=1e-6)


def test_a_mover_stands_in_the_planners_world_where_it_will_be_met():
    view = view_of(np.full((80, 80), 9.0, np.float32))
    crossing = tracks_of((1.0, -1.0, 0.0, 0.4, 0.2))
    seen = foresee(view, crossing, np.zeros(3), 0.4)
    row, column = np.unravel_index(int(seen.distance_m.argmin()), seen.distance_m.shape)
    x, y = -2.0 + 0.05 * (column + 0.5), -2.0 + 0.05 * (row + 0.5)
    assert seen.movers is crossing
    assert -0.5 < y < 0.6
    # |(1, -1 + 0.4 t)| = 0.4 t at t = 2.5: at (1, 0), and a little about it.
    assert x == pytest.approx(1.0, abs=0.35)
    nearest = seen.distance_m[40, 60]
    assert nearest == pytest.approx(0.0, abs=0.05)
    assert seen.distance_m[20, 60] > 0.4  # where it is now it will not be
    assert foresee(view, None, np.zeros(3), 0.4) is view
    going = foresee(view, tracks_of((1.0, 0.0, 0.5, 0.0, 0.2)), np.zeros(3), 0.4)
    assert np.array_equal(going.distance_m, view.distance_m)


@given(coordinate, coordinate, speeds, speeds, speeds, rates)
def test_a_robot_that_yields_stands_before_it_is_reached(x, y, vx, vy, speed, rate):
    """The part that is allowed, braked in its time, keeps the mover off until the robot stands."""
    pose = np.zeros(3)
    mover = discs_at(tracks_of((x, y, vx, vy, 0.2)), 0)
    assume(gap_after(pose, 0.0, 0.0, 0.0, mover[0], HALF) > LIMITS[5])
    part = safe_part(pose, speed, rate, mover, LIMITS)
    v, w = part * speed, part * rate
    braking = max(abs(v) / LIMITS[1], abs(w) / LIMITS[2])
    pace = math.hypot(vx, vy)
    for t in np.linspace(0.0, LIMITS[0] + braking, 40):
        if v == w == 0.0:
            break
        slowed = max(0.0, t - LIMITS[0])
        gone = t - (0.5 * slowed**2 / braking if braking else 0.0)
        assert gap_after(pose, v * gone, w * gone, t, mover[0], HALF) > 0.0
        # Whichever way it turns at once:
        there = gap_after(pose, v * gone, w * gone, 0.0, mover[0], HALF)
        assert there > min(pace * t, LIMITS[5]) - 0.03


def test_next_to_the_robot_only_what_goes_away_or_stands_lets_it_drive():
    def clear(vx, vy, speed):
        mover = discs_at(tracks_of((0.49, 0.0, vx, vy, 0.2)), 0)  # 4.5 cm before the front
        return stays_clear(np.zeros(3), speed, 0.0, mover, LIMITS)

    assert clear(0.0, 0.0, -0.2)
    assert not clear(0.0, 0.0, 0.2)
    assert clear(0.3, 0.0, -0.2)
    assert not clear(-0.3, 0.0, -0.2)
    assert not clear(0.0, 0.3, -0.2)


def separation():
    config, vehicle = TrackerConfig(), VehicleConfig()
    monitor = CollisionMonitor(config, vehicle, 0.1)
    return Separation(config, vehicle, monitor)


def test_it_drives_on_yields_dodges_and_stands_without_news():
    pose = np.zeros(3)
    assert separation().allow(0.4, 0.1, pose, None, 0) == (0.4, 0.1, "")
    far = tracks_of((3.0, 3.0, 0.0, 0.0, 0.2))
    assert separation().allow(0.4, 0.1, pose, far, 0) == (0.4, 0.1, "")
    before = tracks_of((0.6, 0.0, 0.0, 0.0, 0.2))
    speed, _, mode = separation().allow(0.4, 0.0, pose, before, 0)
    assert (speed < 0.4, mode) == (True, "yield")
    coming = tracks_of((1.1, 0.0, -0.4, 0.0, 0.2))
    speed, rate, mode = separation().allow(0.0, 0.0, pose, coming, 0)
    assert mode == "dodge"
    dodged = least_gap(pose, speed, rate, discs_at(coming, 0), HALF, 1.5)
    assert dodged > least_gap(pose, 0.0, 0.0, discs_at(coming, 0), HALF, 1.5) + 0.04
    assert separation().allow(0.0, 0.0, pose, coming, 0, False) == (0.0, 0.0, "")
    assert separation().allow(0.4, 0.0, pose, far, 10**9) == (0.0, 0.0, "yield")


def stands_beside(tracks, seconds, asked=(0.3, 0.0)):
    """What a robot is told that has stood for some seconds, with tracks about it."""
    held = separation()
    held.allow(0.3, 0.0, np.zeros(3), None, 10**10)
    t_ns = 10**10 + round(seconds * 1e9)
    return held.allow(*asked, np.zeros(3), replace(tracks, t_ns=t_ns), t_ns)


def test_beside_what_has_just_stopped_it_stands_a_while_but_not_for_ever():
    # At its side, where it will not be run into by going straight on: not moving now, but of late.
    beside = tracks_of((-0.1, 0.55, 0.0, 0.0, 0.2))
    lively = replace(beside, pace_mps=np.array([0.4]))
    assert stands_beside(lively, 0.5) == (0.0, 0.0, "yield")
    assert stands_beside(lively, 3.5)[0] > 0.0
    assert stands_beside(beside, 0.5)[0] > 0.0
    off = tracks_of((-0.1, 0.8, 0.0, 0.0, 0.2))
    assert stands_beside(replace(off, pace_mps=np.array([0.4])), 0.5)[0] > 0.0
    # On the move it is not stopped by it.
    moving = separation()
    moving.allow(0.3, 0.0, np.zeros(3), None, 10**10)
    assert moving.allow(0.3, 0.0, np.zeros(3), replace(lively, t_ns=10**10), 10**10)[0] > 0.0


def test_a_goal_is_met_where_it_will_be():
    pursuit, pose = Pursuit(np.array([2.0, 0.0])), np.zeros(3)
    view = view_of(np.full((80, 80), 9.0, np.float32))
    assert not pursuit.moves
    assert pursuit.aim(view, pose, 0.45, 0.26) == pytest.approx([2.0, 0.0])
    assert not pursuit.strays(10**9, pose, 0.45)
    for k in range(1, 41):
        pursuit.hear(GoalReading(k * SCAN_NS, np.array([1.0, 0.02 * k - 0.8])))
    now = replace(view, t_ns=40 * SCAN_NS)
    aim = pursuit.aim(now, pose, 0.45, 0.26)
    when = meeting_time(np.array([1.0, 0.0]), np.array([0.0, 0.2]), pose, 0.8 * 0.45)
    assert aim == pytest.approx([1.0, 0.2 * min(when, 3.0)], abs=0.02)
    walled = replace(now, distance_m=np.zeros((80, 80), np.float32))
    assert pursuit.aim(walled, pose, 0.45, 0.26) == pytest.approx([1.0, 0.0], abs=0.03)
    assert pursuit.strays(45 * SCAN_NS, pose, 0.45)
