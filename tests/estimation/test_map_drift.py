"""The bound of the map's drift: what is entered adds to it, and the way carries it along."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.estimation.map_drift import MapDrift

NOTHING = np.zeros((3, 3))


def drive(view_std, steps=100, share=0.1):
    """A straight way of 10 m, with scans whose fixes have this deviation in all directions."""
    drift = MapDrift()
    for i in range(steps + 1):
        drift.extend(np.array([0.1 * i, 0.0, 0.0]), view_std**2 * np.eye(3), share)
    return drift.deviations(NOTHING)


def test_the_first_scan_is_the_map_and_has_no_drift():
    drift = MapDrift()
    drift.extend(np.zeros(3), np.eye(3), 1.0)
    assert drift.deviations(NOTHING) == (0.0, 0.0)
    assert drift.deviations(np.diag([0.01, 0.04, 0.09])) == pytest.approx((0.2, 0.3))


def test_it_grows_with_new_ground_and_with_poor_fixes_only():
    assert drive(0.002, share=0.0) == (0.0, 0.0)
    near, far = drive(0.0008), drive(0.0002)
    assert near == pytest.approx(np.array(far) * 4.0)
    # Ten new views of one deviation, times three; the yaw's error swings the position aside.
    assert far[1] == pytest.approx(0.0002 * np.sqrt(3.0 * 10.0))
    assert far[0] > 3.0 * far[1]


def test_an_unheld_direction_counts_as_odometry_does():
    drift = MapDrift()
    for x in (0.0, 0.1):
        drift.extend(np.array([x, 0.0, 0.0]), np.diag([900.0, 1e-8, 1e-8]), 1.0)
    assert drift.deviations(NOTHING)[0] < 0.05


def test_a_robot_that_stands_or_does_not_turn_adds_what_odometry_may_err():
    drift, poor = MapDrift(), np.diag([0.02, 0.02, 0.01]) ** 2
    for _ in range(5):
        drift.extend(np.zeros(3), poor, 1.0)
    assert drift.deviations(NOTHING) == pytest.approx((0.001 * 12**0.5, 0.001 * 12**0.5))
    drift.extend(np.array([0.0, 0.0, 0.2]), poor, 1.0)
    assert drift.deviations(NOTHING)[1] > 0.017
