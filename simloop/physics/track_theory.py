"""Closed forms of a tracked vehicle on firm ground: what the simulated tracks are held against.

Nothing of the simulator is used here. Symbols: L contact length, B gauge, W weight on the
ground, mu isotropic Coulomb friction, K shear modulus, i slip. SI units; x forward, y left.

Sources: Janosi & Hanamoto 1961 (shear curve); Wong, Theory of Ground Vehicles, Ch. 2, 6 (drawbar,
turning of tracked vehicles); Steeds 1950 and Merritt 1946 (Coulomb turning theory); Martinez et
al. 2005 (instantaneous centres of rotation, ICR); Dahl 1968 (the shear curve in rate form).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, root

from simloop.messages import FloatArray

_GRAVITY_MPS2 = 9.81


# --- Straight ahead: slip, drawbar


def ground_speed(radius_m: float, sprocket_radps: float, slip: float) -> float:
    """Forward speed, m/s: v = r w (1 - i). Form 1."""
    return radius_m * sprocket_radps * (1.0 - slip)


def shear_ratio(displacement_m: float, shear_modulus_m: float) -> float:
    """Shear stress over its limit after a displacement j: 1 - exp(-j / K) (Janosi-Hanamoto)."""
    return -math.expm1(-displacement_m / shear_modulus_m)


def drawbar_ratio(slip: float, length_m: float, shear_modulus_m: float) -> float:
    """Thrust of an evenly loaded belt over mu W at slip i: 1 - K/(iL) (1 - exp(-iL/K)). Form 5.

    The mean of ``shear_ratio`` with j = i x, x the way since the belt met the ground.
    """
    reach = slip * length_m / shear_modulus_m
    if abs(reach) < 1e-6:
        return 0.5 * reach
    return math.copysign(1.0 + math.expm1(-abs(reach)) / abs(reach), slip)


def drawbar_ratio_bilinear(slip: float, length_m: float, shear_modulus_m: float) -> float:
    """The same for the bilinear shear curve min(j / K, 1)."""
    reach = slip * length_m / shear_modulus_m
    return 0.5 * reach if reach <= 1.0 else 1.0 - 0.5 / reach


def slip_at_drawbar(ratio: float, length_m: float, shear_modulus_m: float) -> float:
    """The slip at which the belt pulls ``ratio`` (0 to 1) of mu W: ``drawbar_ratio`` inverted."""
    if ratio <= 0.0:
        return 0.0
    reach = brentq(lambda u: drawbar_ratio(u, 1.0, 1.0) - ratio, 0.0, 2.0 / (1.0 - ratio) + 2.0)
    return float(reach) * shear_modulus_m / length_m


# --- Turning


def sideways_moment(friction: float, weight_n: float, length_m: float) -> float:
    """Moment, N m, that turns an evenly loaded belt which slips sideways only: mu W L/4. Form 4."""
    return friction * weight_n * length_m / 4.0


def sideways_moment_of_supports(friction: float, weight_n: float, x_m: FloatArray) -> float:
    """The same for equal supports at x (n,): mu W mean|x|. Form 4."""
    return friction * weight_n * float(np.mean(np.abs(x_m)))


def spin_thrust_and_moment(a_m: float, length_m: float) -> tuple[float, float]:
    """Thrust and resisting moment of one track that turns on the spot, each over mu p. Form 2.

    a: distance of the track's instantaneous centre from its centre line, m; p: load per length.
    F = 2 a asinh(L/2a); m = (L/2) sqrt(a^2 + L^2/4) - a^2 asinh(L/2a).
    """
    half = 0.5 * length_m
    log = math.asinh(half / a_m)
    return 2.0 * a_m * log, half * math.hypot(a_m, half) - a_m * a_m * log


def spin_ratio(length_m: float, gauge_m: float) -> float:
    """chi = yaw rate over that of belts that do not slip, on the spot: B F = 2 m. Form 2."""

    def imbalance(a: float) -> float:
        thrust, moment = spin_thrust_and_moment(a, length_m)
        return gauge_m * thrust - 2.0 * moment

    a = float(brentq(imbalance, 1e-9 * gauge_m, 100.0 * gauge_m, xtol=1e-15))
    return gauge_m / (gauge_m + 2.0 * a)


def spin_ratio_of_supports(x_m: FloatArray, gauge_m: float) -> float:
    """The same for equal point supports at x (n,) a side: what n of them make of the integral."""

    def imbalance(a: float) -> float:
        size = np.hypot(a, x_m)
        return float(np.sum(gauge_m * a / size - 2.0 * x_m**2 / size))

    a = float(brentq(imbalance, 1e-9 * gauge_m, 100.0 * gauge_m, xtol=1e-15))
    return gauge_m / (gauge_m + 2.0 * a)


class Icr(NamedTuple):
    """Instantaneous centres of rotation in base_link: of the tracks (y) and of the vehicle (x)."""

    y_left_m: float
    y_right_m: float
    x_m: float


def icr_positions(
    velocity_xy: tuple[float, float], yaw_rate: float, belt_mps: tuple[float, float]
) -> Icr:
    """Where each belt has no slip along the vehicle, and where the vehicle has none across. Form 3.

    belt_mps: left, right. From v_x - omega y = V and v_y + omega x = 0; yaw_rate must not be 0.
    """
    v_x, v_y = velocity_xy
    return Icr((v_x - belt_mps[0]) / yaw_rate, (v_x - belt_mps[1]) / yaw_rate, -v_y / yaw_rate)


def icr_motion(icr: Icr, belt_mps: tuple[float, float]) -> tuple[float, float, float]:
    """v_x, v_y, yaw rate of a vehicle with these ICRs (Martinez et al. 2005, eq. 5-7). Form 3."""
    left, right = belt_mps
    span = icr.y_left_m - icr.y_right_m
    yaw_rate = (right - left) / span
    v_x = (right * icr.y_left_m - left * icr.y_right_m) / span
    return v_x, -icr.x_m * yaw_rate, yaw_rate


class Cells(NamedTuple):
    """Two belts cut into n equal cells each, front to rear: x (n,), loads_n (2, n) left, right."""

    x_m: FloatArray
    loads_n: FloatArray
    gauge_m: float
    cell_m: float

    @classmethod
    def even(cls, weight_n: float, length_m: float, gauge_m: float, count: int = 300) -> Cells:
        """An evenly loaded pair of belts, fine enough to stand for the integral."""
        cell = length_m / count
        x = 0.5 * length_m - cell * (np.arange(count, dtype=np.float64) + 0.5)
        return cls(x, np.full((2, count), weight_n / (2 * count)), gauge_m, cell)


def brush_shear(
    slip_mps: FloatArray, belt_mps: float, cell_m: float, shear_modulus_m: float
) -> FloatArray:
    """Mean shear (n, 2) over its limit in the cells of one belt that moves steadily.

    slip_mps: (n, 2) velocity of the belt over the ground in each cell, front to rear. Along the
    belt V dz/ds = v - |v| z / K from z = 0 where it meets the ground: for constant v this is the
    Janosi-Hanamoto curve; it is solved cell by cell exactly. With K = 0 it is Coulomb's law.
    """
    speed = np.hypot(slip_mps[:, 0], slip_mps[:, 1])
    limit = slip_mps / np.maximum(speed, 1e-300)[:, None]
    if shear_modulus_m == 0.0 or belt_mps == 0.0:
        return limit
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
    """F_x, F_y, N, and M_z, N m, of both tracks on a vehicle that moves with v_x, v_y, omega."""
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
    """v_x, v_y (at base_link's origin), yaw rate under two constant belt speeds. Form 3.

    Both tracks' slips are unknown; they follow from two force balances and one moment balance,
    with the centripetal force of the steady turn unless ``inertial`` is False (Steeds 1950). The
    centre of gravity lies at (centre_x_m, 0). Raises ArithmeticError if no balance is found.
    """
    left, right = belt_mps
    weight = float(cells.loads_n.sum())
    mass = weight / _GRAVITY_MPS2 if inertial else 0.0
    length, gauge = cells.cell_m * len(cells.x_m), cells.gauge_m
    scale = np.array([1.0, 1.0, 0.25 * length]) * friction * weight
    speed = max(abs(left), abs(right))

    def balance(unknown: FloatArray) -> FloatArray:
        motion = unknown * np.array([speed, speed, speed / gauge])
        v_x, v_y, yaw_rate = motion
        force = track_forces(motion, belt_mps, cells, friction, shear_modulus_m)
        a_x = -yaw_rate * v_y - yaw_rate**2 * centre_x_m
        a_y = yaw_rate * v_x
        force -= mass * np.array([a_x, a_y, centre_x_m * a_y])
        return force / scale

    chi = spin_ratio(length, gauge)
    for guess in (chi, 0.9 * chi, 0.7 * chi, 0.5 * chi, 0.3 * chi, 0.98):
        start = np.array([0.5 * (left + right), 0.0, guess * (right - left)]) / speed
        found = root(balance, start, tol=1e-11)
        if np.abs(balance(found.x)).max() < 1e-7:
            v_x, v_y, turn = found.x
            return float(v_x * speed), float(v_y * speed), float(turn * speed / gauge)
    raise ArithmeticError(f"no steady turn found for belts at {left:g} and {right:g} m/s")


# --- Slopes, braking, steps, tipping


def holding_angle(friction: float) -> float:
    """The steepest slope, rad, on which tracks that do not turn hold: atan(mu). Form 6."""
    return math.atan(friction)


def climbing_angle(
    thrust_n: float, weight_n: float, rolling_resistance: float, friction: float
) -> float:
    """The steepest slope, rad, climbed with a thrust at the sprockets' rims: form 6.

    sin(t) + f cos(t) = F/W; f is lost inside the track: the ground bears W sin(t) <= mu W cos(t).
    """
    size = math.hypot(1.0, rolling_resistance)
    by_thrust = math.asin(min(1.0, thrust_n / (weight_n * size))) - math.atan(rolling_resistance)
    return min(by_thrust, holding_angle(friction))


def sliding_acceleration(friction: float, pitch_rad: float = 0.0) -> float:
    """Downhill acceleration, m/s^2, of locked tracks: g (sin t - mu cos t); negative: braking."""
    return _GRAVITY_MPS2 * (math.sin(pitch_rad) - friction * math.cos(pitch_rad))


def tipping_angle(distance_m: float, height_m: float) -> float:
    """Slope, rad, where it tips over an edge ``distance_m`` from its centre of gravity. Form 6."""
    return math.atan2(distance_m, height_m)


def step_angle(height_m: float, radius_m: float) -> float:
    """Angle, rad, between the vertical and the normal of a wheel that meets a step's edge."""
    return math.acos(1.0 - height_m / radius_m)


def climbable_step(
    friction: float, radius_m: float, lever_m: float, rear_m: float, centre_height_m: float
) -> float:
    """The highest step, m, onto which driven front wheels can draw themselves off level ground.

    Plane statics at the instant of lifting: the front wheel (lever_m ahead of the centre of
    gravity) on the edge, the rearmost (rear_m behind) on the ground, both at their friction's
    limit: forces along x and z and moments about the centre of gravity balance. For equal levers
    and a low centre the edge's normal stands at
    t = 2 atan(mu) from the vertical at the highest step. At most the wheel's radius.
    """

    def margin(angle: float) -> float:
        sin, cos = math.sin(angle), math.cos(angle)
        push = friction * cos - sin  # of the edge, over N: along x
        lift = cos + friction * sin
        # Contact points about the centre of gravity; the edge lies ahead and above the ground.
        edge_x = lever_m + radius_m * sin
        edge_z = radius_m * (1.0 - cos) - centre_height_m
        # Unknown N at the edge and R at the rear with thrust T there: three balances for W = 1.
        balance = np.array(
            [
                [push, 0.0, 1.0],
                [lift, 1.0, 0.0],
                [edge_x * lift - edge_z * push, -rear_m, centre_height_m],
            ]
        )
        _, rear, thrust = np.linalg.solve(balance, [0.0, 1.0, 0.0])
        return float(friction * rear - thrust)

    steepest = 0.5 * math.pi
    angles = np.linspace(1e-6, steepest, 400)
    margins = [margin(angle) for angle in angles]
    for low, high, m_low, m_high in zip(angles, angles[1:], margins, margins[1:], strict=False):
        if m_low >= 0.0 > m_high:
            limit = float(brentq(margin, low, high))
            return radius_m * (1.0 - math.cos(limit))
    return radius_m if margins[0] >= 0.0 else 0.0


# --- Motors


def slipping_torque(friction: float, load_n: float, radius_m: float) -> float:
    """Torque, N m, at a stalled vehicle's sprocket when its track slips: mu N r. Form 7."""
    return friction * load_n * radius_m


def stall_force(
    voltage_v: float,
    resistance_ohm: float,
    torque_per_a: float,
    current_limit_a: float,
    friction_nm: float,
    radius_m: float,
) -> float:
    """Rim force, N, of a stalled motor: (k min(V/R, I_max) - gear friction) / r. Form 7."""
    current = min(abs(voltage_v) / resistance_ohm, current_limit_a)
    return max(0.0, torque_per_a * current - friction_nm) / radius_m


def motor_speed(
    voltage_v: float,
    load_nm: float,
    resistance_ohm: float,
    torque_per_a: float,
    back_emf: float,
) -> float:
    """Steady speed, rad/s, under a load that takes no more than the driver's limit of current."""
    return (voltage_v - resistance_ohm * load_nm / torque_per_a) / back_emf


# --- Loads


def support_loads(
    positions_m: FloatArray, weight_n: float, centre_xy_m: tuple[float, float]
) -> FloatArray:
    """Loads (n,) N of equal elastic supports at (n, 2) under a rigid chassis; they only push.

    Of all loads that balance the weight and its two moments, equal linear springs choose those of
    least norm, N = c0 + c1 x + c2 y; supports that would have to pull let go and the rest share.
    Raises ValueError if the centre lies outside the supports: it tips.
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
    raise ValueError("the centre of gravity is not above the supports")
