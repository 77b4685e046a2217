"""How the robot sees what moves, foresees it, keeps apart from it, and meets a goal that moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.tracking import DRIVE, arbiter_of, separation_of, situation
from hypothesis import assume, given
from hypothesis import strategies as st

from simloop.config import SeparationConfig
from simloop.control.arbiter import STILL
from simloop.control.separation import (
    gap_after,
    gaps_now,
    least_gap,
    mover_discs,
    safe_part,
    stays_clear,
)
from simloop.messages import GoalReading, Mode, MoverTracks, Velocity, WorldView
from simloop.navigation.moving_goal import MovingGoal
from simloop.navigation.planner_world import add_predicted_movers, meeting_time, put_discs

LIMITS = np.array([0.15, 1.0, 6.0, 0.245, 0.2325, 0.06, 0.1])
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
    seen = add_predicted_movers(view, crossing, np.zeros(3), 0.4)
    row, column = np.unravel_index(int(seen.distance_m.argmin()), seen.distance_m.shape)
    x, y = -2.0 + 0.05 * (column + 0.5), -2.0 + 0.05 * (row + 0.5)
    assert seen.movers is crossing
    assert -0.5 < y < 0.6
    # |(1, -1 + 0.4 t)| = 0.4 t at t = 2.5: at (1, 0), and a little about it.
    assert x == pytest.approx(1.0, abs=0.35)
    nearest = seen.distance_m[40, 60]
    assert nearest == pytest.approx(0.0, abs=0.05)
    assert seen.distance_m[20, 60] > 0.4  # where it is now it will not be
    assert add_predicted_movers(view, None, np.zeros(3), 0.4) is view
    going = add_predicted_movers(view, tracks_of((1.0, 0.0, 0.5, 0.0, 0.2)), np.zeros(3), 0.4)
    assert np.array_equal(going.distance_m, view.distance_m)


@given(coordinate, coordinate, speeds, speeds, speeds, rates)
def test_a_robot_that_yields_stands_before_it_is_reached(x, y, vx, vy, speed, rate):
    """The part that is allowed, braked in its time, keeps the mover off until the robot stands."""
    pose = np.zeros(3)
    mover = mover_discs(tracks_of((x, y, vx, vy, 0.2)), 0, SeparationConfig())
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
        mover = mover_discs(
            tracks_of((0.49, 0.0, vx, vy, 0.2)), 0, SeparationConfig()
        )  # 4.5 cm before the front
        return stays_clear(np.zeros(3), speed, 0.0, mover, LIMITS)

    assert clear(0.0, 0.0, -0.2)
    assert not clear(0.0, 0.0, 0.2)
    assert clear(0.3, 0.0, -0.2)
    assert not clear(-0.3, 0.0, -0.2)
    assert not clear(0.0, 0.3, -0.2)


def test_only_a_slow_robot_passes_what_could_turn_round_and_reach_it():
    # Beside it, 20 cm off and going away: at speed it would not stand in time if that turned round.
    mover = mover_discs(tracks_of((0.1, 0.62, 0.0, 0.4, 0.2)), 0, SeparationConfig())
    clear = [stays_clear(np.zeros(3), v, 0.0, mover, LIMITS) for v in (0.2, 0.45)]
    assert clear == [True, False]


ACCELERATIONS = np.array([DRIVE.max_accel_mps2, DRIVE.max_yaw_accel_radps2])


def choose(asked, tracks, t_ns=0, last=STILL, **others):
    return arbiter_of().choose(
        Velocity(*asked), last, situation(t_ns=t_ns, movers=tracks, **others)
    )


def test_it_drives_on_yields_and_stands_without_news():
    moving = Velocity(0.4, 0.1)
    assert choose(moving, None, last=moving) == (moving, Mode.FOLLOW)
    far = tracks_of((3.0, 3.0, 0.0, 0.0, 0.2))
    assert choose(moving, far, last=moving) == (moving, Mode.FOLLOW)
    before = tracks_of((0.6, 0.0, 0.0, 0.0, 0.2))
    velocity, mode = choose((0.4, 0.0), before, last=Velocity(0.4, 0.0))
    assert (velocity.speed_mps < 0.4, mode) == (True, Mode.YIELD)
    assert choose((0.4, 0.0), far, 10**9) == (STILL, Mode.YIELD)
    pose, discs = np.zeros(3), mover_discs(far, 0, SeparationConfig())
    assert separation_of().must_stand(pose, far, discs, gaps_now(pose, discs, HALF), 10**9)


def test_it_gets_out_of_the_way_of_what_is_coming_and_only_where_it_may():
    coming = tracks_of((1.1, 0.0, -0.4, 0.0, 0.2))
    velocity, mode = choose((0.0, 0.0), coming)
    assert mode is Mode.DODGE
    discs = mover_discs(coming, 0, SeparationConfig())
    pose, ends = np.zeros(3), (10.0 * np.array(velocity), np.zeros(2))
    gaps = [least_gap(pose, np.zeros(2), at, ACCELERATIONS, discs, HALF, 1.5) for at in ends]
    assert gaps[0] > gaps[1]
    assert choose((0.0, 0.0), coming, may_evade=False) == (STILL, Mode.FOLLOW)
    assert choose((0.0, 0.0), coming, speed_cap_mps=0.0) == (STILL, Mode.FOLLOW)
    ahead, _ = choose((0.0, 0.0), coming, may_reverse=False)
    assert ahead.speed_mps >= 0.0


def stands_beside(tracks, seconds, asked=(0.3, 0.0)):
    """What a robot is told that has stood for some seconds, with tracks about it."""
    arbiter, began = arbiter_of(), 10**10
    arbiter.choose(Velocity(0.3, 0.0), STILL, situation(t_ns=began))
    t_ns = began + round(seconds * 1e9)
    now = situation(t_ns=t_ns, movers=replace(tracks, t_ns=t_ns))
    (speed, _), mode = arbiter.choose(Velocity(*asked), STILL, now)
    return speed, mode


def test_beside_what_has_just_stopped_it_stands_a_while_but_not_for_ever():
    # At its side, where it will not be run into by going straight on: not moving now, but of late.
    beside = tracks_of((-0.1, 0.55, 0.0, 0.0, 0.2))
    lively = replace(beside, pace_mps=np.array([0.4]))
    assert stands_beside(lively, 0.5) == (0.0, Mode.YIELD)
    assert stands_beside(lively, 3.5)[0] > 0.0
    assert stands_beside(beside, 0.5)[0] > 0.0
    off = tracks_of((-0.1, 0.8, 0.0, 0.0, 0.2))
    assert stands_beside(replace(off, pace_mps=np.array([0.4])), 0.5)[0] > 0.0
    # On the move it is not stopped by it.
    moving = arbiter_of()
    moving.choose(Velocity(0.3, 0.0), STILL, situation(t_ns=10**10))
    now = situation(t_ns=10**10, movers=replace(lively, t_ns=10**10))
    assert moving.choose(Velocity(0.3, 0.0), Velocity(0.3, 0.0), now)[0].speed_mps > 0.0


def test_what_goes_away_does_not_hold_it():
    # Touching its side, on the way off, and on the way in.
    for vy, held in ((0.3, False), (-0.3, True)):
        tracks = tracks_of((-0.1, 0.46, 0.0, vy, 0.25))
        assert (stands_beside(tracks, 0.5, (0.0, 0.0))[1] is Mode.YIELD) == held


def test_an_evasion_goes_on_where_nothing_better_is_found():
    """It retreats from what comes; then nothing is better, and what is asked leads back to it."""
    arbiter, last, t_ns = arbiter_of(), STILL, 10**10
    asked = Velocity(0.4, 0.0)
    for k in range(20):
        coming = tracks_of((1.0, 0.0, -0.4, 0.0, 0.2), t_ns=t_ns)
        last, mode = arbiter.choose(asked, last, situation(t_ns=t_ns, movers=coming))
        t_ns += 10_000_000
        assert mode is Mode.DODGE, k
    assert last.speed_mps < 0.0
    # Hemmed in on all sides: no arc keeps away, whatever the robot does.
    ring = [(0.75 * math.cos(a), 0.75 * math.sin(a)) for a in np.arange(0.0, 6.3, 0.7)]
    modes = []
    for _ in range(120):
        tracks = tracks_of(*((x, y, -0.4 * x, -0.4 * y, 0.1) for x, y in ring), t_ns=t_ns)
        velocity, mode = arbiter.choose(asked, last, situation(t_ns=t_ns, movers=tracks))
        modes.append((mode is Mode.DODGE, velocity.speed_mps <= 0.0))
        t_ns += 10_000_000
    assert all(dodges and retreats for dodges, retreats in modes[:40])
    assert not all(dodges for dodges, _ in modes)


def test_at_the_start_there_is_no_evasion_that_could_go_on():
    ring = [(0.75 * math.cos(a), 0.75 * math.sin(a)) for a in np.arange(0.0, 6.3, 0.7)]
    hemmed_in = tracks_of(*((x, y, -0.4 * x, -0.4 * y, 0.1) for x, y in ring))
    assert choose(Velocity(0.4, 0.0), hemmed_in)[1] is not Mode.DODGE


def test_a_goal_is_met_where_it_will_be():
    pursuit, pose = MovingGoal(np.array([2.0, 0.0])), np.zeros(3)
    view = view_of(np.full((80, 80), 9.0, np.float32))
    assert not pursuit.moves
    assert pursuit.aim(view, pose, 0.45, 0.26) == pytest.approx([2.0, 0.0])
    assert not pursuit.is_out_of_date(10**9, pose, 0.45)
    for k in range(1, 41):
        pursuit.update(GoalReading(k * SCAN_NS, np.array([1.0, 0.02 * k - 0.8])))
    now = replace(view, t_ns=40 * SCAN_NS)
    aim = pursuit.aim(now, pose, 0.45, 0.26)
    when = meeting_time(np.array([1.0, 0.0]), np.array([0.0, 0.2]), pose, 0.8 * 0.45)
    assert aim == pytest.approx([1.0, 0.2 * min(when, 3.0)], abs=0.02)
    walled = replace(now, distance_m=np.zeros((80, 80), np.float32))
    assert pursuit.aim(walled, pose, 0.45, 0.26) == pytest.approx([1.0, 0.0], abs=0.03)
    assert pursuit.is_out_of_date(45 * SCAN_NS, pose, 0.45)


def test_what_came_within_the_margin_is_expected_again_as_it_came():
    held, pose = separation_of(), np.zeros(3)
    coming = tracks_of((0.5, 0.0, -0.4, 0.0, 0.2))
    assert held.expected_returns(coming, mover_discs(coming, 0, SeparationConfig())).size == 0
    there = mover_discs(coming, 0, SeparationConfig())
    held.note_visits(pose, coming, there, gaps_now(pose, there, HALF))
    later = 2 * 10**9
    waiting = tracks_of((0.7, 0.0, 0.0, 0.0, 0.2), t_ns=later)
    discs = mover_discs(waiting, later, SeparationConfig())
    returning = held.expected_returns(waiting, discs)
    assert returning[0, 2:4] == pytest.approx([-0.4, 0.0])
    assert returning[0, :2] == pytest.approx([0.7, 0.0])
    forgotten = tracks_of((0.7, 0.0, 0.0, 0.0, 0.2), t_ns=later + 9 * 10**9)
    assert held.expected_returns(forgotten, discs).size == 0


def test_only_what_no_motion_can_bring_near_is_left_out_of_sight():
    """Against predictions of many motions: what is not looked at never comes within the threat."""
    held, rng, far = separation_of(), np.random.default_rng(3), 0
    for _ in range(400):
        x, y, vx, vy = rng.uniform(-2.5, 2.5, 2).tolist() + rng.uniform(-0.6, 0.6, 2).tolist()
        discs = mover_discs(tracks_of((x, y, vx, vy, 0.2)), 0, SeparationConfig())
        gaps = gaps_now(np.zeros(3), discs, HALF)
        if held.may_be_met(discs, gaps, DRIVE.max_speed_mps):
            continue
        far += 1
        for _ in range(20):
            target = rng.uniform(-1.0, 1.0, 2) * [DRIVE.max_speed_mps, DRIVE.max_yaw_rate_radps]
            last = rng.uniform(-1.0, 1.0, 2) * [DRIVE.max_speed_mps, DRIVE.max_yaw_rate_radps]
            gap = least_gap(np.zeros(3), last, target, ACCELERATIONS, discs, HALF, 1.5)
            assert gap > SeparationConfig().threat_m
    assert far > 50


def test_while_something_may_touch_it_it_stands_longer():
    near = tracks_of((-0.1, 0.46, 0.0, 0.0, 0.25))
    lively = replace(near, pace_mps=np.array([0.4]))
    assert stands_beside(lively, 2.0) == (0.0, Mode.YIELD)
    beside = replace(tracks_of((-0.1, 0.55, 0.0, 0.0, 0.2)), pace_mps=np.array([0.4]))
    assert stands_beside(beside, 1.0) == (0.0, Mode.YIELD)
    assert stands_beside(beside, 2.0)[0] > 0.0


def test_what_is_calm_may_be_left_although_there_is_less_room_than_the_growth():
    pose, calm = np.zeros(3), tracks_of((0.51, 0.0, 0.0, 0.0, 0.2))
    lively = replace(calm, pace_mps=np.array([0.4]))
    for tracks, free in ((calm, True), (lively, False)):
        discs = mover_discs(tracks, 0, SeparationConfig())
        assert stays_clear(pose, -0.008, 0.0, discs, LIMITS) == free
        assert not stays_clear(pose, 0.1, 0.0, discs, LIMITS)
