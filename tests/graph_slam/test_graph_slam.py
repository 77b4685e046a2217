"""The mapper over long ways: graph, closures, odometry that lies, a place in a known map."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.ring import AHEAD, RING, mapped, rms, way_round, wheels
from helpers.rooms import ANGLES, Room, box
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.geometry.se2 import between, compose, wrap_angle
from simloop.graph_slam.map_localiser import MapLocaliser, relocalise
from simloop.graph_slam.pose_graph import Edge, PoseGraph, rotated_covariance
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.submap import meetings

CONFIG = MappingConfig()
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def once_round():
    poses = way_round()
    return mapped(poses, wheels(poses, np.random.default_rng(5), bias=0.03)), poses


def test_a_ring_closes_on_poor_odometry(once_round):
    """35 m with the heading drifting by 2 degrees a metre; half the turn in sight."""
    mapper, poses = once_round
    assert sum(edge.closure for edge in mapper.graph.edges) >= 2
    assert rms(mapper.trajectory(), poses) < 0.03
    assert mapper.unmatched == 0


def test_the_map_is_made_where_the_walls_are(once_round):
    mapper, _ = once_round
    surfaces = mapper.map().surfaces()
    a, b = np.split(RING.segments, 2, axis=1)
    along = b - a
    share = np.einsum("nsk,sk->ns", surfaces[:, None] - a, along) / np.sum(along**2, axis=1)
    feet = a + np.clip(share, 0, 1)[..., None] * along
    off = np.hypot(*np.moveaxis(feet - surfaces[:, None], -1, 0)).min(axis=1)
    assert np.quantile(off, 0.95) < 0.04


def test_wheels_that_take_backwards_for_forwards_do_not_lead_astray():
    poses = way_round(0.5)
    there_and_back = np.vstack([poses[:40], poses[38:8:-1], poses[9:60]])
    odom = [np.zeros(3)]
    for a, b in pairwise(there_and_back):
        motion = between(a, b)
        odom.append(compose(odom[-1], np.array([abs(motion[0]), motion[1], motion[2]])))
    mapper = mapped(there_and_back, np.array(odom), seed=3)
    assert rms(np.array(odom), there_and_back - there_and_back[0]) > 1.0
    assert rms(mapper.trajectory(), there_and_back) < 0.05


def test_a_bare_corridor_does_not_pretend_to_know_where_along_it():
    """Along it only odometry tells: the pose follows it, and the covariance grows."""
    corridor = Room((-60, -1, 60, -1), (-60, 1, 60, 1))
    poses = np.column_stack([np.arange(0, 6, 0.1), np.zeros(60), np.zeros(60)])
    odom = poses * [1.1, 1.0, 1.0]
    mapper = mapped(poses, odom, corridor)
    end = mapper.trajectory()[-1]
    assert end[0] == pytest.approx(odom[-1, 0], abs=0.15)
    assert abs(end[1]) < 0.02 and abs(end[2]) < 0.01
    covariance = mapper.graph.covariances()[-1]
    assert math.sqrt(covariance[0, 0]) > 0.1 > 5.0 * math.sqrt(covariance[1, 1])


def test_the_same_scans_give_the_same_map_to_the_bit():
    poses = way_round(0.3)
    odom = wheels(poses, np.random.default_rng(1))
    a, b = mapped(poses, odom), mapped(poses, odom)
    np.testing.assert_array_equal(a.trajectory(), b.trajectory())
    np.testing.assert_array_equal(a.map().log_odds, b.map().log_odds)


# ---- the graph


def ring_graph(rng, n=40, wrong=False):
    true = [np.array([3 * math.cos(a), 3 * math.sin(a), a + 0.5 * math.pi])
            for a in np.linspace(0, 2 * math.pi, n, endpoint=False)]  # fmt: skip
    graph, noise = PoseGraph(), np.diag([0.02, 0.02, 0.01]) ** 2
    graph.add_pose(true[0])
    for k in range(1, n):
        step = between(true[k - 1], true[k]) + rng.multivariate_normal(np.zeros(3), noise)
        graph.add_pose(compose(graph.poses[-1], step))
        graph.add_edge(Edge(k - 1, k, step, noise, False))
    for k in range(3):
        graph.add_edge(Edge(k, n - 1 - k, between(true[k], true[n - 1 - k]), 0.1 * noise, True))
    if wrong:
        graph.add_edge(Edge(2, n // 2, np.zeros(3), 0.1 * noise, True))
    return graph, np.array(true)


@pytest.mark.parametrize("wrong", [False, True])
def test_closures_bring_the_drift_home_and_a_wrong_one_is_outvoted(wrong):
    graph, true = ring_graph(np.random.default_rng(2), wrong=wrong)
    before = rms(np.array(graph.poses), true)
    assert graph.has_new_closures
    graph.optimise()
    assert not graph.has_new_closures
    assert rms(np.array(graph.poses), true) < 0.6 * before
    np.testing.assert_allclose(graph.poses[0], true[0], atol=1e-6)


def test_the_graphs_covariance_is_that_of_its_noise():
    """Errors of many noisy chains against what the graph says of itself (NEES, 3 degrees)."""
    values = []
    for seed in range(60):
        graph, true = ring_graph(np.random.default_rng(seed), n=12)
        graph.edges = [edge for edge in graph.edges if not edge.closure]
        graph.optimise()
        error = graph.poses[-1] - true[-1]
        error[2] = wrap_angle(error[2])
        values.append(error @ np.linalg.solve(graph.covariances()[-1], error))
    assert 2.4 < np.mean(values) < 3.7  # 95 % of the mean of 60 draws of chi-squared with 3


@given(seed=seeds)
@settings(max_examples=15)
def test_uncertainty_along_a_chain_is_the_sum_of_its_edges(seed):
    """The oracle: each edge's error carried to the end by itself."""
    rng = np.random.default_rng(seed)
    graph = PoseGraph()
    graph.add_pose(rng.uniform(-1, 1, 3))
    variances = []
    for k in range(8):
        step = np.array([0.5, *rng.uniform(-0.2, 0.2, 2)])
        covariance = np.diag(rng.uniform(1e-4, 1e-3, 3))
        graph.add_pose(compose(graph.poses[-1], step))
        graph.add_edge(Edge(k, k + 1, step, covariance, False))
        variances.append(np.diag(covariance))
    place, yaw = graph.uncertainty(0)
    for end in range(1, 9):
        total = sum(
            v[0] + v[1] + v[2] * math.dist(graph.poses[k][:2], graph.poses[end][:2]) ** 2
            for k, v in enumerate(variances[:end])
        )
        assert place[end] == pytest.approx(math.sqrt(total), rel=1e-9)
        assert yaw[end] == pytest.approx(math.sqrt(sum(v[2] for v in variances[:end])), rel=1e-9)


