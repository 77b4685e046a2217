"""From its present speed the robot stops before whatever it has seen: by properties.

Oracles are plain: the arc is walked in half millimetres among the points themselves, and a robot
of mere kinematics is sent blindly about rooms that it sees by rays.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.stopping import (
    HALF,
    at_arc,
    box,
    drive_blindly,
    gaps,
    in_frame,
    samples,
)
from helpers.tracking import DRIVE, MONITOR, allowed, monitor_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simloop.control.collision_monitor import stoppable_part
from simloop.geometry.footprint import free_fraction, points_in
from simloop.loop import Simulation
from simloop.messages import LidarScan
from simloop.scenario.load import load
from simloop.truth import Truth

LIMITS = np.array(
    [
        MONITOR.reaction_s,
        DRIVE.max_decel_mps2,
        DRIVE.max_yaw_accel_radps2,
        *HALF,
        MONITOR.margin_m,
    ]
)
MARGIN = MONITOR.margin_m
ORIGIN = np.zeros(3)
EATEN = 0.009  # of the margin, by what lies between two steps along an arc

speeds, rates = st.floats(-0.45, 0.45), st.floats(-1.6, 1.6)
poses = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.1, 3.1)).map(np.array)


@st.composite
def points_about(draw, nearest=0.001, most=6):
    """(n, 2) points outside the footprint, many of them close to its edges and corners."""
    points = []
    for _ in range(draw(st.integers(1, most))):
        gap = draw(st.one_of(st.floats(nearest, nearest + 0.03), st.floats(nearest, 0.5)))
        along, across = draw(st.sampled_from([(0, 1), (1, 0)]))
        point = np.empty(2)
        point[along] = draw(st.sampled_from([-1.0, 1.0])) * (HALF[along] + gap)
        point[across] = draw(st.floats(-1.2, 1.2)) * HALF[across]
        points.append(point)
    return np.array(points)


def stopping_arc(speed, rate, part):
    """Way, m, and turn, rad, of a part of a velocity: the reaction time, then braking."""
    braking = max(abs(speed) / DRIVE.max_decel_mps2, abs(rate) / DRIVE.max_yaw_accel_radps2)
    lasts = part * MONITOR.reaction_s + 0.5 * part**2 * braking
    return speed * lasts, rate * lasts


def least_gaps(points, ahead, turned):
    """(n,) least signed distances, m, of the points on the way along an arc, both ends included."""
    steps = 2 + math.ceil(max(abs(ahead) / 5e-4, abs(turned) / 1e-3))
    parts = np.linspace(0.0, 1.0, steps)
    return np.min([gaps(at_arc(f * ahead, f * turned), points) for f in parts], axis=0)


@given(points_about(), speeds, rates)
@settings(max_examples=400, deadline=None)
def test_what_is_allowed_can_be_stopped_before_every_point(points, speed, rate):
    part = stoppable_part(points, speed, rate, LIMITS)
    assert 0.0 <= part <= 1.0
    least, now = least_gaps(points, *stopping_arc(speed, rate, part)), gaps(ORIGIN, points)
    outside = now >= MARGIN
    assert (least[outside] > MARGIN - EATEN).all()
    # What is within the margin already never comes nearer, and so is never touched.
    assert (least[~outside] > now[~outside] - 1e-5).all()
    assert (least > 0.0).all()


@given(points_about(nearest=0.02), speeds, rates, poses, poses)
@settings(max_examples=200, deadline=None)
def test_it_holds_wherever_the_robot_has_come_since_the_scan(points, speed, rate, pose, seen_from):
    """points lie about the robot where it is now; they were seen from elsewhere."""
    in_map = points_in_map(points, pose)
    part = stoppable_part(
        points_in(pose, seen_from, in_frame(seen_from, in_map)), speed, rate, LIMITS
    )
    again = stoppable_part(points, speed, rate, LIMITS)
    least = least_gaps(points, *stopping_arc(speed, rate, part))
    assert (least > MARGIN - EATEN).all()
    assert part == pytest.approx(again, abs=0.02) or min(part, again) == 0.0


def points_in_map(points, pose):
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


@given(points_about(nearest=0.02), speeds, rates, st.floats(0, 0.003), st.floats(-3.1, 3.1))
@settings(max_examples=200, deadline=None)
def test_a_pose_that_has_drifted_by_less_than_the_margin_touches_nothing(
    points, speed, rate, drift, towards
):
    """The robot stands ``drift`` m off from where it takes itself to stand."""
    off = drift * np.array([math.cos(towards), math.sin(towards)])
    believed = np.array([*off, 0.0])
    part = stoppable_part(points_in(believed, ORIGIN, points), speed, rate, LIMITS)
    assert (least_gaps(points, *stopping_arc(speed, rate, part)) > 0.0).all()


@given(points_about(), points_about(), speeds, rates)
@settings(max_examples=200, deadline=None)
def test_more_in_sight_never_allows_more(some, more, speed, rate):
    both = np.concatenate([some, more])
    alone = stoppable_part(some, speed, rate, LIMITS)
    assert stoppable_part(both, speed, rate, LIMITS) <= alone + 1e-12


@given(st.floats(0.013, 0.6), st.floats(0.0, 0.5), st.floats(0.05, 0.45))
@settings(max_examples=200, deadline=None)
def test_further_off_never_allows_less_straight_ahead(gap, further, speed):
    def allowed(gap_m):
        point = np.array([[HALF[0] + gap_m, 0.0]])
        return stoppable_part(point, speed, 0.0, LIMITS)

    # A step's halving tells 1/16 of a step: a millimetre and a bit.
    assert allowed(gap + further) >= allowed(gap) - 0.02 or allowed(gap + further) == 0.0
    assert allowed(gap + 0.6) == 1.0


@given(points_about(), speeds, rates, st.floats(0.1, 1.0))
@settings(max_examples=200, deadline=None)
def test_asking_for_less_gives_no_more_and_asking_for_what_was_allowed_gives_that(
    points, speed, rate, share
):
    part = stoppable_part(points, speed, rate, LIMITS)
    less = stoppable_part(points, share * speed, share * rate, LIMITS)
    assert share * less <= max(share, part) + 0.06
    if 0.3 < part < 1.0:  # below, a tenth of what is asked for is taken for nothing
        again = stoppable_part(points, part * speed, part * rate, LIMITS)
        assert again > 0.85


@given(points_about(nearest=0.043), st.floats(-0.3, 0.3), st.floats(-1, 1), st.floats(0, 0.03))
@settings(max_examples=200, deadline=None)
def test_a_wider_margin_never_frees_more_of_an_arc(points, ahead, turned, wider):
    narrow = free_fraction(points, ahead, turned, *HALF, MARGIN)
    assert free_fraction(points, ahead, turned, *HALF, MARGIN + wider) <= narrow + 1e-12


def test_a_corner_does_not_pass_a_point_within_the_margin_between_two_steps():
    """A point 2.6 mm from a side and just inside the circle of the corners, and a turn over it."""
    radius = float(np.hypot(*HALF)) - 0.003
    bearing = math.atan2(HALF[1], HALF[0])
    hit = 0
    for off in np.linspace(0.005, 0.04, 36):
        point = radius * np.array([[math.cos(bearing + off), math.sin(bearing + off)]])
        if not 0.0 < gaps(ORIGIN, point)[0] < MARGIN:
            continue
        part = stoppable_part(point, 0.0, 1.0, LIMITS)
        assert least_gaps(point, *stopping_arc(0.0, 1.0, part))[0] > 0.0
        hit += least_gaps(point, 0.0, 0.1)[0] < 0.0
    assert hit > 10


def monitor_seeing(points):
    monitor = monitor_of()
    monitor.observe(points, ORIGIN)
    return monitor


@given(points_about(), speeds, rates)
@settings(max_examples=50, deadline=None)
def test_told_to_forget_it_is_blind_and_sees_again_with_the_next_scan(points, speed, rate):
    monitor = monitor_seeing(points)
    before = allowed(monitor, speed, rate, ORIGIN)
    monitor.forget()
    assert allowed(monitor, speed, rate, ORIGIN) == (speed, rate)
    monitor.observe(points, ORIGIN)
    assert allowed(monitor, speed, rate, ORIGIN) == pytest.approx(before)


@given(points_about(), speeds, rates)
@settings(max_examples=100, deadline=None)
def test_a_velocity_is_scaled_as_a_whole_and_its_arc_is_kept(points, speed, rate):
    v, w = allowed(monitor_seeing(points), speed, rate, ORIGIN)
    assert v * rate == pytest.approx(w * speed, abs=1e-9)
    assert abs(v) <= abs(speed) and abs(w) <= abs(rate)
    assert v * speed >= 0.0 and w * rate >= 0.0


def test_what_lies_beyond_its_notice_could_not_be_met_before_the_next_scans():
    """For any speed and brakes, and with three scans that do not come."""
    for top, decel in ((0.45, 0.6), (1.5, 6.0), (1.5, 0.3), (0.2, 6.0)):
        drive = replace(DRIVE, max_speed_mps=top, max_decel_mps2=decel, max_brake_mps2=12.0)
        monitor = monitor_of(drive=drive)
        way = top * (0.4 + MONITOR.reaction_s + 0.5 * top / decel)
        monitor.observe(np.array([[HALF[0] + MARGIN + way - 1e-6, 0.0]]), ORIGIN)
        come = np.array([top * 0.4 + 1e-3, 0.0, 0.0])
        assert allowed(monitor, top, 0.0, come)[0] < top, (top, decel)


boxes = st.tuples(
    st.floats(-math.pi, math.pi),
    st.floats(0.45, 1.5),
    st.floats(0.0, 3.0),
    st.sampled_from([0.03, 0.2, 0.6]),
    st.sampled_from([0.03, 0.2, 0.6]),
)


@given(
    st.lists(boxes, min_size=1, max_size=4),
    speeds,
    rates,
    st.sampled_from([0.0, 0.01]),
    st.integers(0, 100),
)
@settings(max_examples=25, deadline=None)
def test_sent_blindly_about_a_room_it_touches_nothing(room, speed, rate, noise_m, seed):
    """Rays, noise, a command that comes late, and brakes no better than they are taken to be."""
    segments = np.concatenate(
        [box(r * math.cos(a), r * math.sin(a), yaw, *size) for a, r, yaw, *size in room]
    )
    assume(gaps(ORIGIN, samples(segments)).min() > 0.03)
    least, _ = drive_blindly(segments, speed, rate, noise_m=noise_m, seed=seed)
    assert least > 0.0


def test_the_blind_drive_would_hit_without_a_monitor():
    """What the test above asserts can fail."""
    wall = box(1.0, 0.0, 0.0, 0.2, 2.0)
    least, moves = drive_blindly(wall, 0.45, 0.0)
    assert 0.0 < least < 0.05 and abs(moves[0]) < 0.02
    blind = drive_blindly(wall, 0.45, 0.0, allow=lambda _, speed, rate, __: (speed, rate))
    assert blind[0] < 0.0


def test_a_scan_that_comes_late_is_placed_where_it_was_taken():
    """0.2 s at 0.45 m/s are nine centimetres, by which all ahead would seem further off."""
    fault = '{kind="lidar_late", at_s=2.0, delay_s=0.2}'
    simulation = Simulation(load("faults", [f"faults=[{fault}]", "time_limit_s=6.0"], seed=1))
    truths, off, moved = {}, [], []

    def hear(message):
        if isinstance(message, Truth):
            truths[message.t_ns] = message.pose_xyyaw
        elif isinstance(message, LidarScan):
            seen_from = simulation.robot._monitor._pose
            off.append(math.dist(seen_from[:2], truths[message.t_ns][:2]))
            moved.append(math.dist(truths[max(truths)][:2], truths[message.t_ns][:2]))

    simulation._listeners.append(hear)
    simulation.run()
    assert max(moved) > 0.08
    assert max(off) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_in_two_hundred_drawn_rooms_it_keeps_some_millimetres(noise_m):
    """The figures of docs/safety.md: boxes, bars and posts about the robot, any velocity."""
    rng, least = np.random.default_rng(5), []
    for seed in range(250):
        room = []
        for _ in range(rng.integers(1, 5)):
            angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(0.5, 1.6)
            at = (away * math.cos(angle), away * math.sin(angle))
            room.append(box(*at, rng.uniform(0, 3), *rng.choice([0.04, 0.2, 0.6], 2)))
        segments = np.concatenate(room)
        if gaps(ORIGIN, samples(segments)).min() < 0.03:
            continue
        speed, rate = rng.uniform(-0.45, 0.45), rng.choice([0.0, rng.uniform(-1.6, 1.6)])
        least.append(drive_blindly(segments, speed, rate, noise_m=noise_m, seed=seed)[0])
    assert len(least) > 200
    assert min(least) > 0.003
