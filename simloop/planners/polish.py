"""Local refinement of a taut polyline: its segments roll about what they touch.

A polygon about a round obstacle is stuck for moves of single waypoints, since both its segments
touch. What brings it down is to turn one segment about its contact while its two ends run along
their outer lines.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.bends import is_clear
from simloop.planners.objective import Problem, length_and_turning

_LEAST_STEP_M = 2e-3


@njit(cache=True)
def _local_cost(p: Problem, path: FloatArray, m: int, i: int) -> float:
    """J of the part of the path that moving points i and i + 1 changes."""
    first = max(i - 2, 0)
    last = min(i + 3, m - 1)
    length, turning = length_and_turning(path[first:], last - first + 1)
    return p.length_weight * length + p.turning_weight * turning


@njit(cache=True)
def _roll(
    p: Problem, path: FloatArray, m: int, i: int, step: float, old: FloatArray, stack: FloatArray
) -> bool:
    """Move point i by ``step`` along its incoming line and point i + 1 along its outgoing line,
    as far inwards as it goes. Keeps the move if it is clear and J falls."""
    a, b, c, d = path[i - 1], path[i], path[i + 1], path[i + 2]
    into = math.hypot(b[0] - a[0], b[1] - a[1])
    out = math.hypot(d[0] - c[0], d[1] - c[1])
    if step <= -0.95 * into or into < 1e-6 or out < 1e-6:
        return False
    before = _local_cost(p, path, m, i)
    for k in range(2):
        old[0, k] = b[k]
        old[1, k] = c[k]
    wx, wy = (c[0] - d[0]) / out, (c[1] - d[1]) / out
    b[0] += step * (old[0, 0] - a[0]) / into
    b[1] += step * (old[0, 1] - a[1]) / into
    # Outwards (positive) always clears in the end; 4 steps' worth bounds what can pay.
    reach = min(4.0 * abs(step), 0.95 * out)
    low, high = -reach, 4.0 * abs(step)
    c[0], c[1] = old[1, 0] + high * wx, old[1, 1] + high * wy
    clear = is_clear(p, b, c, stack)
    if clear:
        for _ in range(9):
            t = 0.5 * (low + high)
            c[0], c[1] = old[1, 0] + t * wx, old[1, 1] + t * wy
            if is_clear(p, b, c, stack):
                high = t
            else:
                low = t
        c[0], c[1] = old[1, 0] + high * wx, old[1, 1] + high * wy
        clear = _local_cost(p, path, m, i) < before - 1e-9
        clear = clear and p.low_x <= b[0] <= p.high_x and p.low_y <= b[1] <= p.high_y
        clear = clear and p.low_x <= c[0] <= p.high_x and p.low_y <= c[1] <= p.high_y
        clear = clear and is_clear(p, a, b, stack) and is_clear(p, c, d, stack)
    if not clear:
        for k in range(2):
            b[k] = old[0, k]
            c[k] = old[1, k]
    return clear


@njit(cache=True)
def polish(p: Problem, path: FloatArray, m: int, sweeps: int, stack: FloatArray) -> int:
    """Roll every inner segment both ways, each with a step of its own. Counts its trials."""
    old = np.empty((2, 2))
    trials = 0
    steps = np.empty(max(m, 1))
    for i in range(1, m - 2):
        steps[i] = 0.25 * math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        steps[i] = min(steps[i], 0.1)
    for _ in range(sweeps):
        moved = False
        for i in range(1, m - 2):
            if steps[i] < _LEAST_STEP_M:
                continue
            trials += 1
            if _roll(p, path, m, i, steps[i], old, stack):
                moved = True
                continue
            trials += 1
            if _roll(p, path, m, i, -steps[i], old, stack):
                moved = True
                continue
            steps[i] *= 0.5
            moved = moved or steps[i] >= _LEAST_STEP_M
        if not moved:
            break
    return trials
