"""Ranges that are carried from one origin to others, against rays on planes by hand."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.physics.arena_rays import carry_ranges

CUTOFF_M = 5.0


def plane_ranges(origins, directions, normals, offsets):
    """Ranges from each origin to the plane n . x = offset of its ray."""
    along = np.sum(directions * normals, axis=1)
    return (offsets - np.sum(origins * normals, axis=1)) / along


def some_rays(rng, count=200):
    """Origins, directions, and planes that are met neither flatly nor far away."""
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    normals = -directions + 0.5 * rng.uniform(-1.0, 1.0, (count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    offsets = np.sum(normals * directions, axis=1) * rng.uniform(0.5, 4.5, count)
    return rng.uniform(-2e-3, 2e-3, (count, 3)), directions, normals, offsets


def test_a_carried_range_is_that_of_the_ray_from_its_own_origin():
    origins, directions, normals, offsets = some_rays(np.random.default_rng(0))
    middle = origins[100].copy()
    ranges = plane_ranges(np.tile(middle, (200, 1)), directions, normals, offsets)
    flat = carry_ranges(ranges, normals, directions, origins, middle, CUTOFF_M)
    assert len(flat) == 0
    expected = plane_ranges(origins, directions, normals, offsets)
    np.testing.assert_allclose(ranges, expected, atol=1e-12)


def test_flat_rays_are_named_and_stay_as_they_are():
    angle = np.radians(4.0)
    directions = np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
    normals = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    origins, ranges = np.array([[0.0, 0.0, 0.0], [0.002, 0.0, 0.0]]), np.array([2.0, 3.0])
    flat = carry_ranges(ranges, normals, directions, origins, origins[0], CUTOFF_M)
    assert flat.tolist() == [1]
    assert ranges == pytest.approx([2.0, 3.0])


def test_what_is_missed_or_then_too_far_is_minus_one():
    directions, normals = np.tile([1.0, 0.0, 0.0], (2, 1)), np.tile([-1.0, 0.0, 0.0], (2, 1))
    origins, ranges = np.array([[0.0, 0.0, 0.0], [-0.002, 0.0, 0.0]]), np.array([-1.0, 4.999])
    flat = carry_ranges(ranges, normals, directions, origins, np.zeros(3), CUTOFF_M)
    assert len(flat) == 0
    assert ranges.tolist() == [-1.0, -1.0]
