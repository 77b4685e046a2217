"""Second ways to the closed forms of tracks, to hold the first ones against."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from simloop.physics.turning_theory import Cells, Icr


def shear_ratio(displacement_m, shear_modulus_m):
    """Janosi-Hanamoto shear over its limit after a displacement j: 1 - exp(-j / K)."""
    return -math.expm1(-displacement_m / shear_modulus_m)


def moment_of_supports(friction, weight_n, x_m):
    """Sideways turning moment, N m, of equal supports at x (n,): mu W mean|x|."""
    return friction * weight_n * float(np.mean(np.abs(x_m)))


def spin_ratio_of_supports(x_m, gauge_m):
    """chi of equal point supports at x (n,) a side: what n of them make of the integral."""

    def imbalance(a):
        size = np.hypot(a, x_m)
        return float(np.sum(gauge_m * a / size - 2.0 * x_m**2 / size))

    a = float(brentq(imbalance, 1e-9 * gauge_m, 100.0 * gauge_m, xtol=1e-15))
    return gauge_m / (gauge_m + 2.0 * a)


def motion_of_icr(icr: Icr, belt_mps):
    """v_x, v_y, yaw rate of a vehicle with these ICRs (Martinez et al. 2005, eq. 5-7)."""
    left, right = belt_mps
    span = icr.y_left_m - icr.y_right_m
    yaw_rate = (right - left) / span
    v_x = (right * icr.y_left_m - left * icr.y_right_m) / span
    return v_x, -icr.x_m * yaw_rate, yaw_rate


def even_cells(weight_n, length_m, gauge_m, count=300):
    """An evenly loaded pair of belts, fine enough to stand for the integral."""
    cell = length_m / count
    x = 0.5 * length_m - cell * (np.arange(count, dtype=np.float64) + 0.5)
    return Cells(x, np.full((2, count), weight_n / (2 * count)), gauge_m, cell)
