"""The index of outlines gives the same distances, to the bit, as a search through all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.geometry.outline_distance import distances
from simloop.worlds import floor_plan, outline_gap
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import Section, rasterise
from simloop.worlds.obstacles import Obstacle


def plain(point, sections):
    """The least signed distance by the definition, in plain Python."""
    least = math.inf
    for section in sections:
        vertices = section.vertices_m
        inside, nearest = len(vertices) > 2, math.inf
        for a, b in zip(np.roll(vertices, 1, axis=0), vertices, strict=True):
            edge, off = b - a, point - a
            inside = inside and edge[0] * off[1] - edge[1] * off[0] >= 0.0
            length2 = float(edge @ edge)
            share = min(1.0, max(0.0, float(off @ edge) / length2)) if length2 > 0.0 else 0.0
            nearest = min(nearest, float(np.hypot(*(off - share * edge))))
        least = min(least, (-nearest if inside else nearest) - section.radius_m)
    return least


def drawn(rng, count, side):
    """Discs, points, segments, boxes, ells and polygons, some on the raster's own lines."""
    sections = []
    for _ in range(count):
        at, kind = rng.uniform(-0.5, side + 0.5, 2), rng.integers(5)
        if kind == 0:
            sections.append(Section("disc", at[None], float(rng.uniform(0.0, 0.5))))
        elif kind == 1:
            ends = np.stack([at, at + rng.uniform(-1, 1, 2)])
            sections.append(Section("segment", ends, float(rng.choice([0.0, 0.1]))))
        elif kind == 2:
            low, size = np.round(at, 1), np.round(rng.uniform(0.1, 1.5, 2), 1)
            sections += Obstacle("box", tuple(low.tolist()), tuple(size.tolist())).sections()
        elif kind == 3:
            yaw = float(rng.uniform(-3, 3))
            sections += Obstacle("ell", tuple(at.tolist()), (0.9, 0.7, 0.2), yaw).sections()
        else:
            sections += Obstacle("ellipse", tuple(at.tolist()), (0.6, 0.3)).sections()
    return sections


@given(
    seed=st.integers(0, 2**32),
    count=st.integers(0, 60),
    side=st.sampled_from([0.3, 3.0, 7.7]),
    step=st.sampled_from([0.02, 0.025, 1.0]),
)
@settings(max_examples=25, deadline=None)
def test_raster_and_look_up_are_those_of_a_full_search(seed, count, side, step):
    rng = np.random.default_rng(seed)
    plan = rasterise(drawn(rng, count, side), (0.0, -1.0, side, side), step)
    rows, columns = plan.distance_m.shape
    cells = rng.integers(0, (rows, columns), (200, 2))
    centres = plan.origin_m + (cells[:, ::-1] + 0.5) * plan.resolution_m
    exact = distances(centres, plan.outlines, None)
    np.testing.assert_array_equal(plan.distance_m[tuple(cells.T)], exact.astype(np.float32))
    points = rng.uniform(-2.0, side + 2.0, (200, 2))
    points[:50] = np.round(points[:50], 1)
    np.testing.assert_array_equal(plan.clearance_m(points), distances(points, plan.outlines, None))
    for point in points[:5]:
        expected = plain(point, plan.sections)
        assert plan.clearance_m(point)[0] == pytest.approx(expected, abs=1e-12)
        assert plan.nearest(point)[0] == plan.clearance_m(point)[0]


def test_thousands_of_shapes_are_indexed_sparsely():
    rng = np.random.default_rng(0)
    cylinders = [Section("c", rng.uniform(0, 40, (1, 2)), 0.15) for _ in range(800)]
    plan = rasterise(cylinders, (0.0, 0.0, 40.0, 40.0))
    blocks = np.prod(plan.index.shape)
    assert len(plan.index.entries) < 10 * blocks


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_points_that_are_nowhere_are_no_fault(bad):
    plan = rasterise([Section("c", np.array([[1.0, 1.0]]), 0.2)], (0.0, 0.0, 3.0, 3.0))
    assert not plan.clearance_m(np.array([[bad, 1.0], [1.0, bad]])).min() < 0.0


def test_a_floor_too_large_is_refused_and_a_large_one_has_larger_cells(monkeypatch):
    monkeypatch.setattr(floor_plan, "CELLS", 1000)
    assert rasterise([], (0.0, 0.0, 10.0, 10.0)).distance_m.shape == (32, 32)
    with pytest.raises(ValueError, match=r"a side of the floor: 1,000 m; at most 500 m"):
        rasterise([], (0.0, 0.0, 1000.0, 1.0))
    with pytest.raises(ValueError, match="positive area"):
        rasterise([], (0.0, 0.0, 3.0, np.nan))


def test_the_outlines_gap_needs_only_the_near_obstacles(monkeypatch):
    rng = np.random.default_rng(4)
    plan = rasterise(drawn(rng, 80, 7.0), (0.0, 0.0, 7.0, 7.0), 0.05)
    poses = rng.uniform((0, 0, -3), (7, 7, 3), (300, 3))
    body = Body(0.49, 0.465, 0.2)
    each = [outline_gap.clearances(plan, pose[None], body)[0] for pose in poses]
    least = [outline_gap.least_clearance(plan, poses[k : k + 30], body) for k in range(0, 300, 30)]
    monkeypatch.setattr(
        outline_gap, "within_reach", lambda points, reach, outlines: np.ones(len(outlines[2]), bool)
    )
    everything = outline_gap.clearances(plan, poses, body)
    np.testing.assert_array_equal(each, everything)
    np.testing.assert_array_equal(least, everything.reshape(10, 30).min(axis=1))
