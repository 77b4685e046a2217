"""The correlative search against trying every pose, and its fields against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.geometry.se2 import transform_points, wrap_angle
from simloop.mapping.correlative import MID, TOP, SearchFields, raise_field, search, thinned

seeds = st.integers(0, 2**32 - 1)
CELL = 0.05
NO_PLACE = np.empty((0, 5))


def fields_of(places, corner, shape=(64, 96)):
    fields = [np.zeros([n // side for n in shape], np.uint8) for side in (1, MID, TOP)]
    raise_field(places, *corner.tolist(), CELL, *fields)
    return fields


def random_map(rng, count=40):
    corner = rng.uniform(-2, 2, 2)
    return corner, corner + rng.uniform(0.2, 1.0, (count, 2)) * [96 * CELL, 64 * CELL] * 0.9


def plain_search(points, prior, window, weights, fine, corner, yaw_step, but):
    """The oracle: every translation by cells and every turn in the window."""
    half, turns = math.ceil(window[0] / CELL), math.ceil(window[1] / yaw_step)
    best = -np.inf
    for turn in range(-turns, turns + 1):
        yaw = prior[2] + turn * yaw_step
        cells = np.floor((transform_points(np.array([*prior[:2], yaw]), points) - corner) / CELL)
        for row in range(-half, half + 1):
            for col in range(-half, half + 1):
                x, y = prior[0] + col * CELL, prior[1] + row * CELL
                if any(
                    math.hypot(x - b[0], y - b[1]) < b[3] and abs(wrap_angle(yaw - b[2])) < b[4]
                    for b in but
                ):
                    continue
                at = (cells + np.array([col, row])).astype(int)
                ok = np.all((at >= 0) & (at < [fine.shape[1], fine.shape[0]]), axis=1)
                score = fine[at[ok, 1], at[ok, 0]].sum(dtype=float) / (255.0 * len(points))
                off = turn * yaw_step
                score -= weights[0] * CELL**2 * (row**2 + col**2) + weights[1] * off**2
                best = max(best, score)
    return best


@given(seed=seeds, left_out=st.booleans())
@settings(max_examples=25)
def test_the_search_finds_what_trying_every_pose_finds(seed, left_out):
    rng = np.random.default_rng(seed)
    corner, places = random_map(rng)
    fields = fields_of(places, corner)
    true = np.array([corner[0] + 2.0, corner[1] + 1.5, rng.uniform(-3, 3)])
    cos, sin = math.cos(true[2]), math.sin(true[2])
    points = (places - true[:2]) @ np.array([[cos, -sin], [sin, cos]])
    prior = true + rng.uniform(-0.2, 0.2, 3) * [1, 1, 0.3]
    window, weights = np.array([rng.uniform(0.1, 0.5), 0.08]), np.array([0.3, 0.5])
    but = np.array([[*true, 0.15, 0.2]] * 2 if left_out else NO_PLACE)
    args = (points, prior, window, weights)
    pose, score = search(*args, SearchFields(*fields, corner, CELL), 0.03, 0.0, but)
    expected = plain_search(*args, fields[0], corner, 0.03, but)
    assert score == pytest.approx(expected, abs=1e-9)
    if left_out:
        assert math.dist(pose[:2], true[:2]) >= 0.15 or abs(wrap_angle(pose[2] - true[2])) >= 0.2


def test_below_the_least_score_nothing_is_found():
    rng = np.random.default_rng(1)
    corner, places = random_map(rng)
    fields = fields_of(places, corner)
    prior = np.array([corner[0] + 2.0, corner[1] + 1.5, 0.0])
    points = rng.uniform(-1, 1, (30, 2))
    args = (
        points,
        prior,
        np.array([0.2, 0.1]),
        np.zeros(2),
        SearchFields(*fields, corner, CELL),
        0.03,
    )
    _, score = search(*args, 0.0, NO_PLACE)
    assert score > 0.0
    assert search(*args, score + 1e-6, NO_PLACE)[1] == -1.0


@given(seed=seeds)
@settings(max_examples=30)
def test_the_coarse_fields_bound_the_fine_one_under_every_shift(seed):
    """Entry [i, j] is the maximum over two blocks each way: a point moved within one stays in."""
    rng = np.random.default_rng(seed)
    corner, places = random_map(rng)
    fine, mid, top = fields_of(places, corner)
    for level, side in ((mid, MID), (top, TOP)):
        for i, j in np.ndindex(level.shape):
            block = fine[i * side : (i + 2) * side, j * side : (j + 2) * side]
            assert level[i, j] == block.max()
    rows, cols = np.indices(fine.shape)
    centres = corner + CELL * (np.stack([cols, rows], axis=-1) + 0.5)
    nearest = np.hypot(*np.moveaxis(centres[:, :, None] - places, -1, 0)).min(axis=2) / CELL
    expected = np.where(nearest < 3.0, np.floor(255.0 * np.exp(-0.5 * nearest**2)), 0)
    close = nearest < 3.0
    np.testing.assert_allclose(fine[close], expected[close], atol=1)


@given(seed=seeds, most=st.integers(5, 200))
@settings(max_examples=30)
def test_thinned_points_are_some_of_them_and_no_two_share_a_square(seed, most):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (300, 2))
    few = thinned(points, 0.1, most)
    assert {tuple(p) for p in few} <= {tuple(p) for p in points}
    assert len(np.unique(np.floor(few / 0.1), axis=0)) == len(few) <= most
    squares = len(np.unique(np.floor(points / 0.1), axis=0))
    assert len(thinned(points, 0.1, 10**6)) == squares