def test_a_covariance_is_turned_with_its_axes():
    long = np.diag([4.0, 1.0, 0.1])
    np.testing.assert_allclose(
        rotated_covariance(long, 0.5 * math.pi), np.diag([1.0, 4.0, 0.1]), atol=1e-12
    )


# ---- in a known map


@pytest.mark.parametrize("at", [0, 60, 130, 200])
def test_the_robot_finds_itself_in_the_whole_map(once_round, at):
    mapper, poses = once_round
    grid, rng = mapper.map(), np.random.default_rng(at)
    odom = wheels(poses[at : at + 30], rng)
    localiser, found = MapLocaliser(grid, CONFIG), []
    for pose, belief in zip(poses[at : at + 30], odom, strict=True):
        if localiser.step(RING.hits(pose, rng, angles=AHEAD), belief):
            found.append(math.dist(localiser.pose[:2], pose[:2]))
    assert found and max(found) < 0.1
    assert localiser.relocalised == 1


def test_where_two_places_look_alike_none_is_claimed():
    """A bare square looks the same from four headings; with a thing in it, from one."""
    rng, pose = np.random.default_rng(2), np.array([0.4, -0.3, 0.2])
    for room, told in ((Room(*box(-2, -2, 2, 2)), False),
                       (Room(*box(-2, -2, 2, 2), *box(0.6, 0.9, 1.5, 1.7)), True)):  # fmt: skip
        mapper = mapped(np.zeros((1, 3)), np.zeros((1, 3)), room, angles=ANGLES)
        grid = mapper.map()
        for _ in range(3):
            points = room.hits(np.zeros(3), rng)
            grid.insert(points, np.zeros_like(points), np.zeros(3))
        found = relocalise(grid, room.hits(pose, rng), replace(CONFIG, cluster_points=360))
        assert (found is not None) == told
        if told:
            np.testing.assert_allclose(found, pose, atol=0.03)


def test_it_says_that_it_is_lost_where_nothing_fits_and_finds_itself_again(once_round):
    """Carried off: what it sees is another part of the ring than where it believes to be."""
    mapper, poses = once_round
    grid, rng = mapper.map(), np.random.default_rng(4)
    localiser = MapLocaliser(grid, CONFIG, poses[20])
    for pose in poses[20:30]:
        assert localiser.step(RING.hits(pose, rng, angles=AHEAD), pose)
    lost = False
    carried = wheels(poses[150:200], rng)
    onto = compose(poses[30], between(carried[0], np.zeros(3)))
    for pose, odom in zip(poses[150:200], carried, strict=True):
        localiser.step(RING.hits(pose, rng, angles=AHEAD), compose(onto, odom))
        lost = lost or localiser.lost
    assert lost
    assert not localiser.lost
    assert math.dist(localiser.pose[:2], poses[199][:2]) < 0.1


def test_points_that_stand_in_free_space_speak_against_a_place(once_round):
    mapper, poses = once_round
    grid, rng = mapper.map(), np.random.default_rng(6)
    points = RING.hits(poses[50], rng, angles=AHEAD)
    right, known = meetings(grid, points, poses[50])
    wrong, _ = meetings(grid, points, poses[50] + [0.0, 0.4, 0.3])
    assert right > 0.95 and known > 0.9
    assert wrong < 0.6
