"""Gaps between hits on one surface are filled, and no others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.rooms import Room

from simloop.graph_slam.densify import densified

SPACING = 0.05


def one_degree(room, pose, least=-90, most=90):
    angles = np.radians(np.arange(least, most + 1))
    ranges = np.full(len(angles), np.inf)
    for k, angle in enumerate(angles):
        far = room.ranges(np.array([*pose[:2], pose[2] + angle + math.pi]), 30.0)
        ranges[k] = far[0]  # the helper's first beam looks along -pi
    seen = np.isfinite(ranges)
    points = ranges[seen, None] * np.column_stack([np.cos(angles[seen]), np.sin(angles[seen])])
    return points, np.zeros_like(points)


def longest_gap(x, low, high):
    inside = np.sort(x[(x >= low) & (x <= high)])
    return np.diff(np.concatenate([[low], inside, [high]])).max()


def test_a_wall_seen_by_coarse_beams_has_no_gaps():
    points, origins = one_degree(Room((-20, 1.5, 20, 1.5)), np.zeros(3), 0, 180)
    assert longest_gap(points[:, 0], -6.0, 6.0) > 0.3  # the laser's own
    more, starts = densified(points, origins, SPACING)
    assert longest_gap(more[:, 0], -6.0, 6.0) <= 1.01 * SPACING
    assert np.abs(more[:, 1] - 1.5).max() < 1e-9
    assert np.array_equal(more[: len(points)], points)
    assert starts.shape == more.shape
    assert not starts.any()


@pytest.mark.parametrize("width", [0.6, 1.0])
def test_a_doorway_stays_open(width):
    """Behind it is another wall, so the beams through it end elsewhere."""
    half = 0.5 * width
    room = Room((-9, 2, -half, 2), (half, 2, 9, 2), (-9, 4, 9, 4))
    points, origins = one_degree(room, np.zeros(3), 0, 180)
    more, _ = densified(points, origins, SPACING)
    added = more[len(points) :]
    inside = (np.abs(added[:, 0]) < half - 0.05) & (added[:, 1] < 3.5)
    assert not inside.any()


def test_beams_without_an_echo_leave_a_gap():
    room = Room((-9, 2, -0.5, 2), (0.5, 2, 9, 2))  # nothing behind the doorway
    points, origins = one_degree(room, np.zeros(3), 0, 180)
    more, _ = densified(points, origins, SPACING)
    assert not (np.abs(more[:, 0]) < 0.45).any()


def test_two_posts_are_not_joined():
    points = np.array([[3.0, -0.6], [3.0, -0.55], [3.0, 0.55], [3.0, 0.6]])
    more, _ = densified(points, np.zeros_like(points), SPACING)
    assert not (np.abs(more[:, 1]) < 0.5).any()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_few_points_stay_as_they_are(count):
    points = np.column_stack([np.full(count, 2.0), 0.1 * np.arange(count)])
    more, _ = densified(points, np.zeros_like(points), SPACING)
    assert np.array_equal(more, points)
