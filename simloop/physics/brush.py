"""The brush of a belt: shear that grows with slip, saturates, and travels with the belt.

A belt's contact is cut into cells. In each, the mean shear displacement m of the rubber follows
the slip v of the belt over the ground, in Dahl's rate form of the Janosi-Hanamoto curve, while
the belt, at speed V, brings in what the cell upstream lets out and takes out its own e:

    dm/dt = v - |v| m / K - |V|/l (e - e_in),      F = -(mu N / K) (m + c dm/dt),  |F| <= mu N

With u = |v| l / (|V| K) the outlet e = e_in + g(u) (m - e_in), g(u) in ``outlet_gain``, is that of
the exact exponential solution within the cell (exponential fitting): so a steady belt gives the
Janosi-Hanamoto pull 1 - K/(iL) (1 - exp(-iL/K)) exactly, with any number of cells, and a belt that
stands holds like a spring. Displacements are (along, across) the belt, m, and stay with it: they
turn with the vehicle. c only damps: it vanishes in every steady motion.
"""

from __future__ import annotations

import math

from numba import njit

from simloop.messages import FloatArray


@njit(cache=True, error_model="numpy")
def outlet_gain(u: float) -> float:
    """g(u) = u (1 - exp -u) / (u - 1 + exp -u): 2 for pure transport, 1 where all is saturated."""
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
    """Advance one cell by dt in place: mean, outlet (2,) m, and the mean's rate (2,) m/s.

    entering: (2,) m, the outlet of the cell upstream; slip: (2,) m/s; belt: m/s; cell: length, m.
    The step is exact for a constant slip and inflow, so that it is stable for any dt.
    """
    speed = math.hypot(slip[0], slip[1])
    flow = abs(belt) / cell
    gain = outlet_gain(speed / (flow * modulus)) if flow > 1e-9 else 1.0
    decay = speed / modulus + gain * flow
    share = -math.expm1(-decay * dt) / decay if decay * dt > 1e-9 else dt
    size = 0.0
    for k in range(2):
        before = mean[k]
        mean[k] += share * (slip[k] + gain * flow * entering[k] - decay * before)
        rate[k] = (mean[k] - before) / dt
        outlet[k] = entering[k] + gain * (mean[k] - entering[k])
        size += outlet[k] * outlet[k]
    if size > modulus * modulus:  # fast changes overshoot; no rubber is strained beyond its limit
        scale = modulus / math.sqrt(size)
        outlet[0] *= scale
        outlet[1] *= scale


@njit(cache=True, error_model="numpy")
def cell_force(
    mean: FloatArray, rate: FloatArray, modulus: float, damping: float, most: float
) -> tuple[float, float]:
    """Force (along, across), N, on the vehicle of a cell whose limit is mu N = ``most``."""
    along = -(mean[0] + damping * rate[0]) / modulus
    across = -(mean[1] + damping * rate[1]) / modulus
    size = math.hypot(along, across)
    scale = most if size <= 1.0 else most / size
    return along * scale, across * scale
