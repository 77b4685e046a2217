"""What has just come into the map and stands in the way of the path, against all pairs."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.navigation.feasibility import stands_in_the_way

seeds = st.integers(0, 2**32 - 1)


def path_along_x():
    x = np.arange(0.0, 3.0, 0.02)
    return np.stack((x, 0 * x), axis=1), 0 * x, np.full(len(x), 0.5)


@given(st.floats(-1, 4), st.floats(-1, 1), st.integers(0, 140))
@settings(max_examples=200)
def test_what_stands_in_the_way_is_what_comes_too_near_to_the_discs(x, y, first):
    xy, yaw, clearance = path_along_x()
    offsets = np.array([-0.16, 0.0, 0.16])
    centres = (xy[first:, 0][:, None] + offsets).ravel()
    near = np.hypot(centres - x, y).min()
    got = stands_in_the_way(np.array([[x, y]]), xy, yaw, clearance, first, offsets, 0.24, 0.02)
    if abs(near - 0.24) > 1e-9:
        assert got == (near < 0.24)


@given(seeds, st.integers(0, 30))
@settings(max_examples=150)
def test_the_discs_ride_along_the_paths_own_heading(seed, first):
    """A winding path, discs that are not even about its middle, and what was planned: all count."""
    rng = np.random.default_rng(seed)
    yaw = np.cumsum(rng.uniform(-0.2, 0.25, 40)) + rng.uniform(-3, 3)
    xy = np.cumsum(0.05 * np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)
    clearance, offsets = rng.uniform(0.1, 0.5, 40), np.array([-0.05, 0.1, 0.3])
    surfaces = xy[rng.integers(0, 40, 2)] + rng.uniform(-0.6, 0.6, (2, 2))
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    centres = xy[first:, None] + offsets[:, None] * ahead[first:, None]
    apart = np.hypot(*np.moveaxis(centres[:, :, None] - surfaces, -1, 0)).min(axis=(1, 2))
    room = apart - np.minimum(0.24, clearance[first:] - 0.02)
    got = stands_in_the_way(surfaces, xy, yaw, clearance, first, offsets, 0.24, 0.02)
    if np.abs(room).min() > 1e-9:
        assert got == (room < 0.0).any()


def test_what_the_plan_already_allowed_for_is_not_in_the_way():
    xy, yaw, clearance = path_along_x()
    surface, offsets = np.array([[1.0, 0.2]]), np.array([-0.16, 0.0, 0.16])
    assert stands_in_the_way(surface, xy, yaw, clearance, 0, offsets, 0.24, 0.02)
    tight = np.full(len(xy), 0.21)  # planned that near: 0.2 is no news
    assert not stands_in_the_way(surface, xy, yaw, tight, 0, offsets, 0.24, 0.02)
    assert not stands_in_the_way(np.empty((0, 2)), xy, yaw, clearance, 0, offsets, 0.24, 0.02)
