"""The brush model of one belt cell: its shear grows with slip, saturates, and moves with the belt.

A belt's contact patch is cut into cells. The state of a cell is the mean shear displacement m of
its rubber, (along, across) the belt, m. It follows the slip velocity v of the belt over the ground.
The belt moves at speed V. It carries the displacement e_in of the cell upstream in, and the cell's
own displacement e at its downstream end out (l is the cell's length):

    dm/dt = v - |v| m / K - |V|/l (e - e_in),      F = -(mu N / K) (m + c dm/dt),  |F| <= mu N

The first two terms are Dahl's rate form of the Janosi-Hanamoto shear curve (Dahl 1968; Janosi &
Hanamoto 1961). The third term is transport. With u = |v| l / (|V| K), the outlet is
e = e_in + g(u) (m - e_in). The gain g(u), see `outlet_gain`, is that of the exact exponential
solution within the cell (exponential fitting). Therefore:

- a steady belt gives the Janosi-Hanamoto pull 1 - K/(iL) (1 - exp(-iL/K)) exactly, with any
  number of cells;
- a belt at rest holds like a spring.

The displacement is stored in the belt's own axes, so it turns with the vehicle. The damping c
vanishes in every steady motion. docs/tracks.md derives these equations.
"""

from __future__ import annotations

import math

from numba import njit

from simloop.messages import FloatArray


@njit(cache=True, error_model="numpy")
def outlet_gain(u: float) -> float:
    """Compute g(u): distance of the outlet from the inlet, over that of the mean from the inlet.

    g(u) = u (1 - exp -u) / (u - 1 + exp -u). It is 2 where the slip is negligible (pure transport,
    a linear profile) and 1 where the whole cell is saturated.

    Args:
        u: |v| l / (|V| K), the cell's slip in units of the shear modulus; 0 or more.

    Returns:
        The gain, 1 to 2.
    """
    # Both ends of the range use series expansions, because the quotient loses its digits there.
    if u < 1e-3:
        return 2.0 - u / 3.0
    if u > 40.0:
        return u / (u - 1.0)
    falls = math.exp(-u)
    return u * (1.0 - falls) / (u - 1.0 + falls)


@njit(cache=True, error_model="numpy")
def advance_cell(
    mean: FloatArray,
    outlet: FloatArray,
    rate: FloatArray,
    entering: FloatArray,
    slip: FloatArray,
    belt: float,
    cell: float,
    modulus: float,
    dt: float,
) -> None:
    """Advance the shear of one cell by one time step, in place.

    The step is the exact solution for a constant slip and a constant inflow. It is stable for any
    dt.

    Args:
        mean: (2,) mean shear displacement m, along and across the belt, m; updated.
        outlet: (2,) displacement e at the downstream end, m; written.
        rate: (2,) dm/dt over this step, m/s; written.
        entering: (2,) displacement e_in at the upstream end, m.
        slip: (2,) velocity v of the belt's surface over the ground, m/s.
        belt: speed V of the belt, m/s.
        cell: length l of the cell, m.
        modulus: shear modulus K, m.
        dt: time step, s.
    """
    # Rates of the linear equation dm/dt = v + gain flow e_in - decay m. A belt at rest has no
    # transport, so its gain does not matter.
    speed = math.hypot(slip[0], slip[1])
    flow = abs(belt) / cell
    gain = outlet_gain(speed / (flow * modulus)) if flow > 1e-9 else 1.0
    decay = speed / modulus + gain * flow
    # Exact step: (1 - exp(-decay dt)) / decay, which tends to dt where nothing decays.
    share = -math.expm1(-decay * dt) / decay if decay * dt > 1e-9 else dt
    size = 0.0
    for k in range(2):
        before = mean[k]
        mean[k] += share * (slip[k] + gain * flow * entering[k] - decay * before)
        rate[k] = (mean[k] - before) / dt
        outlet[k] = entering[k] + gain * (mean[k] - entering[k])
        size += outlet[k] * outlet[k]
    # The gain is that of the steady profile. A fast change can overshoot it, but rubber cannot be
    # strained beyond the limit K.
    if size > modulus * modulus:
        scale = modulus / math.sqrt(size)
        outlet[0] *= scale
        outlet[1] *= scale


@njit(cache=True, error_model="numpy")
def cell_force(
    mean: FloatArray, rate: FloatArray, modulus: float, damping: float, most: float
) -> tuple[float, float]:
    """Compute the force of one cell on the vehicle: F = -(mu N / K) (m + c dm/dt), at most mu N.

    Args:
        mean: (2,) mean shear displacement m, along and across the belt, m.
        rate: (2,) dm/dt, m/s.
        modulus: shear modulus K, m.
        damping: time constant c, s.
        most: the cell's friction limit mu N, N.

    Returns:
        Force along and across the belt, N.
    """
    along = -(mean[0] + damping * rate[0]) / modulus
    across = -(mean[1] + damping * rate[1]) / modulus
    size = math.hypot(along, across)
    scale = most if size <= 1.0 else most / size
    return along * scale, across * scale
