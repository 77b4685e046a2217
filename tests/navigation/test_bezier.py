"""The smoother: continuous curvature, the start's heading, and clearance never given up."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers.paths import smooth, view_of
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import PlannerConfig, SmootherConfig, VehicleConfig
from simloop.geometry.distance_field import field_of
from simloop.geometry.se2 import wrap_angle
from simloop.navigation.bezier_smoother import (
    C4,
    Smoother,
    corner_controls,
    cubic_sample,
    fit_corners,
    sample_path,
)
from simloop.navigation.elastic_band import leg_cost, make_room
from simloop.planners.problem.clearance import make_problem, point_clearance
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner

VEHICLE, SAFE = VehicleConfig(), 0.26


turns = st.floats(-2.2, 2.2).filter(lambda turn: abs(turn) > 0.05)


@given(turns, st.floats(0.05, 1.0))
@settings(max_examples=60)
def test_a_corner_joins_with_equal_tangent_and_curvature(turn, cut):
    corner = np.zeros(2)
    a, b = np.array([-2.0, 0.0]), 2.0 * np.array([math.cos(turn), math.sin(turn)])
    controls = corner_controls(a, corner, b, cut)
    rows = np.empty((4, 4))
    for row, (half, t) in zip(rows, [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0)], strict=True):
        cubic_sample(controls[4 * half : 4 * half + 4], t, row)
    start, left, right, end = rows
    np.testing.assert_allclose(start, [-cut, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(end[2:], [turn, 0.0], atol=1e-7)
    np.testing.assert_allclose(left, right, atol=1e-6)
    sharpest = C4 * math.sin(abs(turn) / 2) / (cut * math.cos(turn / 2) ** 2)
    assert abs(left[3]) == pytest.approx(sharpest, rel=1e-3)


@given(st.lists(st.tuples(st.floats(0.4, 1.2), st.floats(-1.2, 1.2)), min_size=2, max_size=5))
@settings(max_examples=40)
def test_yaw_and_curvature_are_those_of_the_points(legs):
    points, heading = [np.array([-2.5, 0.0])], 0.0
    for length, turn in legs:
        heading = min(1.5, max(-1.5, heading + turn))
        points.append(points[-1] + length * np.array([math.cos(heading), math.sin(heading)]))
    first = points[1] - points[0]
    path = smooth(points, (*points[0], math.atan2(first[1], first[0])))
    steps = np.diff(path.xy_m, axis=0)
    chords = np.arctan2(steps[:, 1], steps[:, 0])
    middles = 0.5 * (path.yaw_rad[1:] + path.yaw_rad[:-1])
    gentle = np.abs(np.diff(path.yaw_rad)) < 0.2
    off = np.angle(np.exp(1j * (chords - middles)))
    assert np.abs(off[gentle]).max() < 0.03
    np.testing.assert_allclose(path.xy_m[0], points[0], atol=1e-9)
    np.testing.assert_allclose(path.xy_m[-1], points[-1], atol=1e-9)
    assert np.all(np.diff(path.arc_m) > 0)
    assert path.arc_m[-1] <= sum(leg[0] for leg in legs) + 1e-6


def test_it_starts_along_the_robots_heading():
    path = smooth([(0, 0), (2, 0)], (0, 0, 0.5))
    assert path.yaw_rad[0] == pytest.approx(0.5, abs=1e-6)
    assert path.curvature_1pm[0] == pytest.approx(0.0, abs=1e-6)


def test_a_heading_too_far_off_is_left_to_a_turn_on_the_spot():
    path = smooth([(0, 0), (2, 0)], (0, 0, 2.0))
    assert path.yaw_rad[0] == pytest.approx(0.0, abs=1e-9)


def test_corners_are_cut_less_beside_an_obstacle_and_clearance_is_kept():
    points = [(-2, -1), (0, -1), (0, 2)]
    free = smooth(points, (-2, -1, 0.0))
    inside = view_of([(-0.4, -0.6, 0.12)])  # in the corner's inside, the polyline keeps clear
    tight = smooth(points, (-2, -1, 0.0), inside)
    assert tight.safe
    assert np.abs(tight.curvature_1pm).max() > 1.1 * np.abs(free.curvature_1pm).max()
    for path in (free, tight):
        for offset in VEHICLE.footprint_offsets_m:
            disc = path.xy_m + offset * np.column_stack(
                (np.cos(path.yaw_rad), np.sin(path.yaw_rad))
            )
            gap = np.hypot(disc[:, 0] + 0.4, disc[:, 1] + 0.6) - 0.12
            if path is tight:
                assert gap.min() > SAFE - 0.005
    gap = np.hypot(free.xy_m[:, 0] + 0.4, free.xy_m[:, 1] + 0.6) - 0.12
    assert gap.min() < SAFE  # else this scene would test nothing


def test_a_lead_in_that_would_come_too_near_is_not_taken():
    wall = view_of([(0.2, 0.3, 0.05)])
    path = smooth([(0, 0), (2, 0)], (0, 0, 0.9), wall)
    assert smooth([(0, 0), (2, 0)], (0, 0, 0.9)).yaw_rad[0] == pytest.approx(0.9, abs=1e-6)
    assert path.yaw_rad[0] < 0.1
    assert path.clearance_m.min() >= 0.24  # what the plan's own start has


@given(st.integers(0, 10_000))
@settings(max_examples=40)
def test_the_band_never_costs_more_and_keeps_the_clearance_that_the_plan_has(seed):
    rng = np.random.default_rng(seed)
    view = view_of([(*rng.uniform(-2.0, 2.0, 2), rng.uniform(0.1, 0.3)) for _ in range(6)])
    points = np.vstack([(-2.5, -2.5), rng.uniform(-2.0, 2.0, (2, 2)), (2.5, 2.5)])
    field, offsets = field_of(view, outside="edge"), np.array(VEHICLE.footprint_offsets_m)
    band = make_room(points, field, offsets, SAFE, SAFE + 0.04)

    def cost(line):
        legs = [leg_cost(a, b, field, offsets, SAFE, SAFE + 0.04) for a, b in pairwise(line)]
        headings = [math.atan2(*(b - a)[::-1]) for a, b in pairwise(line)]
        turns = sum(abs(wrap_angle(b - a)) for a, b in pairwise(headings))
        return sum(legs) + 0.54 * turns

    np.testing.assert_array_equal(band[[0, -1]], points[[0, -1]])
    # Points put in beside obstacles change where a leg is looked at, hence the slack.
    assert cost(band) <= 1.03 * cost(points) + 0.05


def test_it_keeps_more_than_the_safe_distance_where_there_is_room():
    beside = view_of([(0.0, SAFE + 0.2, 0.2)])
    path = smooth([(-2, 0), (2, 0)], (-2, 0, 0.0), beside)
    assert path.clearance_m.min() > SAFE + 0.025
    assert path.arc_m[-1] < 4.01


def test_in_a_gap_it_goes_through_the_middle():
    gap = view_of([(0.0, SAFE + 0.20, 0.2), (0.0, -SAFE - 0.23, 0.2)])
    path = smooth([(-2, 0), (2, 0)], (-2, 0, 0.0), gap)
    middle = path.xy_m[int(np.argmin(np.abs(path.xy_m[:, 0]))), 1]
    assert path.safe
    assert middle == pytest.approx(-0.015, abs=0.012)


@pytest.mark.parametrize("x", [-2.0, 2.5, 2.85, 2.99, 3.2, 3.6])
def test_it_judges_clearance_as_the_planner_does_also_beyond_the_grid(x):
    """A wall that reaches the grid's border goes on outside; the grid ends at x = 3."""
    view = view_of([(cx, 0.0, 0.2) for cx in np.arange(1.0, 3.0, 0.1)])
    path = smooth([(x, -1.5), (x, 1.5)], (x, -1.5, math.pi / 2), view)
    problem = make_problem(view, np.array([x, -1.5, 0.0]), np.array([x, 1.5]), safe_m=SAFE)
    for k in range(0, len(path.xy_m), 5):
        ahead = np.array([math.cos(path.yaw_rad[k]), math.sin(path.yaw_rad[k])])
        discs = [path.xy_m[k] + offset * ahead for offset in VEHICLE.footprint_offsets_m]
        judged = min(point_clearance(problem, *disc) for disc in discs)
        assert path.clearance_m[k] == pytest.approx(judged, abs=1e-9)
    assert path.safe == (x < 0.0)


