"""The evidence field: surfaces, free and unknown space, and the search in it."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import SlamConfig
from simloop.geometry.se2 import transform_points
from simloop.graph_slam.evidence import EvidenceField
from simloop.mapping.correlative import heading_step
from simloop.mapping.grid_map import GridMap

seeds = st.integers(0, 2**32 - 1)
CELL = SlamConfig().resolution_m
HERE = np.zeros(3)


def wall_seen(x=2.0, half=1.0, count=81):
    """A map of one scan: a wall across, at ``x``, with free space before it."""
    grid = GridMap(SlamConfig())
    y = np.linspace(-half, half, count)
    points = np.column_stack([np.full(count, x), y])
    for _ in range(2):
        grid.insert(points, np.zeros_like(points), HERE)
    return grid


def likelihood(field, x, y):
    """What one point at a place scores, by a search that may not move it."""
    pose = np.array([x, y, 0.0])
    _, score = field.search(np.zeros((1, 2)), pose, np.zeros(2), np.zeros(2), -0.5)
    return score


@pytest.mark.parametrize("unknown", [0.2, 0.6])
def test_surfaces_free_and_unknown_space_count_differently(unknown):
    field = EvidenceField(wall_seen(), unknown)
    assert likelihood(field, 2.0, 0.1) > 0.85
    assert likelihood(field, 1.0, 0.0) == 0.0  # the beams passed here
    assert likelihood(field, 2.12, 0.0) < 0.1  # behind the wall: nobody can have measured this
    for x, y in ((1.0, 3.0), (2.0, 1.6), (4.0, 0.0), (-30.0, 9.0), (50.0, -50.0)):
        assert likelihood(field, x, y) == pytest.approx(unknown, abs=0.003)


def test_the_known_points_alone_tell_how_well_a_scan_fits():
    field = EvidenceField(wall_seen(), 0.3)
    points = np.array([[2.0, 0.0], [2.0, 0.5], [1.0, 0.0], [2.0, 7.0]])
    mean, share = field.known(points, HERE)
    assert share == 0.75
    assert 0.55 < mean <= 2.0 / 3.0
    assert field.known(points + np.array([0.0, 20.0]), HERE) == (0.0, 0.0)


@given(seed=seeds)
@settings(max_examples=5, deadline=None)
def test_the_search_finds_what_trying_every_pose_finds(seed):
    rng = np.random.default_rng(seed)
    grid = GridMap(SlamConfig())
    for _ in range(3):
        points = rng.uniform(0.5, 2.0, (40, 2)) * rng.choice([-1.0, 1.0], (40, 2))
        grid.insert(points, np.zeros_like(points), rng.uniform(-0.3, 0.3, 3))
    field = EvidenceField(grid, 0.4)
    points = rng.uniform(-3.0, 3.0, (25, 2))  # some leave the grid
    prior, window = rng.uniform(-1.0, 1.0, 3), np.array([0.35, 0.06])
    weights = np.array([0.3, 0.5])
    _, score = field.search(points, prior, window, weights, -1.0)
    step, best = heading_step(points, CELL), -math.inf
    half, turns = math.ceil(window[0] / CELL), math.ceil(window[1] / step)
    some = range(-half, half + 1, 4)  # all of them, one point at a time, would take too long
    for turn, row, col in product(range(-turns, turns + 1), some, some):
        off = np.array([col * CELL, row * CELL, turn * step])
        placed = transform_points(prior + off, points)
        mean = np.mean([likelihood(field, x, y) for x, y in placed])
        best = max(best, mean - weights[0] * (off[:2] @ off[:2]) - weights[1] * off[2] ** 2)
    assert score >= best - 1e-9
    found = field.search(points, prior, window, weights, -1.0)[0]
    off = found - prior
    mean = np.mean([likelihood(field, x, y) for x, y in transform_points(found, points)])
    assert score == pytest.approx(
        mean - weights[0] * (off[:2] @ off[:2]) - weights[1] * off[2] ** 2, abs=1e-9
    )
