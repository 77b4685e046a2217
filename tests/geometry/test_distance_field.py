"""The distance field: bilinear between the cells' centres, and its two borders outside them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.paths import view_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from simloop.benchmarks.planners.scenes import box_world, disc_world
from simloop.geometry.distance_field import (
    FREE_M,
    Field,
    distance_at,
    field_of,
    footprint_clearance,
)
from simloop.geometry.se2 import transform_points
from simloop.planners.problem.clearance import make_problem, point_clearance

seeds = st.integers(0, 2**32 - 1)
places = st.floats(-0.2, 1.2)
OFFSETS = np.array([-0.16, 0.0, 0.16])


def random_field(rng, free_outside=False):
    """Uneven in rows and columns, so that none passes for the other."""
    shape, corner = (9, 14), rng.uniform(-3, 3, 2)
    distance = rng.uniform(0, 2, shape).astype(np.float32)
    return Field(distance, *corner.tolist(), 0.05, free_outside)


def scipys(field):
    """The same look-up by SciPy: the nearest point inside, or `FREE_M`."""
    rows, cols = field.distance.shape
    axes = (
        field.y0 + field.resolution * np.arange(rows),
        field.x0 + field.resolution * np.arange(cols),
    )
    values = field.distance.astype(float)
    bilinear = RegularGridInterpolator(axes, values, bounds_error=False, fill_value=FREE_M)

    def look_up(x, y):
        if not field.free_outside:
            y, x = np.clip(y, *axes[0][[0, -1]]), np.clip(x, *axes[1][[0, -1]])
        return float(bilinear((y, x)).item())

    return look_up


@pytest.mark.parametrize("free_outside", [False, True], ids=["edge", "free"])
@given(seed=seeds, u=places, v=places)
@settings(max_examples=150)
def test_a_distance_is_bilinear_inside_and_follows_its_border_outside(free_outside, seed, u, v):
    field = random_field(np.random.default_rng(seed), free_outside)
    x = field.x0 + u * 13 * field.resolution
    y = field.y0 + v * 8 * field.resolution
    if min(abs(u), abs(v), abs(u - 1.0), abs(v - 1.0)) > 1e-9:
        assert distance_at(field, x, y) == pytest.approx(scipys(field)(x, y), abs=1e-6)


@given(seed=seeds, yaw=st.floats(-4, 4))
@settings(max_examples=60)
def test_a_footprint_is_as_clear_as_the_worst_of_its_discs(seed, yaw):
    rng = np.random.default_rng(seed)
    field = random_field(rng)
    x = field.x0 + rng.uniform(0, 1) * 13 * field.resolution
    y = field.y0 + rng.uniform(0, 1) * 8 * field.resolution
    at = scipys(field)
    centres = transform_points(np.array([x, y, yaw]), np.column_stack([OFFSETS, 0 * OFFSETS]))
    least = min(at(*centre) for centre in centres)
    assert footprint_clearance(field, x, y, yaw, OFFSETS) == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize("outside", ["edge", "free"])
def test_a_views_field_lies_where_its_cells_are(outside):
    view = box_world(np.array([[1.0, 2.0, 1.5, 2.25]]), 5.0, 0.05)
    field = field_of(view, outside=outside)
    for x, y, truth in ((0.613, 2.1, 0.387), (1.2, 2.912, 0.662), (1.8, 2.65, 0.5)):
        assert distance_at(field, x, y) == pytest.approx(truth, abs=2e-3)


@pytest.mark.parametrize("outside", ["edge", "free"])
def test_a_view_without_a_field_is_free(outside):
    field = field_of(disc_world([[1.0, 1.0, 0.3]], (0.0, 0.0, 5.0, 5.0)), outside=outside)
    assert distance_at(field, 1.0, 1.0) == FREE_M


@given(x=st.floats(-4.0, 4.0), y=st.floats(-4.0, 4.0))
@settings(max_examples=60)
def test_planners_take_the_edge(x, y):
    """The planners' problem looks up the same field with the same border, inside and outside."""
    view = view_of([(2.5, 0.3, 0.4), (-1.0, -2.8, 0.3)])
    problem = make_problem(view, np.zeros(3), np.ones(2), safe_m=0.26)
    field = field_of(view, outside="edge")
    assert point_clearance(problem, x, y) == pytest.approx(distance_at(field, x, y), abs=1e-9)
