"""What lies about the map: free, and never said to be farther from a surface than it is."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.paths import view_of
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import Config, PlannerConfig, VehicleConfig
from simloop.messages import WorldView
from simloop.navigation.planner_world import RIM_M, with_free_rim
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner

seeds = st.integers(0, 2**32 - 1)


def cells_of(view):
    """(rows, cols, 2) the cells' centres, m."""
    rows, cols = view.distance_m.shape
    x = view.origin_m[0] + view.resolution_m * (np.arange(cols) + 0.5)
    y = view.origin_m[1] + view.resolution_m * (np.arange(rows) + 0.5)
    return np.stack(np.meshgrid(x, y), axis=-1)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_the_rim_is_never_farther_from_a_surface_than_said_and_the_inside_stays(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.95, 0.95, (rng.integers(1, 6), 2))
    view = view_of([(*p, 0.0) for p in points], size=2.0)
    wide = with_free_rim(view)
    rim = round(RIM_M / view.resolution_m)
    np.testing.assert_array_equal(wide.distance_m[rim:-rim, rim:-rim], view.distance_m)
    away = np.linalg.norm(cells_of(wide)[..., None, :] - points, axis=-1).min(axis=-1)
    assert (wide.distance_m <= away + 1e-5).all()
    # Nor much nearer: straight out from a cell the distance grows with the way, or the way's part.
    corner, edge = wide.distance_m[0, 0], view.distance_m[0, 0]
    assert corner == pytest.approx(np.hypot(edge, np.sqrt(2.0) * RIM_M), rel=1e-4)


def test_a_map_without_cells_stays_as_it_is():
    none = np.zeros(2)
    empty = WorldView(0, none, 0.05, np.empty((0, 0), np.float32), np.empty((0, 3)), np.zeros(4))
    assert with_free_rim(empty) is empty


def test_behind_a_wall_at_the_edge_of_the_map_there_is_a_way():
    """A dead end whose back is the last that was seen, and the goal behind it."""
    walls = [(x, s, 0.1) for x in np.arange(-1.0, 1.5, 0.1) for s in (-0.6, 0.6)]
    walls += [(1.4, y, 0.1) for y in np.arange(-1.5, 1.5, 0.05)]
    view = view_of(walls, size=3.0)
    planner = make_planner(PlannerConfig(), VehicleConfig())
    goal = np.array([4.0, 0.0])
    room = np.array([-6.0, -6.0, 6.0, 6.0])
    view = WorldView(0, view.origin_m, view.resolution_m, view.distance_m, view.discs_xyr_m, room)

    def plan_in(world):
        task = PlanningTask(world, np.zeros(3), goal, PlannerConfig().safe_distance_m)
        return planner.plan(task, np.random.default_rng(0))

    assert not plan_in(view).safe
    found = plan_in(with_free_rim(view))
    assert found.safe
    assert np.abs(found.waypoints_m[:, 1]).max() > 1.4  # and it is not through the wall
    assert Config().planner.safe_distance_m < RIM_M
