"""Trajectories against a reference: the figures of evo, and of plain formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simloop.evaluation.trajectories import (
    absolute_errors,
    aligned,
    compare,
    relative_errors,
    rms,
)
from simloop.geometry.se2 import between, compose

MOVED = np.array([4.0, -2.0, 2.5])


def wandering(rng, n=120, step_m=0.5):
    """A way of steps of half a metre."""
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(compose(poses[-1], np.array([step_m, 0.0, rng.normal(0.0, 0.2)])))
    return np.array(poses)


def moved(poses):
    return np.array([compose(MOVED, pose) for pose in poses])


def test_a_moved_trajectory_has_no_error():
    truth = wandering(np.random.default_rng(1))
    found = compare(truth, moved(truth))
    assert found.ate_rmse_m == pytest.approx(0.0, abs=1e-9) and found.poses == 120
    assert found.rpe_5m_median_m == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(np.exp(1j * aligned(moved(truth), truth)[:, 2]),
                               np.exp(1j * truth[:, 2]), atol=1e-9)  # fmt: skip


def test_errors_are_those_of_plain_formulas():
    rng = np.random.default_rng(2)
    truth = wandering(rng)
    noise = 0.05 * rng.standard_normal((120, 2))
    found = moved(truth)
    found[:, :2] += noise
    # The alignment takes away at most a little of the noise.
    errors = absolute_errors(truth, found)
    assert rms(errors) <= rms(np.hypot(*noise.T)) and rms(errors) > 0.9 * rms(np.hypot(*noise.T))
    plain = [
        np.hypot(*(between(between(truth[i], truth[i + 10]), between(found[i], found[i + 10])))[:2])
        for i in range(110)
    ]  # steps of half a metre: ten of them are 5 m
    errors_m = relative_errors(truth, found, 5.0)
    assert len(errors_m) == 111  # the last one over 4.5 m
    np.testing.assert_allclose(errors_m[:110], plain, atol=1e-9)
    figures = compare(truth, found).figures()
    assert figures["rpe_5m_median_m"] == pytest.approx(np.median(errors_m))
    assert figures["ate_max_m"] == pytest.approx(errors.max())


def test_scale_is_not_aligned():
    truth = wandering(np.random.default_rng(3))
    assert compare(truth, truth * [1.1, 1.1, 1.0]).ate_rmse_m > 0.1


@pytest.mark.parametrize("direction", [0.0, 1.0])
def test_straight_ways_and_ways_too_short_have_figures(direction):
    x = np.arange(8.0)
    line = np.column_stack([x * math.cos(direction), x * math.sin(direction), 0.0 * x + direction])
    found = compare(line, moved(line))
    assert found.ate_max_m == pytest.approx(0.0, abs=1e-9)
    assert found.rpe_5m_median_m == pytest.approx(0.0, abs=1e-9)
    assert found.rpe_20m_median_m is None


def test_a_robot_that_stands_has_no_error_over_a_way():
    still = np.zeros((5, 3))
    found = compare(still, still + MOVED)
    assert found.ate_rmse_m == pytest.approx(0.0, abs=1e-9) and found.rpe_5m_median_m is None


def test_poses_that_one_of_both_lacks_do_not_count():
    truth = wandering(np.random.default_rng(4))
    found, reference = moved(truth), truth.copy()
    found[:10], reference[5:20] = math.nan, math.nan
    assert compare(reference, found).poses == 100
    found[11:] = math.nan
    assert compare(truth, found) is None
