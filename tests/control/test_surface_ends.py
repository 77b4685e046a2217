"""Where surfaces end between two rays."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simloop.control.surface_ends import ends_of_surfaces

SPACING_RAD = math.tau / 360
APART_M = 0.05


def seen_corner(tip, directions, offset_rad):
    """The points at which 360 rays meet a corner: two long surfaces from ``tip``, rad each."""
    hits = []
    for bearing in np.arange(-180, 180) * SPACING_RAD + offset_rad:
        ray = np.array([math.cos(bearing), math.sin(bearing)])
        ranges = []
        for along in directions:
            system = np.column_stack((ray, [-math.cos(along), -math.sin(along)]))
            distance, place = np.linalg.solve(system, tip)
            if distance > 0.0 and 0.0 <= place <= 1.0:
                ranges.append(distance)
        if ranges:
            hits.append(min(ranges) * ray)
    return np.array(hits)


@pytest.mark.parametrize("offset_rad", np.linspace(0.0, SPACING_RAD, 7))
def test_the_tip_of_a_sharp_corner_between_two_rays_counts(offset_rad):
    """The far surface is hidden, so that the near one ends at the tip, seen from the origin."""
    tip = np.array([0.25, -0.23])
    points = seen_corner(tip, (-1.5, -0.75), offset_rad)
    ends = ends_of_surfaces(points, SPACING_RAD, APART_M)
    surface = np.array([math.cos(-1.5), math.sin(-1.5)])
    place = min((ends - tip) @ surface, key=abs)  # beyond the tip it is negative
    beam_m = SPACING_RAD * np.hypot(*tip) / math.sin(1.5 - 0.7437)  # of two rays, on the surface
    assert min((points - tip) @ surface) >= -1e-9
    assert -beam_m - 1e-3 <= place <= 1e-3


def test_a_surface_without_an_end_and_a_few_points_get_none():
    bearing = np.linspace(-3.1, 3.1, 181)
    ring = np.column_stack((np.cos(bearing), np.sin(bearing)))
    assert len(ends_of_surfaces(ring, 0.025, 0.2)) == 0
    assert len(ends_of_surfaces(ring[:2], 0.025, 1e-3)) == 0


def test_the_end_of_a_thin_post_stays_where_it_is_seen():
    bearing = np.linspace(-1.0, 1.0, 81)
    wall = 2.0 * np.column_stack((np.cos(bearing), np.sin(bearing)))
    wall[40] = (0.4, 0.0)
    ends = ends_of_surfaces(wall, 0.025, 0.1)
    near = ends[np.hypot(*ends.T) < 1.0]
    np.testing.assert_array_equal(near, [[0.4, 0.0], [0.4, 0.0]])
