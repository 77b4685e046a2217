"""Closed forms of a tracked vehicle on firm ground: drawbar, slopes, steps, motors.

The simulated tracks are tested against these forms. They use no code of the simulator. Turning and
wheel loads are in `turning_theory`. The forms have the numbers of the table in docs/tracks.md.

Symbols: L contact length, W weight on the ground, mu isotropic Coulomb friction, K shear modulus,
i slip, r sprocket radius. SI units; x forward, y left.

Sources: Janosi & Hanamoto 1961 (shear curve); Wong, Theory of Ground Vehicles, Ch. 2 and 6
(drawbar, motion of tracked vehicles).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

_GRAVITY_MPS2 = 9.81


# --- Straight ahead: slip, drawbar


def ground_speed(radius_m: float, sprocket_radps: float, slip: float) -> float:
    """Compute the speed of a vehicle that drives straight ahead: v = r w (1 - i). Form 1.

    Args:
        radius_m: r, radius of the sprockets, m.
        sprocket_radps: w, rad/s.
        slip: i of the belts.

    Returns:
        Speed, m/s.
    """
    return radius_m * sprocket_radps * (1.0 - slip)


def drawbar_ratio(slip: float, length_m: float, shear_modulus_m: float) -> float:
    """Compute an evenly loaded belt's thrust over mu W: 1 - K/(iL) (1 - exp(-iL/K)). Form 5.

    It is the mean over the belt of the Janosi-Hanamoto curve 1 - exp(-j/K) with the shear
    displacement j = i x, where x is the distance from the point where the belt meets the ground.

    Args:
        slip: i; negative where the belt brakes.
        length_m: L, m.
        shear_modulus_m: K, m.

    Returns:
        Thrust over mu W, -1 to 1.
    """
    reach = slip * length_m / shear_modulus_m
    # The first term of the series, because the form loses its digits here.
    if abs(reach) < 1e-6:
        return 0.5 * reach
    return math.copysign(1.0 + math.expm1(-abs(reach)) / abs(reach), slip)


def drawbar_ratio_bilinear(slip: float, length_m: float, shear_modulus_m: float) -> float:
    """Compute the thrust over mu W for the bilinear shear curve min(j / K, 1).

    Args:
        slip: i, 0 or more.
        length_m: L, m.
        shear_modulus_m: K, m.

    Returns:
        Thrust over mu W, 0 to 1.
    """
    reach = slip * length_m / shear_modulus_m
    return 0.5 * reach if reach <= 1.0 else 1.0 - 0.5 / reach


def slip_at_drawbar(ratio: float, length_m: float, shear_modulus_m: float) -> float:
    """Compute the slip at which a belt gives a thrust: the inverse of `drawbar_ratio`.

    Args:
        ratio: thrust over mu W, below 1.
        length_m: L, m.
        shear_modulus_m: K, m.

    Returns:
        Slip i; 0 for a ratio of 0 or less.
    """
    if ratio <= 0.0:
        return 0.0
    reach = brentq(lambda u: drawbar_ratio(u, 1.0, 1.0) - ratio, 0.0, 2.0 / (1.0 - ratio) + 2.0)
    return float(reach) * shear_modulus_m / length_m


# --- Slopes, braking, tipping, steps


def holding_angle(friction: float) -> float:
    """Compute the steepest slope on which blocked tracks hold: atan(mu). Form 6.

    Args:
        friction: mu.

    Returns:
        Angle, rad.
    """
    return math.atan(friction)


def climbing_angle(
    thrust_n: float, weight_n: float, rolling_resistance: float, friction: float
) -> float:
    """Compute the steepest slope a thrust climbs: sin t + f cos t = F/W, tan t <= mu. Form 6.

    The rolling resistance f is lost inside the track. Therefore the ground bears only W sin t.

    Args:
        thrust_n: F at the sprockets' rims, N.
        weight_n: W, N.
        rolling_resistance: f, drag over load.
        friction: mu.

    Returns:
        Angle t, rad.
    """
    size = math.hypot(1.0, rolling_resistance)
    by_thrust = math.asin(min(1.0, thrust_n / (weight_n * size))) - math.atan(rolling_resistance)
    return min(by_thrust, holding_angle(friction))


def sliding_acceleration(friction: float, pitch_rad: float = 0.0) -> float:
    """Compute the downhill acceleration of locked tracks: g (sin t - mu cos t). Form 6.

    Args:
        friction: mu.
        pitch_rad: slope t, rad.

    Returns:
        Acceleration, m/s^2; negative if the vehicle slows down.
    """
    return _GRAVITY_MPS2 * (math.sin(pitch_rad) - friction * math.cos(pitch_rad))


def tipping_angle(distance_m: float, height_m: float) -> float:
    """Compute the slope on which a vehicle tips over an edge of its contact: tan t = x/h. Form 6.

    Args:
        distance_m: x from the centre of gravity to the edge, along the ground, m.
        height_m: h of the centre of gravity, m.

    Returns:
        Angle t, rad.
    """
    return math.atan2(distance_m, height_m)


def climbable_step(
    friction: float, radius_m: float, lever_m: float, rear_m: float, centre_height_m: float
) -> float:
    """Compute the highest step that driven front wheels climb from level ground. Form 6.

    The balance is plane statics at the instant of lifting. The front wheel is on the step's edge
    and the rearmost wheel is on the ground. Both contacts are at the limit of friction. The forces
    along x and z and the moments about the centre of gravity balance. For equal levers and a low
    centre of gravity, the edge's normal at the highest step is at t = 2 atan(mu) from the vertical.

    Args:
        friction: mu.
        radius_m: radius of the wheels, m.
        lever_m: from the centre of gravity forward to the front wheel, m.
        rear_m: from the centre of gravity back to the rearmost wheel, m.
        centre_height_m: height of the centre of gravity, m.

    Returns:
        Height, m; at most the wheel's radius.
    """

    def margin(angle: float) -> float:
        """Compute the unused grip at the rear wheel over the weight; angle: the edge's normal."""
        sin, cos = math.sin(angle), math.cos(angle)
        # Force of the edge along x and z, over its normal force N.
        push = friction * cos - sin
        lift = cos + friction * sin
        # The edge, seen from the centre of gravity. It lies ahead and above the ground.
        edge_x = lever_m + radius_m * sin
        edge_z = radius_m * (1.0 - cos) - centre_height_m
        # Unknown: N at the edge, load and thrust at the rear. There are three balances for W = 1.
        balance = np.array(
            [
                [push, 0.0, 1.0],
                [lift, 1.0, 0.0],
                [edge_x * lift - edge_z * push, -rear_m, centre_height_m],
            ]
        )
        _, rear, thrust = np.linalg.solve(balance, [0.0, 1.0, 0.0])
        return float(friction * rear - thrust)

    # The first angle at which no margin is left, from a flat step upwards.
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
    """Compute the torque at a sprocket whose track slips under a vehicle at rest: mu N r. Form 7.

    Args:
        friction: mu.
        load_n: N on the track, N.
        radius_m: r of the sprocket, m.

    Returns:
        Torque, N m.
    """
    return friction * load_n * radius_m


