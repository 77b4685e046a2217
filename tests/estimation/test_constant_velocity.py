"""The constant-velocity filter: straight motion, prediction, and consistency over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from simloop.estimation.constant_velocity import ConstantVelocity

PERIOD_NS, PERIOD_S = 100_000_000, 0.1
SEEDS = 400
PLACE_STD_M, SPEED_STD_MPS, ACCELERATION_MPS2 = 0.04, 0.5, 1.0


def new_filter(place):
    return ConstantVelocity(np.array(place), 0, PLACE_STD_M, SPEED_STD_MPS, ACCELERATION_MPS2)


def test_it_learns_the_velocity_of_straight_motion():
    velocity = np.array([0.6, -0.3])
    point = new_filter([1.0, 2.0])
    for i in range(1, 30):
        point.predict(i * PERIOD_NS)
        point.update(np.array([1.0, 2.0]) + i * PERIOD_S * velocity)
    np.testing.assert_allclose(point.velocity, velocity, atol=0.02)
    ahead = point.place_at(34 * PERIOD_NS)
    np.testing.assert_allclose(ahead, point.place + 0.5 * point.velocity, atol=1e-12)


def test_asking_for_another_instant_changes_nothing():
    point = new_filter([1.0, 2.0])
    before = point.place.copy()
    point.place_at(10 * PERIOD_NS)
    np.testing.assert_array_equal(point.place, before)


def test_uncertainty_grows_without_sightings_and_shrinks_with_one():
    point = new_filter([0.0, 0.0])
    first = point.std_m
    assert first == pytest.approx(PLACE_STD_M)
    point.predict(3 * PERIOD_NS)
    grown = point.std_m
    point.update(np.zeros(2))
    assert grown > first > point.std_m


def test_nees_of_the_position_over_many_seeds_is_inside_its_band():
    """The truth follows the filter's model: constant random acceleration over each period."""
    values = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        place, velocity = np.zeros(2), SPEED_STD_MPS * rng.normal(size=2)
        point = new_filter(place + PLACE_STD_M * rng.normal(size=2))
        for i in range(1, 11):
            acceleration = ACCELERATION_MPS2 * rng.normal(size=2)
            place = place + velocity * PERIOD_S + 0.5 * acceleration * PERIOD_S**2
            velocity = velocity + acceleration * PERIOD_S
            point.predict(i * PERIOD_NS)
            point.update(place + PLACE_STD_M * rng.normal(size=2))
        values.append(np.sum((point.place - place) ** 2) / point.std_m**2)
    low, high = chi2.ppf([0.025, 0.975], 2 * len(values)) / len(values)
    assert low < np.mean(values) < high
