"""The velocity arbiter's limits, by properties: whatever is asked, seen or moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.stopping import at_arc, gaps
from helpers.tracking import DRIVE, MONITOR, arbiter_of, separation_of, situation
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simloop.config import SeparationConfig
from simloop.control.arbiter import STILL
from simloop.control.separation import gap_after, mover_discs
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


def drive(requests, points, tracks=None, ticks=15, **others):
    """Poses, velocities and modes of a robot that is asked for one velocity after another."""
    arbiter, pose, last = arbiter_of(), np.zeros(3), STILL
    out = []
    for k, (request, more) in enumerate(requests):
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


@given(requests, points_about(), st.none() | movers_about())
@settings(max_examples=150, deadline=None)
def test_every_period_keeps_the_limits_of_acceleration_in_every_mode(wanted, points, tracks):
    for _, last, chosen, _, _ in drive(wanted, points, tracks):
        faster = abs(chosen.speed_mps) > abs(last.speed_mps)
        most = (DRIVE.max_accel_mps2 if faster else DRIVE.max_brake_mps2) * TICK_S
        assert abs(chosen.speed_mps - last.speed_mps) <= most + 1e-9
        change = abs(chosen.yaw_rate_radps - last.yaw_rate_radps)
        assert change <= DRIVE.max_yaw_accel_radps2 * TICK_S + 1e-9
        assert abs(chosen.yaw_rate_radps) <= DRIVE.max_yaw_rate_radps + 1e-9
        assert abs(chosen.speed_mps) <= max(0.6, abs(last.speed_mps)) + 1e-9


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


@given(requests, st.sampled_from([0.05, 0.15]))
@settings(max_examples=60, deadline=None)
def test_a_cap_holds_once_the_robot_has_slowed_down_to_it(wanted, cap):
    wanted = [(request, {**more, "speed_cap_mps": cap}) for request, more in wanted]
    for _, _, chosen, _, _ in drive(wanted, np.empty((0, 2))):
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


@given(requests, movers_about())
@settings(max_examples=100, deadline=None)
def test_no_mover_that_goes_on_as_it_goes_meets_a_robot_that_moves(wanted, tracks):
    """Passive safety: what comes within reach finds the robot standing, or braking to a stand."""
    wanted = [(request, {**more, "stuck": False}) for request, more in wanted]
    for pose, _, chosen, _, now in drive(wanted, np.empty((0, 2)), tracks):
        discs = mover_discs(now.movers, now.t_ns, SeparationConfig())
        gap = min(gap_after(pose, 0.0, 0.0, 0.0, mover, HALF) for mover in discs)
        if gap <= 0.0:
            assert math.hypot(*chosen) < 0.05


@given(asked)
@settings(max_examples=60, deadline=None)
def test_with_nothing_about_it_what_is_asked_is_reached(wanted):
    *_, (_, _, chosen, mode, _) = drive([(wanted, {})], np.empty((0, 2)), ticks=120)
    assert chosen.speed_mps == pytest.approx(wanted.speed_mps)
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