def stall_force(
    voltage_v: float,
    resistance_ohm: float,
    torque_per_a: float,
    current_limit_a: float,
    friction_nm: float,
    radius_m: float,
) -> float:
    """Compute the rim force of a stalled motor: (k min(V/R, I_max) - friction) / r. Form 7.

    Args:
        voltage_v: V, of either sign, V.
        resistance_ohm: R, ohm.
        torque_per_a: k at the sprocket, N m/A.
        current_limit_a: I_max of the driver, A.
        friction_nm: friction of gear and track, N m.
        radius_m: r of the sprocket, m.

    Returns:
        Force, 0 N or more.
    """
    current = min(abs(voltage_v) / resistance_ohm, current_limit_a)
    return max(0.0, torque_per_a * current - friction_nm) / radius_m


def motor_speed(
    voltage_v: float,
    load_nm: float,
    resistance_ohm: float,
    torque_per_a: float,
    back_emf: float,
) -> float:
    """Compute the steady speed of a motor below the driver's current limit: (V - R T/k) / k_e.

    Args:
        voltage_v: V, V.
        load_nm: torque T at the output shaft, N m.
        resistance_ohm: R, ohm.
        torque_per_a: k, N m/A.
        back_emf: k_e, V s/rad.

    Returns:
        Speed of the output shaft, rad/s.
    """
    return (voltage_v - resistance_ohm * load_nm / torque_per_a) / back_emf