def test_a_start_too_close_is_judged_as_the_planner_judges_it():
    """The robot stands 5 cm too close to a disc: it may leave, but not come closer later on."""
    view, start = view_of([(0.0, 0.36, 0.15)]), np.zeros(3)
    task = PlanningTask(view, start, np.array([2.5, -0.5]), SAFE)
    plan = make_planner(PlannerConfig(), VEHICLE).plan(task, np.random.default_rng(0))
    path = Smoother(SmootherConfig(), VEHICLE).smooth(plan, view, start)
    assert plan.safe and path.clearance_m[0] < SAFE - 0.04
    assert path.safe
    again = view_of([(0.0, 0.36, 0.15), (*path.xy_m[-40], 0.05)])
    assert not Smoother(SmootherConfig(extra_room_m=0.0), VEHICLE).smooth(plan, again, start).safe


def test_an_unsafe_plan_makes_an_unsafe_path():
    path = smooth([(-2, 0), (2, 0)], (-2, 0, 0.0), view_of([(0.0, 0.1, 0.2)]))
    assert not path.safe
    assert path.clearance_m.min() < 0.01


@pytest.mark.parametrize("turn", [0.5, 0.9, 1.57])
@pytest.mark.parametrize("gap", [0.265, 0.27, 0.28, 0.3, 0.33, 0.36])
def test_every_cut_but_the_tightest_keeps_the_safe_distance(turn, gap):
    """A disc inside the corner, as far from both legs: the deeper the cut, the nearer."""
    points = np.array([[-2.0, 0.0], [0.0, 0.0], [2.0 * math.cos(turn), 2.0 * math.sin(turn)]])
    radius, least = 0.05, 0.05
    inwards = np.array([-math.sin(0.5 * turn), math.cos(0.5 * turn)])
    centre = (radius + gap) / math.cos(0.5 * turn) * inwards
    field = field_of(view_of([(*centre, radius)]), outside="edge")
    offsets = np.array(VEHICLE.footprint_offsets_m)
    cuts = fit_corners(points, field, offsets, SAFE, SAFE + 0.04, 1.0, least)
    assert cuts[0] == cuts[2] == 0.0 and cuts[1] >= least
    samples = sample_path(points, cuts, 0.005)
    ahead = np.column_stack([np.cos(samples[:, 2]), np.sin(samples[:, 2])])
    discs = samples[:, None, :2] + offsets[:, None] * ahead[:, None]
    clearance = np.hypot(*np.moveaxis(discs - centre, -1, 0)).min() - radius
    if cuts[1] > least:
        assert clearance >= SAFE - 2e-3  # the field's interpolation
    assert cuts[1] > least or gap < 0.3
