"""The objective against a slow twin that samples densely and knows nothing of the kernels."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from simloop.benchmarks.planners.judge import path_cost
from simloop.benchmarks.planners.scenes import box_world, disc_world
from simloop.messages import WorldView
from simloop.planners.problem.clearance import make_problem, segment_clearance
from simloop.planners.problem.objective import (
    LEAST_INTRUSION_M,
    THROUGH_M,
    THROUGH_SHARE,
    evaluate,
    intrusion,
    length_and_turning,
    make_stack,
    start_turn,
)

SAFE = 0.26
BOX = (0.0, 0.0, 5.0, 5.0)
seeds = st.integers(0, 2**32 - 1)


def sampled(clearance, a, b, overhang=0.0, at_start=False):
    """Least clearance over a dense sampling of the segment, stretched by the overhang."""
    along = (b - a) / np.hypot(*(b - a))
    first, last = a if at_start else a - overhang * along, b + overhang * along
    t = np.linspace(0.0, 1.0, 4001)[:, None]
    return clearance(first + t * (last - first)).min()


def among(discs):
    centres, radii = discs[:, :2], discs[:, 2]
    return lambda x: (np.hypot(*(x[:, None] - centres).transpose(2, 0, 1)) - radii).min(axis=1)


def bilinear(view: WorldView):
    """The field between its cells' centres, held constant beyond them."""

    def value(points):
        field = view.distance_m.astype(float)
        at = (points - view.origin_m) / view.resolution_m - 0.5
        u = np.clip(at[:, 0], 0, field.shape[1] - 1)
        v = np.clip(at[:, 1], 0, field.shape[0] - 1)
        i = np.minimum(u.astype(int), field.shape[1] - 2)
        j = np.minimum(v.astype(int), field.shape[0] - 2)
        a, b = u - i, v - j
        low = field[j, i] * (1 - a) + field[j, i + 1] * a
        high = field[j + 1, i] * (1 - a) + field[j + 1, i + 1] * a
        return low * (1 - b) + high * b

    return value


@settings(max_examples=150)
@given(seed=seeds, overhang=st.sampled_from([0.0, 0.16]), field=st.booleans())
def test_a_segments_clearance_is_that_of_its_worst_point(seed, overhang, field):
    rng = np.random.default_rng(seed)
    if field:
        low = rng.uniform(0.0, 4.5, (4, 2))
        view = box_world(np.hstack([low, low + rng.uniform(0.1, 1.0, (4, 2))]), 5.0, 0.05)
        clearance = bilinear(view)
    else:
        discs = np.column_stack([rng.uniform(0, 5, (6, 2)), rng.uniform(0.1, 0.4, 6)])
        view, clearance = disc_world(discs, BOX), among(discs)
    start = np.array([-9.0, -9.0, 0.0])
    p = make_problem(view, start, np.array([5.0, 5.0]), safe_m=SAFE, overhang_m=overhang)
    p = p._replace(start_slack=0.0)
    a, b = rng.uniform(0.0, 5.0, (2, 2))
    truth = sampled(clearance, a, b, overhang)
    found = segment_clearance(p, *a, *b, p.safe_m, -np.inf, make_stack())
    if truth >= p.safe_m:
        assert found >= p.safe_m - 1e-9
    else:
        # The kernel is exact; the twin may miss the worst point by a little.
        assert truth - 1e-3 < found <= truth + 1e-9


