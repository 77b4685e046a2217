"""Turning and wheel loads against quadrature, tables, symmetries and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.track_forms import (
    even_cells,
    moment_of_supports,
    motion_of_icr,
    spin_ratio_of_supports,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from simloop.physics import track_theory as theory
from simloop.physics import turning_theory

lengths = st.floats(0.05, 2.0)
frictions = st.floats(0.1, 1.2)
WEIGHT, LENGTH, GAUGE = 98.1, 0.415, 0.39


@pytest.mark.parametrize(
    ("ratio", "chi"),
    [(0.7, 0.922), (1.0, 0.833), (1.25, 0.743), (1.5, 0.650), (1.7, 0.579), (2.0, 0.484),
     (2.5, 0.360), (0.415 / 0.39, 0.811)],
)  # fmt: skip
def test_spin_ratios_are_those_of_the_table(ratio, chi):
    assert turning_theory.spin_ratio(ratio, 1.0) == pytest.approx(chi, abs=6e-4)


@given(st.floats(0.005, 2.0), lengths)
def test_spin_thrust_and_moment_are_their_integrals(a, length):
    thrust, moment = turning_theory.spin_thrust_and_moment(a, length)
    half = length / 2
    assert thrust == pytest.approx(2 * quad(lambda x: a / math.hypot(a, x), 0, half)[0], rel=1e-7)
    area = quad(lambda x: x * x / math.hypot(a, x), 0, half)[0]
    assert moment == pytest.approx(2 * area, rel=1e-7)


@given(lengths, frictions)
def test_the_sideways_moment_is_that_of_many_supports(length, friction):
    x = (np.arange(4000) + 0.5) / 4000 * length - length / 2
    many = moment_of_supports(friction, WEIGHT, x)
    assert turning_theory.sideways_moment(friction, WEIGHT, length) == pytest.approx(many, rel=1e-6)


def test_supports_tend_to_the_belt():
    x = (np.arange(2000) + 0.5) / 2000 * LENGTH - LENGTH / 2
    many = spin_ratio_of_supports(x, GAUGE)
    assert many == pytest.approx(turning_theory.spin_ratio(LENGTH, GAUGE), rel=1e-5)


@given(st.floats(0.01, 2.0), st.integers(1, 40))
def test_the_brush_is_the_shear_curve_with_any_number_of_cells(slip, count):
    """Under an even slip the cells' mean is the belt's, exactly: few cells lose nothing."""
    rows = np.tile([-0.3 * slip, 0.0], (count, 1))
    shear = turning_theory.brush_shear(rows, 0.3, LENGTH / count, 0.001)
    assert -shear[:, 0].mean() == pytest.approx(theory.drawbar_ratio(slip, LENGTH, 0.001), rel=1e-9)


def test_the_brush_solves_its_differential_equation():
    """V dz/ds = v - |v| z / K along a belt whose slip turns: integrated by someone else."""
    belt, modulus, count = 0.3, 0.01, 2000
    x = LENGTH / 2 - LENGTH / count * (np.arange(count) + 0.5)

    def slip(x):
        return np.array([-0.02, 0.6 * x])

    shear = turning_theory.brush_shear(
        np.array([slip(at) for at in x]), belt, LENGTH / count, modulus
    )
    solved = solve_ivp(
        lambda s, z: (slip(LENGTH / 2 - s) - np.hypot(*slip(LENGTH / 2 - s)) * z / modulus) / belt,
        (0.0, LENGTH), [0.0, 0.0], rtol=1e-9, atol=1e-12, dense_output=True,
    )  # fmt: skip
    expected = solved.sol(LENGTH / 2 - x).T / modulus
    np.testing.assert_allclose(shear, expected, atol=2e-4)


@given(st.floats(0.7, 2.5), frictions, st.floats(0.05, 0.5))
@settings(max_examples=10)
def test_a_turn_on_the_spot_is_a_steady_turn(ratio, friction, speed):
    cells = even_cells(WEIGHT, ratio * GAUGE, GAUGE, 400)
    v_x, v_y, yaw_rate = turning_theory.steady_turn((-speed, speed), cells, friction)
    chi = yaw_rate * GAUGE / (2 * speed)
    assert chi == pytest.approx(turning_theory.spin_ratio(ratio * GAUGE, GAUGE), rel=1e-3)
    assert max(abs(v_x), abs(v_y)) < 1e-6


def test_a_slow_turn_does_not_know_friction_or_weight():
    solved = [
        turning_theory.steady_turn(
            (0.05, 0.2), even_cells(weight, LENGTH, GAUGE), mu, inertial=False
        )
        for weight, mu in ((50.0, 0.3), (500.0, 0.9))
    ]
    np.testing.assert_allclose(*solved, rtol=1e-6, atol=1e-12)


def test_turns_are_mirrored_and_scale_with_speed():
    cells = even_cells(WEIGHT, LENGTH, GAUGE)
    one = np.array(turning_theory.steady_turn((0.1, 0.2), cells, 0.6, inertial=False))
    other = np.array(turning_theory.steady_turn((0.2, 0.1), cells, 0.6, inertial=False))
    np.testing.assert_allclose(other, one * [1, -1, -1], rtol=1e-6, atol=1e-9)
    half = np.array(turning_theory.steady_turn((0.05, 0.1), cells, 0.6, inertial=False))
    np.testing.assert_allclose(half, one / 2, rtol=1e-6, atol=1e-9)


def test_a_soft_brush_slips_less_and_a_stiff_one_is_coulombs():
    cells = even_cells(WEIGHT, LENGTH, GAUGE)
    soft, stiff, coulomb = (
        turning_theory.steady_turn((0.15, 0.2), cells, 0.6, modulus)[2]
        for modulus in (0.01, 1e-5, 0.0)
    )
    assert soft > 1.02 * coulomb
    assert stiff == pytest.approx(coulomb, rel=1e-3)


def test_centres_of_rotation_and_motion_are_each_others_inverse():
    motion, belts = (0.13, -0.02, 0.4), (0.05, 0.21)
    icr = turning_theory.icr_positions(motion[:2], motion[2], belts)
    assert motion_of_icr(icr, belts) == pytest.approx(motion)
    assert icr.y_left_m > 0 > icr.y_right_m


grid = np.array([[x, y] for y in (0.2, -0.2) for x in (0.3, 0.1, -0.1, -0.3)])


@given(st.floats(-0.25, 0.25), st.floats(-0.18, 0.18))
def test_loads_balance_weight_and_moments(x, y):
    try:
        loads = turning_theory.support_loads(grid, 80.0, (x, y))
    except ValueError:
        return
    assert loads.min() >= -1e-9
    np.testing.assert_allclose(
        [loads.sum(), loads @ grid[:, 0], loads @ grid[:, 1]], [80, 80 * x, 80 * y], atol=1e-8
    )


@given(st.floats(-0.08, 0.08), st.floats(-0.05, 0.05))
def test_loads_are_those_of_least_norm(x, y):
    rows = np.vstack((np.ones(8), grid.T))
    least = np.linalg.pinv(rows) @ (80.0 * np.array([1.0, x, y]))
    if least.min() >= 0:
        np.testing.assert_allclose(
            turning_theory.support_loads(grid, 80.0, (x, y)), least, atol=1e-9
        )


def test_a_load_beyond_the_supports_tips():
    with pytest.raises(ValueError, match="not above"):
        turning_theory.support_loads(grid, 80.0, (0.35, 0.0))
