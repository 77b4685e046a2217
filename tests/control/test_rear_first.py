"""Rear first: where there is no room to turn, as long as there is none, and along the path."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.paths import smooth
from helpers.tracking import (
    DRIVE,
    ENCODER,
    MONITOR,
    VEHICLE,
    K,
    Slewed,
    at_pose,
    drive_of,
    estimate_of,
    monitor_of,
    tracker_to,
)
from helpers.vehicles import plant_on_plane
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.control.rear_first import rear_first
from simloop.geometry.se2 import about_face, wrap_angle
from simloop.loop import Simulation
from simloop.messages import TrackCommand
from simloop.scenario.load import load
from simloop.sensors import Encoders
from simloop.truth import Truth
from simloop.worlds.outline_gap import outline_corners

ORIGIN = np.zeros(3)
CORNER_M = math.hypot(VEHICLE.length_m, VEHICLE.width_m) / 2.0


def seeing(points):
    monitor = monitor_of()
    monitor.observe(np.array(points, float).reshape(-1, 2), ORIGIN)
    return monitor


def lane(half_width):
    x = np.linspace(-1.5, 1.5, 151)
    return [(a, s * half_width) for a in x for s in (-1.0, 1.0)]


NARROW, WIDE = lane(CORNER_M - 0.01), lane(CORNER_M + 0.05)
JUST = lane(CORNER_M + MONITOR.margin_m + 0.01)  # room to turn, and none to spare


@pytest.mark.parametrize("yaw", [0.0, 1.0, -1.5])
def test_what_does_not_lie_behind_is_gone_to_front_first(yaw):
    assert not rear_first(seeing(NARROW), ORIGIN, yaw, False)


@pytest.mark.parametrize("yaw", [math.pi, -2.0, 1.7])
def test_rear_first_only_where_the_corners_would_meet_something(yaw):
    assert rear_first(seeing(NARROW), ORIGIN, yaw, False)
    assert not rear_first(seeing(WIDE), ORIGIN, yaw, False)
    assert not rear_first(seeing([]), ORIGIN, yaw, False)


def test_who_goes_backwards_wants_some_room_more_before_turning():
    assert not rear_first(seeing(JUST), ORIGIN, math.pi, False)
    assert rear_first(seeing(JUST), ORIGIN, math.pi, True)
    assert not rear_first(seeing(WIDE), ORIGIN, math.pi, True)


def test_who_goes_backwards_does_so_round_a_bend():
    assert rear_first(seeing(NARROW), ORIGIN, 1.4, True)
    assert not rear_first(seeing(NARROW), ORIGIN, 1.4, False)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_a_turn_is_free_when_no_corner_meets_a_point_in_it(seed):
    rng = np.random.default_rng(seed)
    bearing, far = rng.uniform(-math.pi, math.pi), rng.uniform(0.28, 0.42)
    point = far * np.array([math.cos(bearing), math.sin(bearing)])
    turned, extra = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, 0.05)
    seen = point
    point = (1.0 - 0.04 / 3.0 / far) * seen  # a lone point may be that much nearer
    nearest = min(distance_to(point, a) for a in np.linspace(0.0, turned, 400))
    need = MONITOR.margin_m + extra
    if distance_to(point, 0.0) > need + 2e-3 and abs(nearest - need) > 2e-3:
        free = seeing([seen]).can_turn(turned, ORIGIN, extra)
        assert free == (nearest > need)


def distance_to(point, yaw):
    """m from a point (2,) to the footprint at the origin, turned by ``yaw``."""
    corners = outline_corners(np.array([[0.0, 0.0, yaw]]), VEHICLE)[0]
    edges = np.roll(corners, -1, axis=0) - corners
    shares = ((point - corners) * edges).sum(axis=1) / (edges**2).sum(axis=1)
    feet = corners + np.clip(shares, 0.0, 1.0)[:, None] * edges
    cross = edges[:, 0] * (point - corners)[:, 1] - edges[:, 1] * (point - corners)[:, 0]
    inside = (cross > 0.0).all() or (cross < 0.0).all()
    return 0.0 if inside else float(np.hypot(*(feet - point).T).min())


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-math.pi, math.pi))
def test_about_face_twice_is_as_before(x, y, yaw):
    there = about_face(about_face(np.array([x, y, yaw, 9.0])))
    assert there[:2] == pytest.approx((x, y))
    assert math.cos(there[2] - yaw) == pytest.approx(1.0)


def test_it_follows_a_bend_rear_first_within_centimetres():
    """The same path, driven by a robot that looks the other way; it ends facing backwards."""
    points, start = [(0, 0), (1.2, 0.0), (1.6, 1.0), (2.6, 1.2)], np.array([0, 0, math.pi])
    path, plant = smooth(points, about_face(start)), plant_on_plane()
    truth, tracker = plant.reset(start), tracker_to(points[-1])
    tracker.follow(path, K, reverses=True)
    slewed = Slewed(tracker)
    drive, encoders = drive_of(), Encoders(ENCODER)
    for _ in range(2000):
        estimate = estimate_of(truth)
        velocity, mode = slewed.velocity(estimate)
        assert velocity.speed_mps <= 0.0
        assert mode in ("follow", "arrived")
        truth = plant.step(drive.command(velocity, mode, estimate, encoders.read(truth)).voltage_v)
        assert np.hypot(*(path.xy_m - truth.pose_xyyaw[:2]).T).min() < 0.03
        if tracker.arrived and abs(truth.velocity_body[0]) < 1e-3:
            break
    assert tracker.arrived
    assert abs(wrap_angle(truth.pose_xyyaw[2] - path.yaw_rad[-1])) > 2.8


@pytest.mark.parametrize("aside", [0.03, -0.03])
def test_rear_first_the_law_is_that_of_a_robot_the_other_way_round(aside):
    path = smooth([(0, 0), (2.0, 0.0)], (0, 0, 0))
    front, rear = tracker_to((9, 9)), tracker_to((9, 9))
    front.follow(path, K)
    rear.follow(path, K, reverses=True)
    for k in range(20):
        ahead, _ = front.velocity(at_pose(0.02 * k, aside, 0.1))
        behind, _ = rear.velocity(at_pose(0.02 * k, aside, 0.1 + math.pi))
        assert behind[0] == pytest.approx(-ahead[0])
        assert behind[1] == pytest.approx(ahead[1])


def test_changing_ends_on_the_way_keeps_the_limits():
    tracker = tracker_to((9, 9))
    tracker.follow(smooth([(0, 0), (3.0, 0.0)], (0, 0, 0)), K, reverses=True)
    asked, slewed = [], Slewed(tracker)
    for k in range(150):
        tracker.reverses = k < 80
        asked.append(slewed.velocity(at_pose(0.5, 0.0, math.pi, 0.01 * k))[0])
    speed, rate = np.array(asked).T
    assert speed.min() < -0.3
    assert np.abs(np.diff(speed)).max() <= DRIVE.max_brake_mps2 * 0.01 + 1e-9
    assert speed[-1] == 0.0
    assert abs(rate[-1]) == pytest.approx(DRIVE.max_yaw_rate_radps)


def test_a_maze_with_a_dead_end_too_narrow_to_turn_in_is_left_rear_first():
    """Seed 26 looks into a lane of 0.8 m that ends: it once was stuck there for good."""
    backwards, touched = [], []

    def listen(message):
        if isinstance(message, TrackCommand) and message.mode == "follow":
            backwards.append(message.speed_mps < -0.1)
        if isinstance(message, Truth):
            touched.append(message.contact_count)

    result = Simulation(load("maze", seed=26), listeners=[listen]).run()
    assert result.reached
    assert sum(backwards) * 0.01 > 2.0
    assert not any(touched)
