"""Closed forms of a tracked vehicle that turns on firm ground, and the loads of its wheels.

The simulated tracks are tested against these forms. They use no code of the simulator. The forms
have the numbers of the table in docs/tracks.md.

Symbols: L contact length, B gauge, W weight on the ground, mu isotropic Coulomb friction, K shear
modulus, p load per length of belt. SI units; x forward, y left.

Sources: Steeds 1950 and Merritt 1946 (Coulomb turning theory); Wong, Theory of Ground Vehicles,
Ch. 6; Martinez et al. 2005 (instantaneous centres of rotation, ICR); Dahl 1968 (the shear curve in
rate form).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, root

from simloop.messages import FloatArray

_GRAVITY_MPS2 = 9.81


# --- On the spot


def sideways_moment(friction: float, weight_n: float, length_m: float) -> float:
    """Compute the moment that turns evenly loaded belts with sideways slip only: mu W L/4. Form 4.

    Args:
        friction: mu.
        weight_n: W on the belts, N.
        length_m: L, m.

    Returns:
        Moment, N m.
    """
    return friction * weight_n * length_m / 4.0


def spin_thrust_and_moment(a_m: float, length_m: float) -> tuple[float, float]:
    """Compute a track's thrust and resisting moment on the spot, each over mu p. Form 2.

    F = 2 a asinh(L/2a); m = (L/2) sqrt(a^2 + L^2/4) - a^2 asinh(L/2a).

    Args:
        a_m: distance a of the track's instantaneous centre from its centre line, m.
        length_m: L, m.

    Returns:
        F, m, and m, m^2.
    """
    half = 0.5 * length_m
    log = math.asinh(half / a_m)
    return 2.0 * a_m * log, half * math.hypot(a_m, half) - a_m * a_m * log


def spin_ratio(length_m: float, gauge_m: float) -> float:
    """Compute the yaw rate on the spot over that without slip: chi = B/(B + 2a), B F = 2 m. Form 2.

    Args:
        length_m: L, m.
        gauge_m: B, m.

    Returns:
        chi, 0 to 1.
    """

    def imbalance(a: float) -> float:
        thrust, moment = spin_thrust_and_moment(a, length_m)
        return gauge_m * thrust - 2.0 * moment

    a = float(brentq(imbalance, 1e-9 * gauge_m, 100.0 * gauge_m, xtol=1e-15))
    return gauge_m / (gauge_m + 2.0 * a)


# --- Centres of rotation


class Icr(NamedTuple):
    """Instantaneous centres of rotation in base_link.

    Attributes:
        y_left_m: y at which the left belt has no slip along the vehicle.
        y_right_m: y at which the right belt has no slip along the vehicle.
        x_m: x at which the vehicle has no slip across.
    """

    y_left_m: float
    y_right_m: float
    x_m: float


def icr_positions(
    velocity_xy: tuple[float, float], yaw_rate: float, belt_mps: tuple[float, float]
) -> Icr:
    """Compute the centres of rotation from v_x - omega y = V and v_y + omega x = 0. Form 3.

    Args:
        velocity_xy: v_x, v_y of base_link's origin, m/s.
        yaw_rate: omega, rad/s; not 0.
        belt_mps: V of the left and the right belt, m/s.

    Returns:
        The centres.
    """
    v_x, v_y = velocity_xy
    return Icr((v_x - belt_mps[0]) / yaw_rate, (v_x - belt_mps[1]) / yaw_rate, -v_y / yaw_rate)


# --- Steady turns


class Cells(NamedTuple):
    """Two belts, each cut into n equal cells, front to rear.

    Attributes:
        x_m: (n,) centres of the cells in base_link.
        loads_n: (2, n) loads, left and right.
        gauge_m: B.
        cell_m: length of a cell.
    """

    x_m: FloatArray
    loads_n: FloatArray
    gauge_m: float
    cell_m: float


def brush_shear(
    slip_mps: FloatArray, belt_mps: float, cell_m: float, shear_modulus_m: float
) -> FloatArray:
    """Compute the mean shear in the cells of one belt in steady motion.

    Along the belt, V dz/ds = v - |v| z / K from z = 0 where it meets the ground. For constant v
    this is the Janosi-Hanamoto curve. Each cell is solved exactly for its own v.

    Args:
        slip_mps: (n, 2) velocity v of the belt over the ground, along and across, in each cell from
            front to rear, m/s.
        belt_mps: V, m/s.
        cell_m: length of a cell, m.
        shear_modulus_m: K, m; 0: Coulomb's law.

    Returns:
        (n, 2) shear over its limit, along and across.
    """
    speed = np.hypot(slip_mps[:, 0], slip_mps[:, 1])
    limit = slip_mps / np.maximum(speed, 1e-300)[:, None]
    if shear_modulus_m == 0.0 or belt_mps == 0.0:
        return limit
    # From the end where the belt meets the ground: z = limit + (entering - limit) exp(-u s/l).
    order = range(len(speed)) if belt_mps > 0.0 else range(len(speed) - 1, -1, -1)
    entering, mean = np.zeros(2), np.empty_like(slip_mps)
    for k in order:
        u = speed[k] * cell_m / (abs(belt_mps) * shear_modulus_m)
        share = -math.expm1(-u) / u if u > 1e-9 else 1.0 - 0.5 * u
        mean[k] = limit[k] + (entering - limit[k]) * share
        entering = limit[k] + (entering - limit[k]) * math.exp(-u)
    return mean


def track_forces(
    motion: FloatArray,
    belt_mps: tuple[float, float],
    cells: Cells,
    friction: float,
    shear_modulus_m: float,
) -> FloatArray:
    """Compute the force and moment of both tracks on a vehicle in steady motion.

    Args:
        motion: (3,) v_x, v_y of base_link's origin, m/s, and yaw rate, rad/s.
        belt_mps: belt speeds, left and right, m/s.
        cells: the belts with their loads.
        friction: mu.
        shear_modulus_m: K, m.

    Returns:
        (3,) F_x, F_y, N, and M_z about base_link's origin, N m.
    """
    v_x, v_y, yaw_rate = motion
    total = np.zeros(3)
    for side, y in enumerate((0.5 * cells.gauge_m, -0.5 * cells.gauge_m)):
        along = np.full_like(cells.x_m, v_x - yaw_rate * y - belt_mps[side])
        slip = np.column_stack((along, v_y + yaw_rate * cells.x_m))
        shear = brush_shear(slip, belt_mps[side], cells.cell_m, shear_modulus_m)
        force = -friction * cells.loads_n[side][:, None] * shear
        moment = cells.x_m * force[:, 1] - y * force[:, 0]
        total += (force[:, 0].sum(), force[:, 1].sum(), moment.sum())
    return total


def steady_turn(
    belt_mps: tuple[float, float],
    cells: Cells,
    friction: float,
    shear_modulus_m: float = 0.0,
    centre_x_m: float = 0.0,
    inertial: bool = True,
) -> tuple[float, float, float]:
    """Compute the motion of a vehicle under two constant belt speeds (Steeds 1950). Form 3.

    The slips of both tracks are unknown. They follow from two balances of forces and one of
    moments.

    Args:
        belt_mps: belt speeds, left and right, m/s.
        cells: the belts with their loads.
        friction: mu.
        shear_modulus_m: K, m; 0: Coulomb's law.
        centre_x_m: x of the centre of gravity in base_link, m; its y is 0.
        inertial: whether to include the turn's centripetal force.

    Returns:
        v_x, v_y of base_link's origin, m/s, and yaw rate, rad/s.

    Raises:
        ArithmeticError: no balance is found.
    """
    left, right = belt_mps
    weight = float(cells.loads_n.sum())
    mass = weight / _GRAVITY_MPS2 if inertial else 0.0
    length, gauge = cells.cell_m * len(cells.x_m), cells.gauge_m
    # Unknowns and balances are scaled to the order of 1.
    scale = np.array([1.0, 1.0, 0.25 * length]) * friction * weight
    speed = max(abs(left), abs(right))

    def balance(unknown: FloatArray) -> FloatArray:
        motion = unknown * np.array([speed, speed, speed / gauge])
        v_x, v_y, yaw_rate = motion
        force = track_forces(motion, belt_mps, cells, friction, shear_modulus_m)
        # Acceleration of the centre of gravity in a steady turn.
        a_x = -yaw_rate * v_y - yaw_rate**2 * centre_x_m
        a_y = yaw_rate * v_x
        force -= mass * np.array([a_x, a_y, centre_x_m * a_y])
        return force / scale

    # The solver does not converge from every start, so several guesses of the spin ratio are tried.
    chi = spin_ratio(length, gauge)
    for guess in (chi, 0.9 * chi, 0.7 * chi, 0.5 * chi, 0.3 * chi, 0.98):
        start = np.array([0.5 * (left + right), 0.0, guess * (right - left)]) / speed
        found = root(balance, start, tol=1e-11)
        if np.abs(balance(found.x)).max() < 1e-7:
            v_x, v_y, turn = found.x
            return float(v_x * speed), float(v_y * speed), float(turn * speed / gauge)
    raise ArithmeticError(f"no steady turn found for belts at {left:g} and {right:g} m/s")


# --- Loads


def support_loads(
    positions_m: FloatArray, weight_n: float, centre_xy_m: tuple[float, float]
) -> FloatArray:
    """Compute the loads of equal elastic supports under a rigid chassis. Supports never pull.

    Of all loads that balance the weight and its two moments, equal linear springs have those of
    least norm, N = c0 + c1 x + c2 y. Supports that would have to pull are removed, and the others
    share the weight.

    Args:
        positions_m: (n, 2) positions of the supports, m.
        weight_n: weight, N.
        centre_xy_m: position of the centre of gravity above the supports, m.

    Returns:
        (n,) loads, N.

    Raises:
        ValueError: the centre is outside the supports, so the chassis tips.
    """
    active = np.ones(len(positions_m), bool)
    wanted = weight_n * np.array([1.0, *centre_xy_m])
    for _ in range(len(positions_m)):
        rows = np.column_stack((np.ones(active.sum()), positions_m[active]))
        gram = rows.T @ rows
        if active.sum() < 2 or np.linalg.cond(gram) > 1e12:
            break
        loads = np.zeros(len(positions_m))
        loads[active] = rows @ np.linalg.solve(gram, wanted)
        if loads.min() >= -1e-12 * weight_n:
            return loads
        active &= loads > 0.0
    raise ValueError("the centre of gravity is not above the supports, so the chassis tips")
