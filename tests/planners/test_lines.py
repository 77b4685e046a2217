"""Paths coded as lines: there and back, the lines' own geometry, what is left out near a path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simloop.benchmarks.planners.scenes import disc_world
from simloop.planners.problem.clearance import make_problem
from simloop.planners.problem.objective import intrusion, length_and_turning, make_stack
from simloop.planners.tlbo.lines import CORRIDOR_M, decode, encode, make_lines, nearby

SAFE = 0.26
BOX = (-10.0, -10.0, 20.0, 10.0)
seeds = st.integers(0, 2**32 - 1)


def zigzag(rng, points):
    """A polyline whose neighbours turn by some 10 to 60 degrees, to either side."""
    turns = rng.uniform(0.17, 1.0, points - 2) * rng.choice([-1.0, 1.0], points - 2)
    heading = np.cumsum([rng.uniform(-1.0, 1.0), *turns])
    legs = rng.uniform(0.6, 1.5, points - 1)[:, None]
    steps = legs * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])


def coded(path, discs):
    """The problem, the lines, and how many are free."""
    start = np.array([*path[0], 0.0])
    p = make_problem(disc_world(discs, BOX), start, path[-1], safe_m=SAFE)
    lines = make_lines()
    padded = np.zeros((40, 2))
    padded[: len(path)] = path
    return p, lines, encode(p, padded, len(path), lines, make_stack())


def decoded(p, lines, free, m, subject):
    """The path (m, 2) and its turning; None where the lines make no path."""
    padded, out = np.zeros((40, 2)), np.zeros((40, 2))
    padded[:free] = subject
    turning = decode(p, lines, padded, free, m, out)
    return (out[:m], turning) if turning >= 0.0 else None


def beside(path, rng, count=4):
    """Discs that touch the path's segments at the safe distance, from either side."""
    discs = []
    for i in rng.integers(0, len(path) - 1, count):
        t, r = rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.4)
        along = (path[i + 1] - path[i]) / np.hypot(*(path[i + 1] - path[i]))
        side = rng.choice([-1.0, 1.0]) * np.array([-along[1], along[0]])
        discs.append([*(path[i] + t * (path[i + 1] - path[i]) + (r + SAFE) * side), r])
    return np.array(discs)


@given(seed=seeds, points=st.integers(3, 9))
@settings(max_examples=60)
def test_the_coded_path_itself_comes_back(seed, points):
    rng = np.random.default_rng(seed)
    path = zigzag(rng, points)
    p, lines, free = coded(path, beside(path, rng))
    found, turning = decoded(p, lines, free, points, np.zeros((free, 2)))
    np.testing.assert_allclose(found, path, atol=1e-9)
    assert turning == pytest.approx(length_and_turning(path, points)[1], abs=1e-9)


