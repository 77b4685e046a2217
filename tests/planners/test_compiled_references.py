"""The compiled kernels of the reference planners against the same methods in plain code."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_visibility
from helpers.plain_exact import plain_exact_path

from simloop.benchmarks.planners.paper_scenes import paper_scene
from simloop.benchmarks.planners.scenes import scene
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import make_problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference import ref_visibility
from simloop.planners.reference.exact import exact_path
from simloop.planners.reference.ref_ompl import clear_check

START, GOAL, BOUNDS = np.array([0.2, 0.3]), np.array([4.8, 4.6]), np.array([0.0, 0.0, 5.0, 5.0])


def discs(seed, count, radii):
    """Discs (count, 3) that may overlap each other, the ends and the bounds."""
    rng = np.random.default_rng(seed)
    found = np.column_stack([rng.uniform(0.0, 5.0, (count, 2)), rng.uniform(*radii, count)])
    near = np.hypot(*(found[:, :2] - START).T) < found[:, 2] + 0.2
    near |= np.hypot(*(found[:, :2] - GOAL).T) < found[:, 2] + 0.2
    return found[~near]


@pytest.mark.parametrize("count", [0, 1, 5, 12, 25])
def test_the_exact_path_is_that_of_the_plain_search(count):
    reached = 0
    for seed in range(8):
        room = discs(seed, count, (0.05, 0.4))
        if seed % 2 and len(room):
            room = np.vstack([room, room[0], room[0] * (1.0, 1.0, 0.5)])  # equal and nested discs
        found = exact_path(room, BOUNDS, START, GOAL, safe_m=0.2)
        plain = plain_exact_path(room, BOUNDS, START, GOAL, safe_m=0.2)
        assert (found is None) == (plain is None)
        if found is None or plain is None:
            continue
        reached += 1
        assert found.cost == pytest.approx(plain.cost, abs=1e-12)
        assert found.length_m == pytest.approx(plain.length_m, abs=1e-12)
        assert found.turning_rad == pytest.approx(plain.turning_rad, abs=1e-12)
        np.testing.assert_allclose(found.points_m, plain.points_m, rtol=0.0, atol=1e-9)
    assert reached >= 4


@pytest.mark.parametrize("one", [scene("S1")[0], paper_scene("trap")], ids=lambda one: one.name)
def test_the_visibility_graph_is_that_of_the_plain_code(one, monkeypatch):
    coarse = 24  # corners of a circle
    monkeypatch.setattr(ref_visibility, "CORNERS", coarse)
    monkeypatch.setattr(plain_visibility, "CORNERS", coarse)
    p = make_problem(one.world, one.start, one.goal, safe_m=one.safe_m)
    corners = ref_visibility.grown_corners(p)
    plain = plain_visibility.plain_grown_corners(p)
    for found, expected in zip(corners, plain, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)
    tail, head = ref_visibility.visible_edges(p, corners, make_stack())
    plain_tail, plain_head = plain_visibility.plain_visible_edges(p, corners, make_stack())
    assert np.array_equal(tail, plain_tail) and np.array_equal(head, plain_head)
    chain = ref_visibility.best_chain(corners.at, tail, head, 0.65, 0.35)
    assert list(chain) == plain_visibility.plain_best_chain(corners.at, tail, head, 0.65, 0.35)
    cut = head != 1
    assert not len(ref_visibility.best_chain(corners.at, tail[cut], head[cut], 0.65, 0.35))


@pytest.mark.parametrize("name", ["S2", "S4a", "trap"])
def test_the_check_for_ompl_is_that_of_all_planners(name):
    one = paper_scene(name) if name == "trap" else scene(name)[0]
    p = make_problem(one.world, one.start, one.goal, safe_m=one.safe_m, overhang_m=0.1)
    clear, rng, before = clear_check(p), np.random.default_rng(0), int(p.trials[0])
    low, high = one.world.bounds_m[:2], one.world.bounds_m[2:]
    ends = rng.uniform(low, high, (300, 2, 2))
    ends[::2, 1] = ends[::2, 0] + rng.normal(0.0, 0.2, (150, 2))
    found = [clear(*a, *b) for a, b in ends]
    assert int(p.trials[0]) == before + len(ends)
    assert found == [is_clear(p, a, b, make_stack()) for a, b in ends]
    assert 20 < sum(found) < 280
