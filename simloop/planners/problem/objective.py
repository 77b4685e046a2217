"""The planners' objective: J = w1 S + w2 Theta + sigma sum R over a whole polyline.

Source: Sabiha 2022 (online TLBO), Eqs. 4-5, 12, 16. Three readings differ from print, each on
purpose. Eq. 6 is a difference of two atan2 and is wrapped to (-pi, pi]. Eq. 8 looks at the
waypoints only; here the clearance is that of every point of every segment. Eq. 17 needs the
centres of round obstacles; here R is the intrusion in metres, one term a segment: the safe
distance minus the segment's clearance, plus a centimetre, where the former is positive. Being
linear with steps, it is exact: no intrusion, however slight, is worth what it saves.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import NO_LENGTH_M, STACK, Problem, segment_clearance

LEAST_INTRUSION_M = 0.01
"""What the slightest lack of clearance counts on top of its depth, m: safe beats nearly safe."""
THROUGH_SHARE, THROUGH_M = 0.2, 3.0
"""With less than this share of the safe distance a segment leads through something, which counts
so many metres more: no way back out of a dead end is as dear."""


@njit(cache=True, forceinline=True)
def length_and_turning(path: FloatArray, m: int) -> tuple[float, float]:
    """S (Eq. 4) and Theta (Eq. 5, wrapped) of path[:m]; a segment without length has no heading."""
    length = 0.0
    turning = 0.0
    ux = 0.0
    uy = 0.0
    for i in range(m - 1):
        dx = path[i + 1, 0] - path[i, 0]
        dy = path[i + 1, 1] - path[i, 1]
        step = math.sqrt(dx * dx + dy * dy)
        if step > NO_LENGTH_M:
            length += step
            if ux != 0.0 or uy != 0.0:
                turning += abs(math.atan2(ux * dy - uy * dx, ux * dx + uy * dy))
            ux = dx
            uy = dy
    return length, turning


@njit(cache=True)
def start_turn(p: Problem, path: FloatArray, m: int) -> float:
    """Angle between the robot's heading and the first segment that has a length, rad."""
    for i in range(1, m):
        dx = path[i, 0] - p.start_x
        dy = path[i, 1] - p.start_y
        if abs(dx) + abs(dy) > NO_LENGTH_M:
            c = math.cos(p.start_yaw)
            s = math.sin(p.start_yaw)
            return abs(math.atan2(c * dy - s * dx, c * dx + s * dy))
    return 0.0


@njit(cache=True, forceinline=True)
def intrusion(p: Problem, path: FloatArray, m: int, enough: float, stack: FloatArray) -> float:
    """sum R: each segment's lack of clearance, where it lacks any, m.

    Stops adding once it exceeds ``enough``.
    """
    total = 0.0
    need = p.safe_m - p.tolerance_m
    for i in range(m - 1):
        floor = min(p.safe_m + LEAST_INTRUSION_M - (enough - total), need)
        clear = segment_clearance(
            p, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], need, floor, stack
        )
        if clear < need:
            total += p.safe_m - clear + LEAST_INTRUSION_M
            if clear < THROUGH_SHARE * p.safe_m:
                total += THROUGH_M
            if total > enough:
                return total
    return total


@njit(cache=True, forceinline=True)
def evaluate(p: Problem, path: FloatArray, m: int, bound: float, stack: FloatArray) -> float:
    """J of path[:m]; once J is sure to exceed ``bound``, some value above ``bound``.

    path: (>= m, 2). stack: scratch from `make_stack`. The obstacle term, the dear one, is left
    out where length and turning alone already lose.
    """
    p.trials[0] += 1
    length, turning = length_and_turning(path, m)
    cost = p.length_weight * length + p.turning_weight * turning
    if p.start_turn_weight > 0.0:
        cost += p.start_turn_weight * start_turn(p, path, m)
    if cost > bound:
        return cost
    return cost + p.penalty * intrusion(p, path, m, (bound - cost) / p.penalty, stack)


def make_stack() -> FloatArray:
    """Scratch for `segment_clearance` and `evaluate`."""
    return np.zeros((STACK, 3))