@settings(max_examples=80)
@given(seed=seeds, points=st.integers(2, 12))
def test_length_turning_and_penalty_add_up(seed, points):
    rng = np.random.default_rng(seed)
    discs = np.array([[2.0, 2.0, 0.3], [3.5, 1.0, 0.2]])
    path = rng.uniform(0.0, 5.0, (points, 2))
    start = np.array([*path[0], 0.0])
    p = make_problem(disc_world(discs, BOX), start, path[-1], safe_m=SAFE)._replace(start_slack=0.0)
    stack = make_stack()
    lacks = [SAFE - sampled(among(discs), a, b) for a, b in pairwise(path)]
    through = [THROUGH_M * (SAFE - lack < THROUGH_SHARE * SAFE) for lack in lacks]
    assume(all(abs(SAFE - lack - THROUGH_SHARE * SAFE) > 0.01 for lack in lacks))
    total = sum(lack + LEAST_INTRUSION_M for lack in lacks if lack > 1e-5) + sum(through)
    assert intrusion(p, path, points, np.inf, stack) == pytest.approx(total, abs=0.01)
    length, turning = length_and_turning(path, points)
    assert 0.65 * length + 0.35 * turning == pytest.approx(plain := path_cost_by_angles(path))
    cost = evaluate(p, path, points, np.inf, stack)
    assert cost == pytest.approx(plain + 60.0 * total, abs=0.6)
    # With a bound it may stop early, but only on the losing side of it.
    assert evaluate(p, path, points, cost + 1e-9, stack) == pytest.approx(cost)
    assert evaluate(p, path, points, 0.5 * cost, stack) > 0.5 * cost


def path_cost_by_angles(path):
    """Eqs. 4-6 with each turn from the cosine rule."""
    steps = np.diff(path, axis=0)
    lengths = np.hypot(*steps.T)
    cosines = (steps[1:] * steps[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
    return 0.65 * lengths.sum() + 0.35 * np.arccos(np.clip(cosines, -1, 1)).sum()


def test_a_turn_is_never_more_than_half_a_turn():
    # Eq. 6 as printed would make of this one almost a whole turn.
    path = np.array([[0.0, 0.0], [-1.0, 0.1], [-2.0, 0.0]])
    assert length_and_turning(path, 3)[1] < 0.3
    assert path_cost(path) == pytest.approx(path_cost_by_angles(path))


def test_repeated_points_have_no_heading():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    assert length_and_turning(path, 4) == (2.0, 0.0)


def test_a_start_too_close_is_allowed_to_leave_but_not_to_stay():
    discs = np.array([[0.0, 0.5, 0.3]])
    view = disc_world(discs, (-3.0, -3.0, 3.0, 3.0))
    p = make_problem(view, np.array([0.0, 0.0, -1.57]), np.array([0.0, -2.0]), safe_m=SAFE)
    assert p.start_slack == pytest.approx(0.06, abs=3e-3)
    stack = make_stack()
    leaving, along = np.array([[0.0, 0.0], [0.0, -2.0]]), np.array([[0.0, 0.0], [0.5, 0.45]])
    assert intrusion(p, leaving, 2, np.inf, stack) == 0.0
    assert intrusion(p, along, 2, np.inf, stack) > 0.0


@given(seed=seeds, yaw=st.floats(-7.0, 7.0))
@settings(max_examples=60)
def test_the_turn_at_the_start_is_from_the_robots_heading_to_the_first_leg(seed, yaw):
    path = np.random.default_rng(seed).uniform(0.0, 5.0, (4, 2))
    path[1] = path[0]  # a leg without length has no heading
    start = np.array([*path[0], yaw])
    p = make_problem(disc_world(np.zeros((0, 3)), BOX), start, path[-1], safe_m=SAFE)
    leg = (path[2] - path[0]) / np.hypot(*(path[2] - path[0]))
    cosine = np.clip(leg @ [np.cos(yaw), np.sin(yaw)], -1.0, 1.0)
    assert start_turn(p, path, 4) == pytest.approx(np.arccos(cosine), abs=1e-6)
    stack, plain = make_stack(), path_cost_by_angles(path[[0, 2, 3]])
    weighed = p._replace(start_turn_weight=0.2)
    expected = plain + 0.2 * np.arccos(cosine)
    assert evaluate(weighed, path, 4, np.inf, stack) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_the_kernels_see_one_type_however_many_discs_there_are(count):
    """A read-only array is another type to the compiler: all would be compiled again for it."""
    view = disc_world(np.full((count, 3), 0.5), BOX)
    p = make_problem(view, np.zeros(3), np.array([5.0, 5.0]), safe_m=SAFE)
    assert p.discs.shape == (3, count) and p.discs.flags.writeable and p.discs.flags.c_contiguous
