"""The planners' objective: J = w1 S + w2 Theta + sigma sum R over a whole polyline.

Source: Sabiha 2022 (online TLBO), Eqs. 4-5, 12, 16. It differs on purpose from the paper in three
places:
- Eq. 6 is a difference of two atan2; here it is wrapped to (-pi, pi].
- Eq. 8 checks only the waypoints; here the clearance covers every point of every segment.
- Eq. 17 needs the centres of round obstacles. Here R is the intrusion in metres, one term per
  segment: the safe distance minus the segment's clearance, plus a centimetre, if the difference is
  positive.

The penalty is linear with steps and therefore exact: even a slight intrusion costs more than it
saves.

J also contains the turn from the robot's heading to the first segment, with its own weight
(``start_turn_weight``).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import NO_LENGTH_M, STACK, Problem, segment_clearance

LEAST_INTRUSION_M = 0.01
"""Extra intrusion of any unsafe segment, m: it makes a safe path better than a nearly safe one."""
THROUGH_SHARE, THROUGH_M = 0.2, 3.0
"""A segment with less clearance than this share of the safe distance goes through an obstacle. It
gets this many metres of extra intrusion: more than any way back out of a dead end costs."""


@njit(cache=True, forceinline=True)
def length_of(path: FloatArray, m: int) -> float:
    """Compute S (Eq. 4) of a path, to the last bit as `length_and_turning` does.

    Args:
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.

    Returns:
        Length, m.
    """
    length = 0.0
    for i in range(m - 1):
        dx = path[i + 1, 0] - path[i, 0]
        dy = path[i + 1, 1] - path[i, 1]
        step = math.sqrt(dx * dx + dy * dy)
        if step > NO_LENGTH_M:
            length += step
    return length


@njit(cache=True, forceinline=True)
def length_and_turning(path: FloatArray, m: int) -> tuple[float, float]:
    """Compute S (Eq. 4) and Theta (Eq. 5, wrapped) of a path.

    A segment without length has no heading and is skipped.

    Args:
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.

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
    """Compute the angle between the robot's heading and the first segment that has a length.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.

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
def plain_cost(p: Problem, path: FloatArray, m: int) -> float:
    """Compute J of a path without its obstacle term.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.

    Returns:
        The cost of the length and of all turns.
    """
    length, turning = length_and_turning(path, m)
    cost = p.length_weight * length + p.turning_weight * turning
    if p.start_turn_weight > 0.0:
        cost += p.start_turn_weight * start_turn(p, path, m)
    return cost


@njit(cache=True, forceinline=True)
def intrusion(p: Problem, path: FloatArray, m: int, enough: float, stack: FloatArray) -> float:
    """Compute sum R, the clearance that is missing on the segments.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.
        enough: Sum at which the computation may stop, m.
        stack: Scratch from `make_stack`.

    Returns:
        The sum, m; any value above ``enough`` once it exceeds ``enough``.
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
    """Compute J of a path; this counts as a trial.

    The obstacle term is expensive. It is skipped if length and turning alone exceed the bound.

    Args:
        p: The problem.
        path: (>= m, 2) waypoints, m.
        m: Number of waypoints.
        bound: Value of J above which the exact value does not matter.
        stack: Scratch from `make_stack`.

    Returns:
        J; any value above ``bound`` once J is certain to exceed ``bound``.
    """
    p.trials[0] += 1
    cost = plain_cost(p, path, m)
    if cost > bound:
        return cost
    return cost + p.penalty * intrusion(p, path, m, (bound - cost) / p.penalty, stack)


@njit(cache=True, forceinline=True)
def surely_above(room: float, penalty: float) -> float:
    """Compute a sum of intrusions that certainly costs more than ``room``, rounding included.

    Args:
        room: What the penalty may cost at most.
        penalty: Weight of the sum.

    Returns:
        The sum.
    """
    return room / penalty * (1.0 + 1e-12) + 1e-12


def make_stack() -> FloatArray:
    """Make the scratch array for the clearance of a segment.

    Returns:
        (STACK, 3) array; it carries nothing over from one call to the next.
    """
    return np.zeros((STACK, 3))