@given(seed=seeds, points=st.integers(3, 9))
@settings(max_examples=100)
def test_each_line_is_turned_and_shifted_as_its_subject_says(seed, points):
    """Segment i has the coded heading + swing and passes centre - (radius + offset) normal."""
    rng = np.random.default_rng(seed)
    path = zigzag(rng, points)
    p, lines, free = coded(path, beside(path, rng))
    # What touches nothing could be drawn as far as it is clear; small moves keep the lines' order.
    subject = rng.uniform(-1.0, 1.0, (free, 2)) * np.minimum(lines.spread[:free], 0.02)
    result = decoded(p, lines, free, points, subject)
    assume(result is not None)
    found, turning = result
    np.testing.assert_array_equal(found[[0, -1]], path[[0, -1]])
    assert turning == pytest.approx(length_and_turning(found, points)[1], abs=1e-6)
    swings, offsets = np.zeros(points - 1), np.zeros(points - 1)
    swings[lines.free[:free]], offsets[lines.free[:free]] = subject.T
    before, after = np.diff(path, axis=0), np.diff(found, axis=0)
    for i in range(points - 1):
        turned = before[i, 0] * after[i, 1] - before[i, 1] * after[i, 0]
        assert math.atan2(turned, before[i] @ after[i]) == pytest.approx(swings[i], abs=1e-6)
        heading = math.atan2(after[i, 1], after[i, 0])
        normal = np.array([-math.sin(heading), math.cos(heading)])
        to_left = (lines.centre[i] - found[i]) @ normal
        assert to_left == pytest.approx(lines.radius[i] + offsets[i], abs=1e-6)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_line_between_two_turns_rolls_about_what_it_touches(side):
    """About a round obstacle, on a circle a little larger than the one that it must not enter."""
    path = np.array([[0.0, 0.0], [1.6, 0.66], [2.4, 0.66], [4.0, 0.0]]) * [1.0, side]
    disc = np.array([[2.0, 0.0, 0.4]])
    p, lines, free = coded(path, disc)
    middle = lines.free[:free].tolist().index(1)
    reach = 0.4 + SAFE
    assert reach <= abs(lines.radius[1]) < 1.15 * reach
    assert np.sign(lines.radius[1]) == -side  # the obstacle is on the right if the path is above
    stack = make_stack()
    for swing in (-0.2, -0.1, 0.1, 0.2):
        subject = np.zeros((free, 2))
        subject[middle, 0] = swing
        found, _ = decoded(p, lines, free, 4, subject)
        a, b = found[1], found[2]
        along = (b - a) / np.hypot(*(b - a))
        off = abs(along[0] * (0.0 - a[1]) - along[1] * (2.0 - a[0]))
        assert off >= reach - 1e-9
        assert off < reach + 0.01
        rolled = np.zeros((40, 2))
        rolled[:2] = a, b
        assert intrusion(p, rolled, 2, np.inf, stack) == 0.0


def test_lines_that_meet_in_the_wrong_order_or_outside_make_no_path():
    path = np.array([[0.0, 0.0], [1.5, 0.66], [2.5, 0.66], [4.0, 0.0]])
    p, lines, free = coded(path, np.array([[2.0, 0.05, 0.4]]))  # lacks 5 cm: all may move
    assert free == 3
    assert decoded(p, lines, free, 4, np.zeros((3, 2))) is not None
    for up, there in ((0.15, True), (0.2, True), (0.24, False), (0.3, False)):
        # The outer lines meet 0.22 m above the middle one: beyond, they are crossed in turn.
        subject = np.array([[0.0, 0.0], [0.0, -up], [0.0, 0.0]])
        assert (decoded(p, lines, free, 4, subject) is not None) == there
    assert decoded(p, lines, free, 4, np.array([[0.0, 0.0], [0.7, 0.0], [0.0, 0.0]])) is None
    low = p._replace(high_y=0.67)
    assert decoded(low, lines, free, 4, np.zeros((3, 2))) is not None
    assert decoded(low, lines, free, 4, np.array([[0, 0], [0, 0.05], [0, 0.0]])) is not None
    assert decoded(low, lines, free, 4, np.array([[0, 0], [0, -0.05], [0, 0.0]])) is None


@given(seed=seeds, points=st.integers(2, 6))
@settings(max_examples=100)
def test_what_no_path_of_the_corridor_comes_near_can_be_left_out(seed, points):
    rng = np.random.default_rng(seed)
    path = zigzag(rng, points)
    low, high = [-4.0, -6.0, 0.1], [10.0, 6.0, 0.5]
    discs = rng.uniform(low, high, (30, 3))
    start = np.array([*path[0], 0.0])
    p = make_problem(disc_world(discs, BOX), start, path[-1], safe_m=SAFE, overhang_m=0.16)
    near = nearby(p, path, points)
    t = np.linspace(0.0, 1.0, 400)[:, None]
    dense = np.vstack([a + t * (b - a) for a, b in pairwise(path)])
    apart = np.hypot(*(dense[:, None] - discs[:, :2]).transpose(2, 0, 1)).min(axis=0)
    reach = discs[:, 2] + SAFE + 0.16 + CORRIDOR_M
    kept = {tuple(disc) for disc in near.discs.T}
    for disc, gap in zip(discs, apart - reach, strict=True):
        if abs(gap) > 1e-3:
            assert (tuple(disc) in kept) == (gap < 0.0)
    assert near.trials is p.trials
    for name in set(p._fields) - {"discs", "trials"}:
        assert getattr(near, name) is getattr(p, name) or getattr(near, name) == getattr(p, name)
