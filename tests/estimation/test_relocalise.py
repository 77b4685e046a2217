"""The search of the whole map: its kernels against plain twins, and what it believes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.rooms import Room, box
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import SlamConfig
from simloop.estimation.relocalise import (
    Place,
    SearchMap,
    best_place,
    candidates,
    explained,
    relocalise,
    same_place,
    score_everywhere,
)
from simloop.geometry.se2 import transform_points
from simloop.messages import PoseFix
from simloop.slam_grid import GridSlam

seeds = st.integers(0, 2**32 - 1)
SQUARE = box(-2, -2, 2, 2)
PLAIN = Room(*SQUARE)
UNIQUE = Room(*SQUARE, *box(0.6, 0.9, 1.5, 1.7), *box(-2.0, -1.0, -1.2, -0.8))
CELL = 0.1


def clear(best, other):
    return other.cost - best.cost >= 0.1


@pytest.mark.parametrize(
    ("places", "expected"),
    [
        ([], None),
        ([Place(0.3, False, "a")], None),
        ([Place(0.3, True, "a")], "a"),
        ([Place(0.5, True, "b"), Place(0.3, True, "a")], "a"),
        ([Place(0.35, True, "b"), Place(0.3, True, "a")], None),
        ([Place(0.35, False, "b"), Place(0.3, True, "a")], None),
        ([Place(0.5, True, "b"), Place(0.3, False, "a")], None),
        ([Place(0.35, True, "c"), Place(0.5, True, "b"), Place(0.3, True, "a")], None),
    ],
)
def test_the_best_place_must_fit_and_no_other_may_come_near(places, expected):
    assert best_place(places, clear) == expected


@given(seed=seeds)
@settings(max_examples=25)
def test_scores_are_those_of_looking_up_every_point(seed):
    rng = np.random.default_rng(seed)
    likelihood = rng.random((12, 15)).astype(np.float32)
    points, places = rng.uniform(-1, 1, (7, 2)), rng.uniform(-0.5, 2.0, (5, 2))
    headings, corner = rng.uniform(-3, 3, 4), rng.uniform(-0.3, 0.3, 2)
    scores = score_everywhere(points, places, headings, likelihood, *corner.tolist(), CELL)
    for p, h in np.ndindex(scores.shape):
        placed = transform_points(np.array([*places[p], headings[h]]), points)
        cells = np.floor((placed - corner) / CELL).astype(int)
        ok = np.all((cells >= 0) & (cells < [15, 12]), axis=1)
        expected = likelihood[cells[ok, 1], cells[ok, 0]].sum(dtype=float) / len(points)
        assert scores[p, h] == pytest.approx(expected, abs=1e-9)


def wall_map():
    """A wall along x = 2.05 m, and the distances to it; the robot looks along x."""
    rows, cols = 40, 40
    x = (np.arange(cols) + 0.5) * CELL
    return np.broadcast_to(np.abs(x - 2.05), (rows, cols)).astype(np.float32).copy()


@pytest.mark.parametrize(
    ("reach", "expected"),
    [
        (1.55, 1.0),  # it ends at the wall
        (1.0, 0.0),  # in free space
        (2.5, -1.0),  # behind the wall: looks through it
    ],
)
def test_a_point_is_explained_by_a_surface_and_spoken_against_by_one_in_its_way(reach, expected):
    pose = np.array([0.5, 2.0, 0.0])
    points = np.array([[reach, 0.0], [reach, 0.05]])
    assert explained(points, pose, wall_map(), 0.0, 0.0, CELL) == expected


def test_points_are_turned_with_the_pose():
    pose = np.array([0.5, 2.0, 0.5 * math.pi])
    points = np.array([[0.0, -1.55]])
    assert explained(points, pose, wall_map(), 0.0, 0.0, CELL) == 1.0


def mapped(room):
    slam = GridSlam(SlamConfig(), np.zeros(3))
    for i, pose in enumerate([(0.0, 0.0, 0.0), (-0.5, 0.5, 0.3), (0.3, -0.9, -0.5)] * 2):
        slam.insert(room.scan(np.array(pose), np.random.default_rng(i), i), np.array(pose))
    return slam


def search_map(slam):
    distance = slam.grid.distances()
    return SearchMap(slam.origin_m, slam.resolution_m, distance, slam.log_odds < 0.0)


def found(slam, room, true, seed=9):
    scan = room.scan(np.array(true), np.random.default_rng(seed), 10**9)
    spread = np.diag([0.05**2] * 3)

    def refine(pose):
        return slam.match(scan, np.array([10**9]), np.zeros((1, 3)), pose, spread)

    refine(np.array(true))  # deskews the scan
    return relocalise(slam.points_m, search_map(slam), refine)


@pytest.mark.parametrize(
    "true", [(0.3, -0.4, 0.2), (-1.2, 1.1, 2.0), (1.0, -1.2, -2.5), (-0.3, 0.2, math.pi)]
)
def test_it_finds_itself_where_no_two_places_look_alike(true):
    fix = found(mapped(UNIQUE), UNIQUE, true)
    assert fix is not None and fix.ok
    np.testing.assert_allclose(fix.pose[:2], true[:2], atol=0.02)
    assert abs(math.remainder(fix.pose[2] - true[2], 2 * math.pi)) < 0.02


def test_it_claims_no_place_where_four_look_alike():
    assert found(mapped(PLAIN), PLAIN, (0.4, -0.3, 0.2)) is None


def test_it_claims_no_place_with_a_scan_of_somewhere_else():
    elsewhere = Room(*box(-0.6, -3.0, 0.6, 3.0), (-0.6, 0.4, 0.1, 0.4))
    assert found(mapped(UNIQUE), elsewhere, (0.2, -0.4, 0.3)) is None


def test_candidates_are_free_apart_and_few():
    slam = mapped(UNIQUE)
    where = search_map(slam)
    points = UNIQUE.hits(np.array([0.3, -0.4, 0.2]), np.random.default_rng(0))
    poses = candidates(points, where)
    assert 0 < len(poses) <= 12
    for i, pose in enumerate(poses):
        assert not any(same_place(pose, other) for other in poses[:i])
        col, row = np.floor((pose[:2] - where.origin_m) / where.resolution_m).astype(int)
        assert where.free[row, col] and where.distance_m[row, col] > 0.2
    assert math.dist(poses[0][:2], (0.3, -0.4)) < 0.2


def test_without_a_free_place_there_is_no_candidate():
    empty = SearchMap(
        np.zeros(2), 0.05, np.full((9, 9), 5.0, np.float32), np.zeros((9, 9), np.bool_)
    )
    assert candidates(np.zeros((5, 2)), empty) == []
    assert (
        relocalise(np.zeros((5, 2)), empty, lambda pose: pytest.fail("nothing to refine")) is None
    )


def test_matches_that_are_not_ok_are_no_places():
    slam = mapped(UNIQUE)
    points = UNIQUE.hits(np.array([0.3, -0.4, 0.2]), np.random.default_rng(0))
    bad = relocalise(
        points, search_map(slam), lambda pose: PoseFix(0, pose.copy(), np.eye(3), 1.0, False)
    )
    assert bad is None
