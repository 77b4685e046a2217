"""What counts as moved between scans."""

from __future__ import annotations

import math

import numpy as np
from helpers.disc_rooms import room_scan
from hypothesis import assume, given
from hypothesis import strategies as st

from simloop.perception.changes import BINS, ChangeDetector, mark_moved, nearest_ranges

seeds = st.integers(0, 2**32 - 1)


def bin_of(offset):
    """The plain twin's bin of a direction, 0 to 359 from bearing -pi."""
    return int((math.atan2(offset[1], offset[0]) / (2.0 * math.pi) + 0.5) * 360) % 360


def plain_nearest_ranges(points, laser):
    """The slow, obvious version of ``nearest_ranges``."""
    found = []
    for number in range(360):
        far = [math.dist(p, laser) for p in points if bin_of(p - laser) == number]
        found.append(min(far, default=math.inf))
    return np.array(found)


def plain_moved(points, laser, ranges):
    """The slow, obvious version of ``mark_moved``: one point and one rule after the other."""
    out = []
    for point in points:
        far, number = math.dist(point, laser), bin_of(point - laser)
        half = 2 + int(0.06 / max(far, 0.05) * 360 / (2.0 * math.pi))
        window = [ranges[(number + k) % 360] for k in range(-half, half + 1)]
        known = [r for r in window if math.isfinite(r)]
        passed = all(r > 1.02 * far + 0.10 for r in known)
        # The own direction must be free: an unknown one counts as free, where others are known.
        own = ranges[number] > 1.02 * far + 0.10
        out.append(far <= 7.0 and own and passed and len(known) >= 3)
    return np.array(out, bool)


def scan_of(rng, count):
    """Points at all bearings, of which some lie close together and some beyond 7 m."""
    bearing = rng.uniform(-math.pi, math.pi, count)
    far = rng.choice([0.3, 1.0, 3.0, 8.0], count) * rng.uniform(0.8, 1.2, count)
    return far[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)


@given(seeds, st.integers(0, 400))
def test_nearest_ranges_are_those_of_the_plain_twin(seed, count):
    rng = np.random.default_rng(seed)
    points, laser = scan_of(rng, count), rng.uniform(-0.5, 0.5, 2)
    found = nearest_ranges(points, laser)
    assert found.shape == (BINS,)
    np.testing.assert_allclose(found, plain_nearest_ranges(points, laser), rtol=1e-12)


@given(seeds, st.integers(1, 600), st.integers(1, 60))
def test_moved_points_are_those_of_the_plain_twin(seed, earlier, count):
    rng = np.random.default_rng(seed)
    laser = rng.uniform(-0.3, 0.3, 2)
    ranges = nearest_ranges(scan_of(rng, earlier), laser)
    points, moved = scan_of(rng, count), np.zeros(count, np.bool_)
    mark_moved(points, laser, ranges, moved)
    assert np.array_equal(moved, plain_moved(points, laser, ranges))


@given(seeds)
def test_what_is_marked_stays_marked(seed):
    """Several earlier scans vote one after the other, and one vote is enough."""
    rng = np.random.default_rng(seed)
    points, before = scan_of(rng, 50), rng.random(50) < 0.5
    moved = before.copy()
    mark_moved(points, np.zeros(2), np.full(BINS, 0.01), moved)
    assert np.array_equal(moved, before)


def test_nothing_has_moved_where_nothing_was_known():
    moved = np.zeros(1, np.bool_)
    mark_moved(np.array([[1.0, 0.0]]), np.zeros(2), np.full(BINS, np.inf), moved)
    assert not moved.any()


def test_after_a_reset_nothing_has_moved():
    detector = ChangeDetector()
    for _ in range(4):
        detector.detect(room_scan(np.zeros(2)), np.zeros(2))
    with_thing = room_scan(np.zeros(2), [(1.0, 0.0, 0.2)])
    assert detector.detect(with_thing, np.zeros(2)).any()
    detector.reset()
    assert not detector.detect(with_thing, np.zeros(2)).any()


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 0.05))
def test_what_stands_has_not_changed_wherever_it_is_seen_from(course, step):
    still = [(1.0, 1.0, 0.2), (-1.5, 0.5, 0.1), (0.5, -2.0, 0.3)]
    detector, centre = ChangeDetector(), np.zeros(2)
    for _ in range(30):
        centre = centre + step * np.array([math.cos(course), math.sin(course)])
        assume(all(math.dist(centre, d[:2]) > d[2] + 0.3 for d in still))
        assert not detector.detect(room_scan(centre, still), centre).any()
