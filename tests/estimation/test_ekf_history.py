"""The filter's history: which belief is found, and that rewriting is filtering anew."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.estimation.ekf_history import History
from simloop.estimation.ekf_model import GAUGE, INPUTS, STATES, predict_and_correct

DT, PERIOD_NS = 0.01, 10_000_000
GAUGE_M = 0.3
WALK = np.array([0.1, 1.0, 0.01, 2e-5, 0.015, 0.005, 0.005])
GATES = np.array([4.0, 18.0, 1e-4])


def first_belief():
    x = np.zeros(STATES)
    x[GAUGE] = 1.2
    return x, np.diag(np.array([0.01, 0.01, 0.01, 0.1, 0.1, 1e-3, 0.05, 0.02, 0.02]) ** 2)


def random_inputs(rng):
    return (*rng.uniform(-0.5, 0.5, 1), DT, *rng.uniform(-0.3, 0.3, 3), 1e-3, 1e-3, 1e-4, 0.0)


def filled(periods, capacity, seed=0):
    """A history, and all beliefs that were ever held."""
    rng, history = np.random.default_rng(seed), History(capacity)
    x, p = first_belief()
    history.start(0, x, p)
    beliefs, told = [(x, p)], []
    for i in range(1, periods + 1):
        row = history.push(i * PERIOD_NS, random_inputs(rng))
        x, p = predict_and_correct(x, p, row, WALK, GAUGE_M, GATES)
        history.keep(x, p)
        beliefs.append((x, p))
        told.append(row.copy())
    return history, beliefs, told


@pytest.mark.parametrize("periods", [3, 9, 10, 25])
def test_the_belief_at_or_before_an_instant_is_found(periods):
    history, beliefs, _ = filled(periods, 10)
    for i in range(max(0, periods - 9), periods + 1):
        for late_ns in (0, 1, PERIOD_NS - 1):
            row = history.find(i * PERIOD_NS + late_ns)
            x, p = history.belief(row)
            np.testing.assert_array_equal(x, beliefs[i][0])
            np.testing.assert_array_equal(p, beliefs[i][1])


def test_what_is_forgotten_is_not_found():
    history, _, _ = filled(25, 10)
    assert history.find(15 * PERIOD_NS) is None
    assert history.find(16 * PERIOD_NS) is not None
    history.start(7, *first_belief())
    assert history.find(6) is None and history.find(10**12) is not None


def test_beliefs_are_copies():
    history, beliefs, _ = filled(5, 10)
    x, p = history.belief(history.find(3 * PERIOD_NS))
    x[:], p[:] = 9.0, 9.0
    again = history.belief(history.find(3 * PERIOD_NS))
    np.testing.assert_array_equal(again[0], beliefs[3][0])
    np.testing.assert_array_equal(again[1], beliefs[3][1])


@pytest.mark.parametrize("at", [17, 20, 24, 25])
def test_rewriting_a_belief_is_filtering_anew_from_it(at):
    """The oracle: the same inputs, one after the other, from the new belief on."""
    history, beliefs, told = filled(25, 10)
    x, p = beliefs[at][0] + 0.01, 1.5 * beliefs[at][1]
    now = history.rewrite(history.find(at * PERIOD_NS), x.copy(), p.copy(), WALK, GAUGE_M, GATES)
    expected = {at: (x, p)}
    for i in range(at, 25):
        row = told[i].copy()
        x, p = predict_and_correct(x, p, row, WALK, GAUGE_M, GATES)
        expected[i + 1] = (x, p)
    np.testing.assert_array_equal(now[0], x)
    np.testing.assert_array_equal(now[1], p)
    for i, belief in expected.items():
        kept = history.belief(history.find(i * PERIOD_NS))
        np.testing.assert_array_equal(kept[0], belief[0])
        np.testing.assert_array_equal(kept[1], belief[1])


def test_a_row_holds_what_was_told_and_room_for_what_was_refused():
    history, _, _ = filled(1, 4)
    row = history.push(2 * PERIOD_NS, (1.0, DT, 0.1, 0.2))
    assert row.shape == (INPUTS,)
    np.testing.assert_array_equal(row[:4], [1.0, DT, 0.1, 0.2])
