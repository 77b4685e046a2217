"""The brush of a belt against its differential equation and the Janosi-Hanamoto curve."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from simloop.physics import track_theory as theory
from simloop.physics import turning_theory
from simloop.physics.brush import advance_cell, cell_force, outlet_gain

MODULUS, CELL = 0.001, 0.03


def steady(cells, slip, belt, seconds=6.0, dt=0.002):
    """Mean shear (cells, 2) m of a belt of cells under an even slip, run until steady."""
    mean, outlet, rate = np.zeros((cells, 2)), np.zeros((cells, 2)), np.zeros(2)
    for _ in range(round(seconds / dt)):
        entering = np.zeros(2)
        for k in range(cells):
            advance_cell(mean[k], outlet[k], rate, entering, slip, belt, CELL, MODULUS, dt)
            entering = outlet[k].copy()
    return mean


@pytest.mark.parametrize("slip", [0.0005, 0.005, 0.05, 0.9])
@pytest.mark.parametrize("cells", [1, 5])
def test_a_steady_belt_gives_the_janosi_hanamoto_pull(slip, cells):
    belt = 0.3
    mean = steady(cells, np.array([-slip * belt, 0.0]), belt)
    expected = theory.drawbar_ratio(slip, cells * CELL, MODULUS)
    assert -mean[:, 0].mean() / MODULUS == pytest.approx(expected, rel=1e-6)


def test_cells_of_a_turning_belt_are_those_of_theory():
    slips = np.column_stack((np.full(8, -0.004), np.linspace(-0.02, 0.02, 8)))
    mean, outlet, rate = np.zeros((8, 2)), np.zeros((8, 2)), np.zeros(2)
    for _ in range(4000):
        entering = np.zeros(2)
        for k in range(8):
            advance_cell(mean[k], outlet[k], rate, entering, slips[k], 0.2, CELL, MODULUS, 0.002)
            entering = outlet[k].copy()
    expected = turning_theory.brush_shear(slips, 0.2, CELL, MODULUS)
    np.testing.assert_allclose(mean / MODULUS, expected, atol=1e-6)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0.0, 2 * math.pi), st.floats(0.0, 1.0))
@settings(max_examples=50)
def test_a_standing_belt_follows_dahls_equation(v_x, v_y, angle, share):
    slip = np.array([v_x, v_y])
    start = share * MODULUS * np.array([math.cos(angle), math.sin(angle)])
    mean, rate = start.copy(), np.zeros(2)
    advance_cell(mean, np.zeros(2), rate, np.zeros(2), slip, 0.0, CELL, MODULUS, 0.004)
    solved = solve_ivp(
        lambda t, z: slip - np.hypot(*slip) * z / MODULUS, (0, 0.004), start, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(mean, solved.y[:, -1], atol=1e-8)
    np.testing.assert_allclose(rate, (mean - start) / 0.004, rtol=1e-9, atol=1e-12)


@given(st.floats(1e-9, 500.0))
def test_the_outlets_gain_is_that_of_the_exponential(u):
    """From its definition: e and m of z = 1 - exp(-s), where this is not lost in rounding."""
    if u > 1e-4:
        mean, end = 1 + math.expm1(-u) / u, -math.expm1(-u)
        assert outlet_gain(u) == pytest.approx(end / mean, rel=1e-4)
    assert 1.0 <= outlet_gain(u) <= 2.0


@given(
    st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3), st.floats(-2, 2), st.floats(-2, 2),
    st.floats(0, 100, allow_subnormal=False),  # a subnormal has not the digits that are asked for
)  # fmt: skip
def test_no_cell_gives_more_than_friction_allows(m_x, m_y, r_x, r_y, most):
    force = cell_force(np.array([m_x, m_y]), np.array([r_x, r_y]), MODULUS, 0.01, most)
    assert np.hypot(*force) <= most * (1 + 1e-12)


def test_the_force_opposes_the_shear():
    force = cell_force(np.array([5e-4, 0.0]), np.zeros(2), MODULUS, 0.01, 10.0)
    assert force == pytest.approx((-5.0, 0.0))
