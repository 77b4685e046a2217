"""A fan of arcs: what stands and moves on them, and what they are worth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.control.collision_monitor import examine_arc
from simloop.control.separation import least_gap, stays_clear
from simloop.messages import FloatArray

GAP, FREE, ROOM, END_X, END_Y = range(5)  # columns of what `examine_fan` finds


class Weights(NamedTuple):
    """What counts when arcs are compared; all in metres of worth.

    Attributes:
        gap: Of a metre to what moves, as predicted, as far as that counts.
        asked: Of a m/s nearer to the velocity that is asked for.
        room: Of a metre of room to what stands, up to 8 cm.
        way: Of a metre of free way, wherever it leads.
        nearer: Of a metre nearer to the path's next part.
    """

    gap: float
    asked: float
    room: float
    way: float
    nearer: float


EVADE = Weights(gap=1.0, asked=0.1, room=0.0, way=0.0, nearer=0.0)
GET_FREE = Weights(gap=0.0, asked=0.0, room=1.0, way=0.1, nearer=0.3)


@njit(cache=True)
def examine_fan(
    fan: FloatArray, points: FloatArray, limits: FloatArray, duration: float
) -> FloatArray:
    """Examine the arcs of a fan among what stands.

    Args:
        fan: (m, 2) velocities, m/s and rad/s.
        points: (n, 2) what stands, m, in base_link.
        limits: (6,) as in `collision_monitor.stoppable_part`.
        duration: Of the arcs, s.

    Returns:
        (m, 5) gap to what moves (not looked at: infinite), free part of the arc, most room on it,
        m, and the end of its free part in base_link, m.
    """
    found = np.empty((fan.shape[0], 5))
    for i in range(fan.shape[0]):
        ahead, turned = fan[i, 0] * duration, fan[i, 1] * duration
        free, room = examine_arc(points, ahead, turned, limits)
        found[i, GAP], found[i, FREE], found[i, ROOM] = np.inf, free, room
        # The chord's heading is half of the turn.
        found[i, END_X] = free * ahead * math.cos(0.5 * free * turned)
        found[i, END_Y] = free * ahead * math.sin(0.5 * free * turned)
    return found


@njit(cache=True)
def predict_gaps(
    pose: FloatArray,
    last: FloatArray,
    fan: FloatArray,
    movers: FloatArray,
    threats: FloatArray,
    mover_limits: FloatArray,
    window: FloatArray,
    horizon: float,
) -> FloatArray:
    """Predict how near what moves comes to a robot that goes over to each velocity of a fan.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        last: (2,) velocity of the last period, m/s and rad/s.
        fan: (m, 2) velocities, m/s and rad/s.
        movers: (k, 8) as in `separation.mover_discs`: the robot must be able to stop for them.
        threats: (t, 8) the same, of what may come: the robot keeps away from it.
        mover_limits: (7,) as in `separation.stays_clear`.
        window: (2,) accelerations, m/s^2 and rad/s^2.
        horizon: How far ahead to predict, s.

    Returns:
        (m,) least gaps, m; -inf for a velocity from which the robot could not stop in time.
    """
    gaps = np.empty(fan.shape[0])
    half = mover_limits[3:5]
    for i in range(fan.shape[0]):
        if stays_clear(pose, fan[i, 0], fan[i, 1], movers, mover_limits):
            gaps[i] = least_gap(pose, last, fan[i], window, threats, half, horizon)
        else:
            gaps[i] = -np.inf
    return gaps
