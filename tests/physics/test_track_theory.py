"""Drawbar, slopes, steps and motors against quadrature, balances and limits."""

from __future__ import annotations

import math

import pytest
from helpers.track_forms import shear_ratio
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from simloop.physics import track_theory as theory

WEIGHT, LENGTH = 98.1, 0.415


@given(st.floats(1e-5, 0.9), st.floats(1e-4, 0.05))
def test_drawbar_is_the_mean_of_the_shear_curve(slip, modulus):
    # In the variable j / K the whole curve is smooth, however steep it is along the belt.
    reach = slip * LENGTH / modulus
    breaks = [1.0, 10.0, 40.0]
    area = quad(lambda u: shear_ratio(u, 1.0), 0, reach, points=breaks, limit=200)[0]
    assert theory.drawbar_ratio(slip, LENGTH, modulus) == pytest.approx(area / reach, rel=1e-5)
    bilinear = quad(lambda u: min(u, 1.0), 0, reach, points=breaks, limit=200)[0]
    assert theory.drawbar_ratio_bilinear(slip, LENGTH, modulus) == pytest.approx(
        bilinear / reach, rel=1e-5
    )


@given(st.floats(1e-3, 0.99))
def test_slip_at_drawbar_inverts_the_curve(ratio):
    slip = theory.slip_at_drawbar(ratio, LENGTH, 0.001)
    assert theory.drawbar_ratio(slip, LENGTH, 0.001) == pytest.approx(ratio, rel=1e-6)


def test_drawbar_is_odd_and_small_slips_are_elastic():
    assert theory.drawbar_ratio(-0.1, 1.0, 0.01) == -theory.drawbar_ratio(0.1, 1.0, 0.01)
    assert theory.drawbar_ratio(1e-9, 1.0, 0.001) == pytest.approx(5e-7, rel=1e-6)


@given(st.floats(0.1, 1.0), st.floats(0.0, 0.2), st.floats(1.0, 200.0))
def test_the_climbing_angle_balances_the_forces(friction, rolling, thrust):
    angle = theory.climbing_angle(thrust, WEIGHT, rolling, friction)
    needed = WEIGHT * (math.sin(angle) + rolling * math.cos(angle))
    assert needed <= thrust * (1 + 1e-9)
    assert math.tan(angle) <= friction * (1 + 1e-9)
    assert (
        needed == pytest.approx(thrust)
        or math.tan(angle) == pytest.approx(friction)
        or (thrust > WEIGHT)
    )


def test_locked_tracks_hold_up_to_the_friction_angle():
    at_rest = theory.sliding_acceleration(0.6, theory.holding_angle(0.6))
    assert at_rest == pytest.approx(0.0, abs=1e-12)
    assert theory.sliding_acceleration(0.5) == pytest.approx(-0.5 * 9.81)
    assert theory.tipping_angle(0.2, 0.2) == pytest.approx(math.pi / 4)


@given(st.floats(0.1, 0.9))
def test_a_symmetric_vehicle_climbs_to_twice_the_friction_angle(friction):
    """Equal levers, forces' heights negligible: t = 2 atan(mu), a classical result."""
    height = theory.climbable_step(friction, 1e-6, 1.0, 1.0, 0.0)
    limit = 2 * math.atan(friction)
    assert height == pytest.approx(1e-6 * (1 - math.cos(min(limit, math.pi / 2))), rel=1e-3)


def test_motor_figures_by_hand():
    assert theory.stall_force(24.0, 2.0, 1.0, 5.0, 0.5, 0.05) == pytest.approx(90.0)
    assert theory.stall_force(4.0, 2.0, 1.0, 5.0, 0.5, 0.05) == pytest.approx(30.0)
    assert theory.motor_speed(10.0, 2.0, 2.0, 1.0, 1.5) == pytest.approx(4.0)
    assert theory.slipping_torque(0.5, 40.0, 0.05) == pytest.approx(1.0)
