"""The planners' objective: J = w1 S + w2 Theta + sigma sum R over a whole polyline.

Source: Sabiha 2022 (online TLBO), Eqs. 4-5, 12, 16. It differs from print on purpose in three
places. Eq. 6 is a difference of two atan2 and is wrapped to (-pi, pi]. Eq. 8 judges the waypoints
only; here the clearance is that of every point of every segment. Eq. 17 needs the centres of round
obstacles; here R is the intrusion in metres, one term a segment: the safe distance minus the
segment's clearance, plus a centimetre, where the former is positive. The penalty is linear with
steps and therefore exact: no intrusion, however slight, is worth what it saves.

J also holds the turn from the robot's heading to the first segment, with a weight of its own
(``start_turn_weight``).
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
so many metres more: no way back out of a dead end is as costly."""


@njit(cache=True, forceinline=True)
def length_and_turning(path: FloatArray, m: int) -> tuple[float, float]:
    """Return S (Eq. 4) and Theta (Eq. 5, wrapped) of a path.

    A segment without length has no heading and is skipped.

    Args:
        path: (>= m, 2) waypoints, m.
        m: How many of them count.

    Returns:
        Length, m, and sum of the turns, rad.
    """
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
    """Return the angle between the robot's heading and the first segment that has a length.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: How many of them count.

    Returns:
        The angle, rad, 0 to pi.
    """
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
    """Return sum R: what the segments lack in clearance.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: How many of them count.
        enough: Sum at which adding may stop, m.
        stack: Scratch from `make_stack`.

    Returns:
        The sum, m; some value above ``enough`` once it exceeds that.
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
    """Return J of a path. Counts as a trial.

    The obstacle term is the costly one. It is left out where length and turning alone exceed the
    bound.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: How many of them count.
        bound: Value of J above which the exact one does not matter.
        stack: Scratch from `make_stack`.

    Returns:
        J; some value above ``bound`` once it is sure to exceed that.
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
    """Make the scratch that the clearance of a segment needs.

    Returns:
        (STACK, 3) array; its content means nothing between two calls.
    """
    return np.zeros((STACK, 3))
