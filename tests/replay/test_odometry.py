"""Poses between the scans: carried by odometry, and not across its gaps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.geometry.se2 import between, compose, interpolate_xyt
from simloop.replay.odometry import IN_GAP, LOST, MEASURED, OUTSIDE, Odometry, OdometryTrack, carry
from simloop.replay.relations import relation_errors


def drive(n=200, step_s=0.1):
    """Times, and a smooth way with turns."""
    t_s = step_s * np.arange(n)
    yaw = np.cumsum(0.1 * np.sin(0.7 * t_s))
    speed = 0.5 * step_s
    x, y = np.cumsum(speed * np.cos(yaw)), np.cumsum(speed * np.sin(yaw))
    return t_s, np.column_stack([x, y, np.angle(np.exp(1j * yaw))])


def moved(poses, by):
    return np.array([compose(by, pose) for pose in poses])


def plain_carry(t_s, poses, odom_t_s, odom, when):
    """The pose at an instant strictly between two scans, the slow way."""

    def odom_at(t):
        k = min(max(int(np.searchsorted(odom_t_s, t, "right")), 1), len(odom_t_s) - 1)
        share = (t - odom_t_s[k - 1]) / (odom_t_s[k] - odom_t_s[k - 1])
        return np.array(interpolate_xyt(*odom[k - 1], *odom[k], share))

    k = int(np.searchsorted(t_s, when))
    ends = [compose(poses[i], between(odom_at(t_s[i]), odom_at(when))) for i in (k - 1, k)]
    return np.array(
        interpolate_xyt(*ends[0], *ends[1], (when - t_s[k - 1]) / (t_s[k] - t_s[k - 1]))
    )


def test_a_pose_between_two_scans_is_carried_by_the_odometry_lines():
    """The odometry is in another frame than the trajectory, and its scale is right."""
    t_s, truth = drive()
    odom = moved(truth, np.array([5.0, -3.0, 2.0]))
    scans = np.arange(0, 200, 40)  # 4 s apart
    when = np.array([0.05, 1.0, 3.95, 7.77, 15.99])
    found, why = carry(t_s[scans], truth[scans], [OdometryTrack(t_s, odom)], when)
    assert (why == MEASURED).all()
    expected = [np.interp(when, t_s, truth[:, k]) for k in (0, 1)]
    np.testing.assert_allclose(found[:, :2].T, expected, atol=1e-3)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_blend_is_that_of_the_plain_way(seed):
    rng = np.random.default_rng(seed)
    t_s, odom = drive()
    scans = np.sort(rng.choice(200, 12, replace=False))
    poses = rng.uniform(-3, 3, (12, 3))
    when = rng.uniform(t_s[scans[0]], t_s[scans[-1]], 30)
    found, why = carry(t_s[scans], poses, [OdometryTrack(t_s, odom)], when)
    assert (why == MEASURED).all()
    expected = np.array([plain_carry(t_s[scans], poses, t_s, odom, one) for one in when])
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-9)
    turned = found[:, 2] - expected[:, 2]
    np.testing.assert_allclose(np.angle(np.exp(1j * turned)), 0.0, atol=1e-9)


def test_a_gap_in_the_odometry_is_not_bridged():
    t_s, truth = drive()
    lines = (t_s <= 5.0) | (t_s >= 7.0)
    track = OdometryTrack(t_s[lines], truth[lines])
    scans = [0, 100, 199]  # the gap lies between the first two, at 0 and 10 s
    when = np.array([3.0, 5.0, 6.0, 6.99, 8.0, 10.0, 12.0, -0.1, 20.0])
    found, why = carry(t_s[scans], truth[scans], [track], when)
    assert why.tolist() == [MEASURED, MEASURED, IN_GAP, IN_GAP, *[MEASURED] * 3, OUTSIDE, OUTSIDE]
    np.testing.assert_allclose(found[[0, 4, 6]], truth[[30, 80, 120]], atol=1e-9)
    assert np.isnan(found[why != MEASURED]).all()


def test_the_ends_are_carried_on_for_as_long_as_the_longest_step_between_scans():
    t_s, truth = drive()
    track = OdometryTrack(t_s, truth)
    scans = [40, 60, 90]  # at 4, 6 and 9 s
    when = np.array([0.9, 1.1, 3.9, 9.1, 11.9, 12.1, math.nan])
    found, why = carry(t_s[scans], truth[scans], [track], when)
    assert why.tolist() == [OUTSIDE, *[MEASURED] * 4, OUTSIDE, OUTSIDE]
    np.testing.assert_allclose(found[1:5], truth[[11, 39, 91, 119]], atol=1e-9)
    _, why = carry(t_s[[40]], truth[[40]], [track], np.array([3.9, 4.0, 4.1]))
    assert why.tolist() == [OUTSIDE, MEASURED, OUTSIDE]


def test_the_scans_own_odometry_helps_out_in_a_gap_of_the_lines():
    t_s, truth = drive()
    scans = OdometryTrack(t_s, truth)
    lines = OdometryTrack(t_s[::150], truth[::150])  # 15 s apart
    _, why = carry(t_s, truth, [lines, scans], np.array([3.05, 6.01]))
    assert why.tolist() == [MEASURED, MEASURED]
    _, why = carry(t_s, truth, [OdometryTrack(t_s[:0], truth[:0])], np.array([3.05, 6.0]))
    assert why.tolist() == [IN_GAP, MEASURED]  # at the exact time of a scan the pose is the scan's


def test_there_is_no_pose_beside_a_scan_at_which_the_robot_is_lost():
    t_s, truth = drive(50)
    poses = truth.copy()
    poses[20] = math.nan
    when = np.array([1.95, 2.0, 2.05, 2.1])
    _, why = carry(t_s, poses, [OdometryTrack(t_s, truth)], when)
    assert why.tolist() == [LOST, LOST, LOST, MEASURED]


def test_poses_are_interpolated_across_short_gaps_only():
    t = np.array([0.0, 0.5, 3.0])
    poses = np.array([[0.0, 0, 3.1], [1.0, 0, -3.1], [9.0, 0, 0]])
    when = np.array([0.25, 0.5, 1.5, 3.0, -0.1, 3.1])
    found, why = carry(t, poses, [OdometryTrack(t, poses)], when)
    assert why.tolist() == [MEASURED, MEASURED, IN_GAP, MEASURED, OUTSIDE, OUTSIDE]
    np.testing.assert_allclose(found[[1, 3]], poses[[1, 2]], atol=1e-9)
    # Halfway of a turn over the shorter way.
    assert abs(found[0, 2]) == pytest.approx(math.pi) and 0.0 < found[0, 0] < 1.0


def test_lines_that_cannot_be_used_are_left_out():
    t_s, poses = np.array([0.0, 0.1, 0.1, math.nan, 9e9, 0.2, 0.3]), np.zeros((7, 3))
    poses[5] = [math.nan, 0.0, 0.0]
    assert Odometry((t_s,), poses).usable(0).t_s.tolist() == [0.0, 0.1, 0.3]


def test_relations_are_counted_by_what_became_of_them():
    t_s, truth = drive()
    lines = OdometryTrack(*(some[(t_s <= 5.0) | (t_s >= 7.0)] for some in (t_s, truth)))
    pairs = [(0.05, 3.0), (1.0, 6.0), (1.0, 12.0), (3.0, 99.0), (6.0, -1.0)]
    rows = []
    for a, b in pairs:
        ends = [np.array([np.interp(t, t_s, truth[:, k]) for k in range(3)]) for t in (a, b)]
        rows.append([a, b, *between(*ends)])
    found = relation_errors(t_s[::50], truth[::50], np.array(rows), [lines])
    assert (found.count, found.in_gaps, found.outside, found.lost) == (2, 2, 1, 0)
    assert found.translation_mean_m < 2e-3 and found.figures()["left_out"] == 3
    none = relation_errors(t_s[::50], truth[::50], np.array(rows[1:2]), [lines])
    assert none.translation_mean_m is None and none.count == 0
    with pytest.raises(InputError, match="another log"):
        relation_errors(t_s[::50], truth[::50], np.array([[90.0, 91.0, 0, 0, 0]]), [lines])
