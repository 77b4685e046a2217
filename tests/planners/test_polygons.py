"""Clearance to convex polygons against a twin that samples densely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from simloop.benchmarks.planners.scenes import disc_world
from simloop.planners.problem.clearance import make_problem
from simloop.planners.problem.polygons import polygon_clearance

EMPTY = disc_world(np.zeros((0, 3)), (0.0, 0.0, 5.0, 5.0))


def problem(*polygons):
    world = replace(EMPTY, polygons_m=polygons)
    return make_problem(world, np.array([-9.0, -9.0, 0.0]), np.array([5.0, 5.0]), safe_m=0.26)


def signed(polygon, points):
    """Signed distance of points (N, 2) to a counter-clockwise convex polygon."""
    a, e = polygon, np.roll(polygon, -1, axis=0) - polygon
    off = points[:, None] - a
    t = np.clip((off * e).sum(axis=2) / (e**2).sum(axis=1), 0.0, 1.0)
    outline = np.hypot(*(off - t[..., None] * e).transpose(2, 0, 1)).min(axis=1)
    inside = (e[:, 0] * off[..., 1] - e[:, 1] * off[..., 0] >= 0.0).all(axis=1)
    return np.where(inside, -outline, outline)


@settings(max_examples=200)
@given(seed=st.integers(0, 2**32 - 1), clockwise=st.booleans())
def test_a_segments_clearance_is_that_of_its_worst_sample(seed, clockwise):
    rng = np.random.default_rng(seed)
    polygons = []
    for _ in range(rng.integers(1, 4)):
        cloud = rng.uniform(0.5, 4.0, 2) + rng.uniform(0.2, 1.5) * rng.normal(size=(8, 2))
        polygons.append(cloud[ConvexHull(cloud).vertices])
    given_as = [polygon[::-1] if clockwise else polygon for polygon in polygons]
    a, b = rng.uniform(0.0, 5.0, (2, 2))
    points = a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)
    truth = min(signed(polygon, points).min() for polygon in polygons)
    p = problem(*given_as)
    found = polygon_clearance(p.corners, *a, *b)
    assert truth - 1e-3 < found <= truth + 1e-9


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [1, 0]],
        [[0, 0], [1, 0], [2, 0]],
        [[0, 0], [2, 0], [1, 0.5], [2, 2]],
        [[0, 0], [2, 2], [2, 0], [0, 2]],
    ],
)
def test_what_is_not_a_convex_polygon_is_refused(corners):
    with pytest.raises(ValueError, match="polygon 0 is not convex"):
        problem(np.array(corners, dtype=float))
