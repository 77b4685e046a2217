"""Clusters of a scan, and the tracks of what moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.disc_rooms import room_scan
from hypothesis import given
from hypothesis import strategies as st

from simloop.perception.mover_tracks import MoverTracker, find_clusters, label_clusters

SCAN_NS = 100_000_000
seeds = st.integers(0, 2**32 - 1)


def plain_groups(points, laser):
    """The slow, obvious version of ``label_clusters``: sets of points, neighbours all round."""

    def joined(i, k):
        return math.dist(points[i], points[k]) <= 0.12 + 0.03 * math.dist(points[i], laser)

    groups = [[0]]
    for i in range(1, len(points)):
        if joined(i - 1, i):
            groups[-1].append(i)
        else:
            groups.append([i])
    if len(groups) > 1 and joined(len(points) - 1, 0):
        groups[0] += groups.pop()
    return {frozenset(group) for group in groups}


@given(seeds, st.integers(1, 60))
def test_labels_are_those_of_the_plain_twin(seed, count):
    rng = np.random.default_rng(seed)
    bearing = np.sort(rng.uniform(-math.pi, math.pi, count))
    far = rng.choice([0.5, 0.6, 2.0], count)
    points = far[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    laser = rng.uniform(-0.1, 0.1, 2)
    label = label_clusters(points, laser)
    found = {frozenset(np.flatnonzero(label == k).tolist()) for k in set(label.tolist())}
    assert found == plain_groups(points, laser)


@given(seeds, st.integers(1, 4))
def test_clusters_are_compact_and_hold_their_points(seed, count):
    """Every moved point of a compact thing lies in a disc, and no disc is larger than allowed."""
    rng = np.random.default_rng(seed)
    bearing = rng.permutation(6)[:count] * math.pi / 3.0
    discs = [(1.5 * math.cos(b), 1.5 * math.sin(b), rng.uniform(0.1, 0.3)) for b in bearing]
    points = room_scan(np.zeros(2), discs)
    on_disc = np.array([any(math.dist(p, d[:2]) < d[2] + 1e-6 for d in discs) for p in points])
    clusters = find_clusters(points, np.zeros(2), on_disc)
    assert sum(cluster.moved for cluster in clusters) == on_disc.sum()
    for cluster in clusters:
        assert cluster.radius <= 0.75 * math.sqrt(2.0) + 1e-6
    for point in points[on_disc]:
        assert any(math.dist(point, c.centre) < c.radius + 1e-3 for c in clusters)


@pytest.mark.parametrize("speed", [0.15, 0.5])
def test_what_crosses_the_room_has_changed_and_its_track_has_its_velocity(speed):
    tracker, pose, laser = MoverTracker(), np.zeros(3), np.zeros(3)
    for k in range(40):
        x = -1.5 + speed * 0.1 * k
        points = room_scan(np.zeros(2), [(x, 1.5, 0.2), (-1.0, -1.0, 0.2)])
        theirs = tracker.update(points, laser, pose, k * SCAN_NS)
    assert theirs is not None
    assert np.hypot(*(points[theirs] - [x, 1.5]).T).max() < 0.35
    tracks = tracker.tracks
    assert tracks is not None
    assert len(tracks.number) == 1
    assert tracks.velocity_mps[0] == pytest.approx([speed, 0.0], abs=0.08)
    assert tracks.position_m[0] == pytest.approx([x, 1.5], abs=0.1)
    discs = tracker.discs_at(40 * SCAN_NS)
    assert discs is not None
    assert discs[0, :2] == pytest.approx(tracks.position_m[0] + 0.1 * tracks.velocity_mps[0])
    tracker.reset()
    assert tracker.tracks is None


def test_what_has_come_to_rest_is_the_maps_again():
    tracker, pose, laser = MoverTracker(), np.zeros(3), np.zeros(3)
    known = []
    for k in range(100):
        x = min(-1.5 + 0.04 * k, 0.0)
        theirs = tracker.update(room_scan(np.zeros(2), [(x, 1.5, 0.2)]), laser, pose, k * SCAN_NS)
        known.append(theirs is not None)
    assert all(known[10:40])
    assert not any(known[90:])


def test_two_that_touch_stay_two():
    tracker, pose, laser = MoverTracker(), np.zeros(3), np.zeros(3)
    for k in range(36):
        x = 1.0 - 0.045 * k
        # They pass each other with a hair between them.
        points = room_scan(np.zeros(2), [(-x, 1.2, 0.2), (x, 1.63, 0.2)])
        tracker.update(points, laser, pose, k * SCAN_NS)
        if k == 12:
            assert len(tracker.tracks.number) == 2
    assert tracker.tracks.radius_m.max() < 0.3


def test_clusters_end_where_neighbours_lie_apart():
    points = np.array([[1.0, 0.0], [1.0, 0.05], [1.0, 0.5], [1.0, 0.55], [2.0, 3.0]])
    assert label_clusters(points, np.zeros(2)).tolist() == [0, 0, 1, 1, 2]
    clusters = find_clusters(points, np.zeros(2), np.array([True, True, False, False, False]))
    assert [c.moved for c in clusters] == [2, 0, 0]
    assert clusters[0].centre == pytest.approx([1.0, 0.025], abs=1e-5)


def test_what_stops_keeps_its_pace_for_a_while():
    tracker, paces = MoverTracker(), []
    for k in range(80):
        x = 1.0 + 0.04 * min(k, 30)
        points = room_scan(np.zeros(2), [(x, 0.5, 0.2)])
        tracker.update(points, np.zeros(2), np.zeros(3), k * SCAN_NS)
        if tracker.tracks is not None:
            paces.append((k, float(tracker.tracks.pace_mps.max())))
    told = dict(paces)
    assert told[30] == pytest.approx(0.4, abs=0.08)
    assert told[34] > 0.2
    assert told[45] < 0.12


def test_after_a_reset_a_track_has_to_be_found_anew():
    tracker = MoverTracker()
    for k in range(20):
        points = room_scan(np.zeros(2), [(-1.0 + 0.05 * k, 1.5, 0.2)])
        tracker.update(points, np.zeros(2), np.zeros(3), k * SCAN_NS)
    assert tracker.discs_at(20 * SCAN_NS) is not None
    tracker.reset()
    assert tracker.tracks is None and tracker.discs_at(20 * SCAN_NS) is None
    points = room_scan(np.zeros(2), [(0.0, 1.5, 0.2)])
    assert tracker.update(points, np.zeros(2), np.zeros(3), 20 * SCAN_NS) is None


def test_a_scan_without_a_hit_has_no_clusters():
    nothing = np.empty((0, 2))
    known = [(np.array([1.0, 0.0]), 0.2)]
    assert find_clusters(nothing, np.zeros(2), np.zeros(0, bool)) == []
    assert find_clusters(nothing, np.zeros(2), np.zeros(0, bool), known) == []


def test_a_followed_mover_fades_while_nothing_is_seen():
    """Every beam is lost from one scan to the next: the track is kept a while, then dropped."""
    tracker, laser, pose = MoverTracker(), np.zeros(2), np.zeros(3)
    for k in range(25):
        points = room_scan(np.zeros(2), [(2.0 - 0.05 * k, 0.5, 0.2)])
        tracker.update(points, laser, pose, k * SCAN_NS)
    assert tracker.tracks is not None
    for k in range(25, 70):
        assert tracker.update(np.empty((0, 2)), laser, pose, k * SCAN_NS) is None
        if k == 25:
            assert tracker.tracks is not None
    assert tracker.tracks is None
