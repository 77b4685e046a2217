"""The velocity arbiter's limits, by properties: whatever is asked, seen or moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.stopping import at_arc, gaps
from helpers.tracking import DRIVE, MONITOR, arbiter_of, separation_of, situation
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simloop.config import SeparationConfig
from simloop.control.arbiter import STILL
from simloop.control.separation import gap_after, mover_discs, safe_part, stays_clear
from simloop.control.trail import is_on_trail
from simloop.messages import Mode, MoverTracks, Velocity

TICK_NS, TICK_S = 10_000_000, 0.01
HALF = separation_of().limits[3:5]
EATEN = 0.009  # of the margin, by what lies between two steps along an arc
modes = st.sampled_from(list(Mode))
asked = st.builds(Velocity, st.floats(-0.6, 0.6), st.floats(-2.5, 2.5))
caps = st.sampled_from([0.0, 0.05, 0.15, math.inf])


@st.composite
def points_about(draw):
    """(n, 2) in map, outside the footprint at the origin and about its margin or farther."""
    found = []
    for _ in range(draw(st.integers(0, 8))):
        bearing = draw(st.floats(-math.pi, math.pi))
        far = draw(st.floats(0.25, 1.5))
        found.append((far * math.cos(bearing), far * math.sin(bearing)))
    points = np.array(found, float).reshape(-1, 2)
    return points[gaps(np.zeros(3), points) > MONITOR.margin_m] if len(points) else points


@st.composite
def movers_about(draw):
    """Tracks of one to three things that are not next to the robot."""
    rows = []
    for _ in range(draw(st.integers(1, 3))):
        bearing, far = draw(st.floats(-math.pi, math.pi)), draw(st.floats(0.75, 2.5))
        course, pace = draw(st.floats(-math.pi, math.pi)), draw(st.floats(0.0, 0.5))
        rows.append(
            (far * math.cos(bearing), far * math.sin(bearing),
             pace * math.cos(course), pace * math.sin(course), draw(st.floats(0.08, 0.3)))
        )  # fmt: skip
    table = np.array(rows)
    return MoverTracks(
        0, np.arange(len(rows)), table[:, :2].copy(), table[:, 2:4].copy(),
        table[:, 4].copy(), np.zeros(len(rows)), np.hypot(*table[:, 2:4].T),
    )  # fmt: skip


def tracks_after(tracks, t_ns):
    """The same things later, going on as they went, as a fresh scan would tell."""
    return MoverTracks(
        t_ns, tracks.number.copy(), tracks.places_at(t_ns), tracks.velocity_mps.copy(),
        tracks.radius_m.copy(), tracks.std_m.copy(), tracks.pace_mps.copy(),
    )  # fmt: skip


def seen_from(pose, points):
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def moved(pose, velocity):
    """The pose a period on."""
    speed, rate = velocity
    x, y, turned = at_arc(speed * TICK_S, rate * TICK_S)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array([pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y, pose[2] + turned])


def drive(requests, points, tracks=None, ticks=15, surprise=None, **others):
    """Poses, velocities and modes of a robot that is asked for one velocity after another.

    surprise: (n, 2) points in map that are there only from the second request on.
    """
    arbiter, pose, last = arbiter_of(), np.zeros(3), STILL
    out = []
    for k, (request, more) in enumerate(requests):
        if k == 1 and surprise is not None:
            points = np.concatenate((points, surprise))
        for j in range(ticks):
            t_ns = (k * ticks + j) * TICK_NS
            movers = None if tracks is None else tracks_after(tracks, t_ns)
            now = situation(pose, seen_from(pose, points), t_ns, movers=movers, **(others | more))
            chosen, mode = arbiter.choose(request, last, now)
            out.append((pose, last, chosen, mode, now))
            pose, last = moved(pose, chosen), chosen
    return out


requests = st.lists(
    st.tuples(
        asked,
        st.fixed_dictionaries(
            {"speed_cap_mps": caps, "may_reverse": st.booleans(), "stuck": st.booleans(),
             "doing": modes, "may_evade": st.booleans()}
        ),
    ),
    min_size=1,
    max_size=5,
)  # fmt: skip


@given(requests, points_about(), points_about(), st.none() | movers_about())
@settings(max_examples=200, deadline=None)
def test_every_period_keeps_the_limits_of_acceleration_in_every_mode(
    wanted, points, surprise, tracks
):
    for _, last, chosen, _, _ in drive(wanted, points, tracks, surprise=surprise):
        faster = abs(chosen.speed_mps) > abs(last.speed_mps)
        most = (DRIVE.max_accel_mps2 if faster else DRIVE.max_brake_mps2) * TICK_S
        assert abs(chosen.speed_mps - last.speed_mps) <= most + 1e-9
        change = abs(chosen.yaw_rate_radps - last.yaw_rate_radps)
        assert change <= DRIVE.max_yaw_accel_radps2 * TICK_S + 1e-9
        assert abs(chosen.yaw_rate_radps) <= DRIVE.max_yaw_rate_radps + 1e-9
        assert abs(chosen.speed_mps) <= DRIVE.max_speed_mps + 1e-9


def test_before_a_wall_that_appears_too_near_it_brakes_no_harder_than_it_may():
    wall = np.column_stack((np.full(41, 0.8), np.linspace(-0.4, 0.4, 41)))
    ahead = (Velocity(0.47, 0.0), {})
    run = drive([ahead, ahead], np.empty((0, 2)), ticks=100, surprise=wall)
    speeds = np.array([chosen.speed_mps for _, _, chosen, _, _ in run])
    assert speeds[99] > 0.4 and speeds[-1] < 0.1
    assert np.diff(speeds).min() >= -DRIVE.max_brake_mps2 * TICK_S - 1e-9


@given(asked, points_about(), st.none() | movers_about(), modes, st.booleans(), st.booleans())
@settings(max_examples=150, deadline=None)
def test_a_cap_of_zero_moves_nothing(wanted, points, tracks, doing, stuck, may_evade):
    more = {"doing": doing, "stuck": stuck, "may_evade": may_evade, "speed_cap_mps": 0.0}
    for _, _, chosen, _, _ in drive([(wanted, more)], points, tracks, ticks=30):
        assert chosen == STILL


@given(asked, asked, points_about(), st.none() | movers_about(), st.booleans())
@settings(max_examples=100, deadline=None)
def test_a_cap_of_zero_brings_a_moving_robot_to_a_stand(first, then, points, tracks, stuck):
    wanted = [(first, {}), (then, {"speed_cap_mps": 0.0, "stuck": stuck})]
    run = drive(wanted, points, tracks, ticks=60)
    speeds = np.array([np.abs(chosen) for _, _, chosen, _, _ in run[60:]])
    assert (np.diff(speeds, axis=0) <= 1e-12).all()
    assert run[-1][2] == STILL


@given(requests, st.sampled_from([0.05, 0.15]), st.none() | movers_about())
@settings(max_examples=120, deadline=None)
def test_a_cap_holds_whatever_moves(wanted, cap, tracks):
    wanted = [(request, {**more, "speed_cap_mps": cap}) for request, more in wanted]
    for _, _, chosen, _, _ in drive(wanted, np.empty((0, 2)), tracks):
        assert abs(chosen.speed_mps) <= cap + 1e-9


@given(requests, points_about(), st.none() | movers_about())
@settings(max_examples=150, deadline=None)
def test_it_never_goes_backwards_where_it_may_not(wanted, points, tracks):
    wanted = [(request, {**more, "may_reverse": False}) for request, more in wanted]
    for _, _, chosen, _, _ in drive(wanted, points, tracks):
        assert chosen.speed_mps >= 0.0


def test_told_on_the_way_not_to_reverse_it_brakes():
    run = drive([(Velocity(-0.3, 0.0), {}), (Velocity(-0.3, 0.0), {"may_reverse": False})],
                np.empty((0, 2)), ticks=40)  # fmt: skip
    assert run[39][2].speed_mps == pytest.approx(-0.3)
    assert run[-1][2] == STILL


@given(requests, points_about())
@settings(max_examples=150, deadline=None)
def test_it_can_always_stop_before_anything_that_stands(wanted, points):
    """Carried on for the reaction time and braked along its arc, from each velocity chosen."""
    assume(len(points))
    for pose, _, chosen, _, _ in drive(wanted, points):
        speed, rate = chosen
        braking = max(abs(speed) / DRIVE.max_decel_mps2, abs(rate) / DRIVE.max_yaw_accel_radps2)
        lasts = MONITOR.reaction_s + 0.5 * braking
        near = seen_from(pose, points)
        now = gaps(np.zeros(3), near)
        steps = [at_arc(f * speed * lasts, f * rate * lasts) for f in np.linspace(0, 1, 25)]
        least = np.min([gaps(at, near) for at in steps], axis=0)
        assert (least > np.minimum(MONITOR.margin_m, now) - EATEN - 1e-6).all()
        assert (least > 0.0).all()


@given(requests, points_about(), movers_about())
@settings(max_examples=150, deadline=None)
def test_no_mover_meets_a_robot_that_moves(wanted, points, tracks):
    """Passive safety: each velocity is safe among what moves, or brakes as hard as it may."""
    limits = separation_of().limits
    for pose, last, chosen, _, now in drive(wanted, points, tracks):
        discs = mover_discs(now.movers, now.t_ns, SeparationConfig())
        brakes = abs(chosen.speed_mps) <= abs(last.speed_mps) + 1e-12
        brakes &= abs(chosen.yaw_rate_radps) <= abs(last.yaw_rate_radps) + 1e-12
        assert brakes or stays_clear(pose, *chosen, discs, limits)
        gap = min(gap_after(pose, 0.0, 0.0, 0.0, mover, HALF) for mover in discs)
        if gap <= 0.0:
            assert math.hypot(*chosen) < 0.05


def test_a_mover_that_turns_round_at_once_meets_a_robot_that_stands():
    """It goes away ahead of the robot, as fast as the robot drives; then it comes back."""
    far, pace = 0.3, 0.45
    gone = np.array([HALF[0] + 0.2 + far, 0.0])
    tracks = MoverTracks(
        0, np.zeros(1, int), gone[None], np.array([[pace, 0.0]]), np.array([0.2]),
        np.zeros(1), np.array([pace]),
    )  # fmt: skip
    limits, discs = separation_of().limits, mover_discs(tracks, 0, SeparationConfig())
    part = safe_part(np.zeros(3), 0.47, 0.0, discs, limits)
    assert 0.0 < part < 1.0
    speed = part * 0.47
    stands_s = limits[0] + speed / limits[1]
    way = speed * limits[0] + speed**2 / (2.0 * limits[1])
    assert far - way >= pace * stands_s


def test_it_evades_no_faster_than_it_may_drive():
    slow = replace(DRIVE, max_speed_mps=0.2)
    arbiter, last, fastest = arbiter_of(slow), STILL, 0.0
    for k in range(150):
        x = 1.6 - 0.4 * TICK_S * k
        tracks = MoverTracks(
            k * TICK_NS, np.zeros(1, int), np.array([[x, 0.0]]), np.array([[-0.4, 0.0]]),
            np.array([0.2]), np.zeros(1), np.array([0.4]),
        )  # fmt: skip
        now = situation(t_ns=k * TICK_NS, movers=tracks)
        last, _ = arbiter.choose(Velocity(0.47, 0.0), last, now)
        fastest = max(fastest, abs(last.speed_mps))
    assert 0.15 < fastest <= 0.2 + 1e-9


def test_where_it_may_not_reverse_it_stands_and_does_not_turn_instead():
    run = drive([(Velocity(-0.3, 0.7), {"may_reverse": False})], np.empty((0, 2)), ticks=30)
    assert all(chosen == STILL for _, _, chosen, _, _ in run)


@pytest.mark.parametrize(("trail", "free"), [((-1.0, 0.0), True), ((0.0, -1.0), False)])
def test_with_a_camera_it_goes_backwards_only_on_its_own_trail(trail, free):
    """The trail leads straight back, or aside."""
    points = np.linspace(0.0, 1.0, 21)[:, None] * np.array(trail)
    run = [(Velocity(-0.3, 0.0), {})]
    speeds = [c.speed_mps for _, _, c, _, _ in drive(run, np.empty((0, 2)), trail_m=points)]
    assert (min(speeds) < -0.1) == free
    arc = np.array([[0.3 * math.sin(a), 0.3 * (math.cos(a) - 1.0)] for a in np.arange(-2, 0, 0.1)])
    assert is_on_trail(arc, -0.3, 1.0)
    assert not is_on_trail(arc, -0.3, -1.0)
    assert not is_on_trail(np.empty((0, 2)), -0.3, 0.0)
    assert is_on_trail(None, -0.3, 0.0)


@given(asked)
@settings(max_examples=60, deadline=None)
def test_with_nothing_about_it_what_is_asked_is_reached(wanted):
    *_, (_, _, chosen, mode, _) = drive([(wanted, {})], np.empty((0, 2)), ticks=120)
    top = DRIVE.max_speed_mps
    assert chosen.speed_mps == pytest.approx(np.clip(wanted.speed_mps, -top, top))
    rate = np.clip(wanted.yaw_rate_radps, -DRIVE.max_yaw_rate_radps, DRIVE.max_yaw_rate_radps)
    assert chosen.yaw_rate_radps == pytest.approx(rate)
    assert mode is Mode.FOLLOW


def test_a_wall_ahead_is_approached_and_not_touched():
    wall = np.column_stack((np.full(81, 0.8), np.linspace(-0.4, 0.4, 81)))
    run = drive([(Velocity(0.47, 0.0), {})], wall, ticks=400)
    pose, _, chosen, mode, _ = run[-1]
    gap = gaps(pose, wall).min()
    assert 0.0 < gap < 0.05
    assert mode is Mode.HELD and abs(chosen.speed_mps) < 0.03
    speeds = [velocity.speed_mps for _, _, velocity, _, _ in run]
    assert max(speeds) > 0.4


def test_being_stuck_changes_the_choice_and_not_the_limits():
    wall = np.column_stack((np.full(81, HALF[0] + 0.013), np.linspace(-0.4, 0.4, 81)))
    ahead = drive([(Velocity(0.3, 0.0), {})], wall, ticks=100)
    assert np.hypot(*ahead[-1][0][:2]) < 0.01
    back = drive([(Velocity(0.3, 0.0), {"stuck": True})], wall, ticks=100)
    assert back[-1][0][0] < -0.05 and back[-1][3] is Mode.BACK_OFF
    nowhere = drive([(Velocity(0.3, 0.0), {"stuck": True, "may_reverse": False})], wall, ticks=100)
    assert all(velocity.speed_mps >= 0.0 for _, _, velocity, _, _ in nowhere)
