"""The collision monitor: stops for what it sees, in time, and never traps the robot."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers.tracking import DRIVE, MONITOR, allowed, drive_of, monitor_of
from helpers.vehicles import plant_on_plane
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import EncoderConfig, VehicleConfig
from simloop.control.collision_monitor import average_along_surfaces
from simloop.ekf import GAUGE
from simloop.geometry.footprint import free_fraction, points_in, rectangle_distance
from simloop.messages import Estimate, Mode, Velocity
from simloop.sensors import Encoders
from simloop.worlds.outline_gap import outline_corners

HALF_LENGTH, HALF_WIDTH = 0.245, 0.2325
ORIGIN = np.zeros(3)


def monitor_seeing(*points):
    monitor = monitor_of()
    monitor.observe(np.array(points, float).reshape(-1, 2), ORIGIN)
    return monitor


def test_with_nothing_in_sight_all_is_allowed():
    assert allowed(monitor_seeing(), 0.45, 1.0, ORIGIN) == (0.45, 1.0)
    assert allowed(monitor_seeing((3.0, 0.0)), 0.45, 1.0, ORIGIN) == (0.45, 1.0)


def test_it_slows_before_an_obstacle_and_stops_at_it():
    speeds = [
        allowed(monitor_seeing((HALF_LENGTH + gap, 0.0)), 0.45, 0.0, ORIGIN)[0]
        for gap in (0.5, 0.15, 0.08, 0.03, 0.011)
    ]
    assert speeds[0] == 0.45
    assert all(a >= b for a, b in pairwise(speeds))
    assert speeds[-1] == 0.0


@given(st.floats(0.05, 0.45), st.floats(0.02, 0.6))
@settings(max_examples=80)
def test_the_allowed_speed_can_be_braked_away_before_the_obstacle(asked, gap):
    speed, _ = allowed(monitor_seeing((HALF_LENGTH + gap, 0.0)), asked, 0.0, ORIGIN)
    assert speed * 0.01 + speed**2 / (2 * DRIVE.max_decel_mps2) <= gap + 1e-9


@given(st.floats(0.05, 0.45), st.floats(0.02, 0.2))
@settings(max_examples=80)
def test_the_allowed_speed_leaves_time_to_react_before_braking(asked, gap):
    speed, _ = allowed(monitor_seeing((HALF_LENGTH + gap, 0.0)), asked, 0.0, ORIGIN)
    way = speed * MONITOR.reaction_s + speed**2 / (2 * DRIVE.max_decel_mps2)
    assert way <= gap - MONITOR.margin_m + 1e-3


def test_what_was_seen_in_the_last_scans_stays_where_it_was_seen():
    """A post seen once, then in the blind zone: the robot has come nearer, and the post with it."""
    monitor = monitor_seeing((0.6, 0.0))
    pose = np.array([0.3, 0.0, 0.0])
    monitor.observe(np.array([[0.0, 3.0]]), pose)
    assert pytest.approx(0.055) == 0.6 - 0.3 - HALF_LENGTH
    assert allowed(monitor, 0.45, 0.0, pose)[0] < 0.25
    turned = np.array([0.0, 0.0, 0.5 * math.pi])
    monitor.observe(np.array([[0.0, 3.0]]), turned)  # now it is to the right
    assert allowed(monitor, 0.45, 0.0, turned)[0] == 0.45


def test_what_is_beside_the_robot_hinders_turning_and_not_driving():
    monitor = monitor_seeing((HALF_LENGTH - 0.01, HALF_WIDTH + 0.02))
    assert allowed(monitor, -0.12, 0.0, ORIGIN)[0] == -0.12
    assert abs(allowed(monitor, 0.0, 1.0, ORIGIN)[1]) < 1.0


def test_the_way_back_from_an_obstacle_is_free():
    monitor = monitor_seeing((HALF_LENGTH + 0.002, 0.0))
    assert allowed(monitor, 0.3, 0.0, ORIGIN)[0] == 0.0
    assert allowed(monitor, -0.12, 0.0, ORIGIN)[0] == -0.12


def test_points_move_with_the_robot_between_scans():
    monitor = monitor_seeing((HALF_LENGTH + 0.4, 0.0))
    assert allowed(monitor, 0.45, 0.0, ORIGIN)[0] == 0.45
    assert allowed(monitor, 0.45, 0.0, np.array([0.38, 0.0, 0.0]))[0] < 0.2


@given(*[st.floats(-3, 3)] * 6)
@settings(max_examples=60)
def test_points_in_another_frame(px, py, pyaw, sx, sy, syaw):
    points = np.array([[0.3, -0.2], [1.0, 2.0]])
    got = points_in(np.array([px, py, pyaw]), np.array([sx, sy, syaw]), points)

    def world(pose, p):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        return p @ np.array([[c, s], [-s, c]]) + pose[:2]

    np.testing.assert_allclose(
        world(np.array([px, py, pyaw]), got), world(np.array([sx, sy, syaw]), points), atol=1e-9
    )


@given(st.floats(-1, 1), st.floats(-1, 1))
@settings(max_examples=100)
def test_rectangle_distance_against_samples_of_its_edge(x, y):
    t = np.linspace(-1, 1, 801)
    edge = np.concatenate(
        [np.column_stack((HALF_LENGTH * t, np.full(801, s * HALF_WIDTH))) for s in (-1, 1)]
        + [np.column_stack((np.full(801, s * HALF_LENGTH), HALF_WIDTH * t)) for s in (-1, 1)]
    )
    sampled = np.hypot(*(edge - (x, y)).T).min()
    signed = rectangle_distance(x, y, HALF_LENGTH, HALF_WIDTH)
    inside = abs(x) < HALF_LENGTH and abs(y) < HALF_WIDTH
    assert signed == pytest.approx(-sampled if inside else sampled, abs=1e-3)


def test_an_arc_sweeps_the_rectangle_along_it():
    corner = np.array([[0.40, HALF_WIDTH + 0.05]])
    straight = free_fraction(corner, 0.6, 0.0, HALF_LENGTH, HALF_WIDTH, 0.01)
    curved = free_fraction(corner, 0.6, 1.5, HALF_LENGTH, HALF_WIDTH, 0.01)
    assert straight == 1.0
    assert 0.0 < curved < 1.0


def test_noise_beside_a_wall_does_not_stop_a_robot_that_can_pass_it():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(50):
        monitor = monitor_of()
        for _ in range(3):
            bearing = np.radians(np.arange(20.0, 160.0))
            ranges = (HALF_WIDTH + 0.0275) / np.sin(bearing) + rng.normal(0.0, 0.01, 140)
            rays = np.column_stack((np.cos(bearing), np.sin(bearing)))
            monitor.observe(ranges[:, None] * rays, ORIGIN)
        held += allowed(monitor, 0.45, 0.0, ORIGIN)[0] < 0.45
    assert held <= 2


def test_steadied_points_stay_on_their_surface_and_lone_ones_stay_put():
    bearing = np.linspace(-1.0, 1.0, 81)
    wall = np.column_stack((np.full(81, 0.4), 0.4 * np.tan(bearing)))
    np.testing.assert_allclose(average_along_surfaces(wall, 4, 0.05)[:, 0], 0.4, atol=1e-12)
    post = wall.copy()
    post[40] = (0.2, 0.0)
    np.testing.assert_array_equal(average_along_surfaces(post, 4, 0.05)[40], post[40])


def test_few_points_count_as_nearer_and_a_surface_does_not():
    bearing = np.linspace(-1.0, 1.0, 81)
    wall = np.column_stack((np.full(81, 0.4), 0.4 * np.tan(bearing)))
    wall[40] = (0.2, 0.0)
    sure, unsure = (average_along_surfaces(wall, 4, 0.05, m) for m in (0.0, 0.02))
    np.testing.assert_array_equal(unsure[30], sure[30])
    assert unsure[40, 0] == pytest.approx(0.2 - 0.02 * (1.0 - 1.0 / 3.0))
    assert np.all(np.hypot(*unsure.T) <= np.hypot(*sure.T))


def test_a_robot_beside_a_sharp_corner_does_not_creep_on_with_the_noise():
    """A tip just inside the margin, of which three points are seen from one place, 500 times."""
    rng, tip, crept = np.random.default_rng(0), np.array([0.2485, -0.229]), 0
    monitor = monitor_of()
    for _ in range(500):
        noise = rng.normal(0.0, 0.01) / np.hypot(*tip)
        monitor.observe((1.0 + noise) * tip[None, :], ORIGIN)
        crept += allowed(monitor, 0.05, 0.0, ORIGIN)[0] > 0.0
    assert crept <= 5


@pytest.mark.parametrize("angle", [0.0, 0.5, -0.9])
def test_a_wall_put_in_front_at_full_speed_is_not_touched(angle):
    """From full speed in the plant, noisy scans each 0.1 s, no plan that knows of the wall."""
    plant, config = plant_on_plane(), DRIVE
    truth, rng = plant.reset(np.zeros(3)), np.random.default_rng(1)
    monitor, drive = monitor_of(), drive_of()
    encoders, along = Encoders(EncoderConfig()), np.linspace(-1.5, 1.5, 400)
    normal = np.array([np.cos(angle), np.sin(angle)])
    tangent = np.array([-np.sin(angle), np.cos(angle)])
    fastest, command = 0.0, (0.0, 0.0)
    for tick in range(500):
        pose = truth.pose_xyyaw
        if tick % 10 == 0 and tick >= 150:  # the wall appears 0.75 m before the robot
            if tick == 150:
                wall = pose[:2] + 0.75 * normal + along[:, None] * tangent
            cos, sin = np.cos(pose[2]), np.sin(pose[2])
            seen = (wall - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])
            monitor.observe(seen + rng.normal(0.0, 0.007, seen.shape), pose)
        asked = min(command[0] + 0.008, config.max_speed_mps)
        command = allowed(monitor, asked, 0.0, pose)
        state = np.zeros(7)
        state[GAUGE] = 1.23
        estimate = Estimate(truth.t_ns, state, np.eye(7))
        sent = drive.command(Velocity(*command), Mode.FOLLOW, estimate, encoders.read(truth))
        truth = plant.step(sent.voltage_v)
        fastest = max(fastest, truth.velocity_body[0])
    corners = outline_corners(truth.pose_xyyaw[None], VehicleConfig())[0]
    gap = ((wall[0] - corners) @ normal).min()
    assert fastest > 0.95 * config.max_speed_mps
    assert abs(truth.velocity_body[0]) < 0.01
    assert 0.0 < gap < 0.06


def test_it_drives_no_faster_than_it_can_stop_within_its_range():
    def cap(range_m):
        monitor = monitor_of()
        monitor.observe(np.empty((0, 2)), ORIGIN, None, range_m)
        return monitor.speed_cap_mps

    assert monitor_of().speed_cap_mps == np.inf and cap(12.0) > 0.47
    assert cap(0.3) == 0.0  # it does not see beyond its own corners
    reaction, brake, _, half_length, half_width, margin = monitor_of().limits
    for range_m in (0.4, 0.5, 0.7):
        way = cap(range_m) * reaction + cap(range_m) ** 2 / (2.0 * brake)
        assert way == pytest.approx(range_m - np.hypot(half_length, half_width) - margin)
