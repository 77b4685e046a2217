"""The weight study on data with a known answer."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.benchmarks.planners import weights
from simloop.benchmarks.planners.scenes import scene

pytest.importorskip("sklearn")


def test_the_pareto_front_of_known_points():
    points = np.array([[1.0, 4.0], [2.0, 2.0], [4.0, 1.0], [3.0, 3.0], [2.0, 2.0], [0.5, 0.5]])
    allowed = np.array([True, True, True, True, True, False])
    assert weights.pareto(points, allowed).tolist() == [True, True, True, False, True, False]


def test_two_hidden_factors_are_found_by_two_components():
    rng = np.random.default_rng(1)
    hidden = rng.normal(size=(38, 2))
    x = hidden @ rng.normal(size=(2, 4))
    found = weights.fit(x, hidden @ np.array([2.0, -1.0]))
    assert found.r2_x == pytest.approx(1.0) and found.r2_y == pytest.approx(1.0)
    assert found.q2 > 0.999


def test_noise_is_fitted_but_not_predicted():
    rng = np.random.default_rng(2)
    found = [weights.fit(rng.normal(size=(38, 4)), rng.normal(size=38)) for _ in range(20)]
    assert np.mean([one.r2_y for one in found]) > 0.03
    assert np.mean([one.q2 for one in found]) < 0.0


def test_the_important_variable_has_the_largest_vip():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(2000, 4))
    found = weights.fit(x, 3.0 * x[:, 1])
    assert found.vip[1] == pytest.approx(
        2.0, abs=0.02
    )  # the square root of the number of variables
    assert found.vip[[0, 2, 3]].max() < 0.15
    assert (found.vip**2).mean() == pytest.approx(1.0)


def test_the_study_trades_length_for_turning():
    done = weights.study(scene("S1")[0], "tlbo", 14)
    assert done.safe.all()
    # The more length weighs, the shorter the path and the more it turns.
    assert done.length_m[-1] < done.length_m[0] and done.turning_rad[-1] > done.turning_rad[0]
    assert np.allclose(done.cost, done.w1 * done.length_m + (1 - done.w1) * done.turning_rad)
    assert 2 <= done.front.sum() <= 14
    assert 0.0 < done.pls.q2 <= done.pls.r2_y <= 1.0
