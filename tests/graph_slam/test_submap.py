"""How far a scan agrees with a map, and how scans are joined to one."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simloop.geometry.se2 import transform_points
from simloop.graph_slam.closures import cluster_of
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import Submap, meetings

seeds = st.integers(0, 2**32 - 1)
CONFIG = MappingConfig()


def ring(count=240, radius=2.0):
    """Hits all round on a circle, as seen from its middle."""
    angle = np.linspace(-math.pi, math.pi, count, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def submap_of(scans=3) -> Submap:
    """A submap with the ring in it, seen several times from its middle."""
    submap, points = Submap(CONFIG.grid, 7, np.zeros(3)), ring()
    for k in range(scans):
        submap.add(7 + k, points, np.zeros_like(points), np.zeros(3))
    return submap


def plain_meetings(grid, points, pose):
    """The slow, obvious version of ``meetings``."""
    rows, cols = grid.log_odds.shape
    met = free = 0
    for x, y in transform_points(pose, points):
        col = math.floor((x - grid.origin_m[0]) / grid.resolution_m)
        row = math.floor((y - grid.origin_m[1]) / grid.resolution_m)
        if 0 < row < rows - 1 and 0 < col < cols - 1:
            if grid.occupied[row - 1 : row + 2, col - 1 : col + 2].any():
                met += 1
            elif grid.log_odds[row, col] < -0.3:
                free += 1
    return met / max(1, met + free), (met + free) / max(1, len(points))


GRID = submap_of().grid


@given(seeds, st.integers(0, 80))
def test_agreement_is_that_of_the_plain_twin(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3.0, 3.0, (count, 2))
    pose = rng.uniform([-1, -1, -math.pi], [1, 1, math.pi])
    assert meetings(GRID, points, pose) == plain_meetings(GRID, points, pose)


def test_a_scan_agrees_where_it_was_taken_and_not_elsewhere():
    agreement, known = meetings(GRID, ring(), np.zeros(3))
    assert agreement == 1.0 and known == 1.0
    agreement, _ = meetings(GRID, ring(), np.array([0.5, 0.0, 0.0]))
    assert agreement < 0.7
    _, known = meetings(GRID, ring(), np.array([50.0, 0.0, 0.0]))
    assert known == 0.0


def test_a_submap_knows_its_keyframes():
    submap = submap_of(3)
    assert submap.keyframes == [7, 8, 9]
    assert submap.anchor == 7 and not submap.finished
    submap.finish()
    assert submap.finished


@given(seeds, st.integers(1, 5))
def test_scans_of_one_wall_joined_lie_on_that_wall(seed, count):
    """The wall y = 1, seen from several poses, lies in one line in base_link at the last pose."""
    rng = np.random.default_rng(seed)
    wall = np.stack([np.linspace(-2, 2, 50), np.ones(50)], axis=1)
    poses = [rng.uniform([-1, -0.5, -3], [1, 0.5, 3]) for _ in range(count)]
    scans = []
    for x, y, yaw in poses:
        cos, sin = math.cos(yaw), math.sin(yaw)
        scans.append((wall - [x, y]) @ np.array([[cos, -sin], [sin, cos]]))
    joined = cluster_of(scans, poses, 400)
    np.testing.assert_allclose(transform_points(poses[-1], joined)[:, 1], 1.0, atol=1e-9)
    assert 20 <= len(joined) <= 50 * count


def test_a_forgotten_grid_is_made_again_to_the_bit():
    rng = np.random.default_rng(0)
    submap = Submap(MappingConfig().grid, 0, np.zeros(3))
    for k in range(4):
        points = rng.uniform(-4.0, 4.0, (200, 2))
        submap.add(k, points, np.zeros_like(points), 0.1 * rng.standard_normal(3))
    before = submap.grid
    submap.forget_grid()
    assert submap.grid is before  # it is not finished
    submap.finish()
    submap.forget_grid()
    assert submap.grid is not before
    assert np.array_equal(submap.grid.log_odds, before.log_odds)
    assert np.array_equal(submap.grid.hits, before.hits)
    points = rng.uniform(-3.0, 3.0, (50, 2))
    window, weights = np.array([0.5, 0.2]), np.array([0.1, 0.1])
    found = [grid.search(points, np.zeros(3), window, weights) for grid in (before, submap.grid)]
    assert found[0][1] == found[1][1]
