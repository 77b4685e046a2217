"""Obstacles as discs, distances of cells, the place of a scan."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from simloop.geometry.discs import discs_of
from simloop.geometry.se2 import compose, inverse, transform_points
from simloop.mapping.grid_kernels import surface_distance
from simloop.mapping.scan_match import deskew

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds)
@settings(max_examples=40)
def test_discs_cover_every_corner_of_what_is_occupied_and_little_else(seed):
    rng = np.random.default_rng(seed)
    blobs = ndimage.gaussian_filter(rng.normal(size=(45, 70)), rng.uniform(0.5, 2.5))
    occupied = blobs > np.quantile(blobs, rng.uniform(0.7, 0.99))
    origin, cell = rng.uniform(-3, 3, 2), 0.05
    discs = discs_of(occupied, origin, cell)
    rows, cols = np.nonzero(occupied)
    for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):
        places = origin + cell * (np.column_stack([cols, rows]) + corner)
        apart = np.hypot(*(places[:, None] - discs[:, :2]).transpose(2, 0, 1)) - discs[:, 2]
        assert apart.min(axis=1).max() < 1e-4
    # None is larger than the circle about a tile of half a metre, nor stands about nothing.
    assert discs[:, 2].max() <= 0.5 * math.sqrt(0.5) + 1e-3
    centres = origin + cell * (np.column_stack([cols, rows]) + 0.5)
    for x, y, r in discs:
        inside = np.hypot(*(centres - [x, y]).T) < r
        assert inside.any()
    _, components = ndimage.label(occupied, np.ones((3, 3)))
    assert len(discs) >= components


def test_a_lone_cell_and_a_long_wall_as_discs():
    occupied = np.zeros((40, 60), bool)
    occupied[7, 30] = True
    disc = discs_of(occupied, np.array([1.0, -2.0]), 0.05)
    centre, radius = [1.0 + 30.5 * 0.05, -2.0 + 7.5 * 0.05], 0.05 * math.sqrt(0.5)
    np.testing.assert_allclose(disc, [[*centre, radius]], atol=1e-4)
    occupied[7, 30] = False
    occupied[20, 5:45] = True  # two metres: four tiles of half a metre, and one for the odd start
    assert len(discs_of(occupied, np.zeros(2), 0.05)) == 5
    assert discs_of(np.zeros((4, 4), bool), np.zeros(2), 0.05).shape == (0, 3)
    assert discs_of(np.zeros((0, 0), bool), np.zeros(2), 0.05).shape == (0, 3)


def test_a_cells_distance_is_that_of_its_centre_to_the_place_of_its_label():
    rng = np.random.default_rng(4)
    places = rng.uniform(0, 2, (6, 2))
    labels = rng.integers(1, 6, (11, 17)).astype(np.int32)
    distance = np.zeros(labels.shape, np.float32)
    surface_distance(labels, places, 0.1, distance)
    rows, cols = np.indices(labels.shape)
    centres = np.stack([0.1 * (cols + 0.5), 0.1 * (rows + 0.5)], axis=-1)
    expected = np.hypot(*np.moveaxis(centres - places[labels], -1, 0))
    np.testing.assert_allclose(distance, expected, atol=1e-6)


@given(seed=seeds, rays=st.integers(1, 40))
@settings(max_examples=60)
def test_each_beam_is_placed_from_the_pose_of_its_own_instant(seed, rays):
    """Straight motion with an even turn between the trail's poses; the mount may be anywhere."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(5, 15, 12)).astype(np.int64) * 1_000_000
    trail = np.array([3.0, -2.0, math.pi]) + np.cumsum(rng.uniform(-0.05, 0.05, (12, 3)), axis=0)
    mount = rng.uniform(-0.3, 0.3, 3)
    angles, ranges = rng.uniform(-4, 4, rays), rng.uniform(0.0, 5.0, rays)
    ranges[rng.random(rays) < 0.1] = np.inf
    beam_ns = np.sort(rng.integers(times[0], times[-1] + 1, rays))
    points, origins = deskew(angles, ranges, beam_ns, np.array([0.4, 4.0]), times, trail, mount)
    expected_points, expected_origins = [], []
    for angle, far, t_ns in zip(angles, ranges, beam_ns, strict=True):
        if 0.4 <= far <= 4.0:
            pose = np.array([np.interp(t_ns, times, trail[:, k]) for k in range(3)])
            laser = compose(compose(inverse(trail[-1]), pose), mount)
            ray = far * np.array([[math.cos(angle), math.sin(angle)]])
            expected_points.append(transform_points(laser, ray)[0])
            expected_origins.append(laser[:2])
    np.testing.assert_allclose(points, np.reshape(expected_points, (-1, 2)), atol=1e-9)
    np.testing.assert_allclose(origins, np.reshape(expected_origins, (-1, 2)), atol=1e-9)
