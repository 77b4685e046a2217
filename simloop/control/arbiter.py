"""Which end goes first: out of a place too narrow to turn round in, the rear.

A path that leads behind is mostly taken after a turn on the spot. Where the corners would meet
something in that turn, the robot follows the same path backwards, until there is room to turn.
"""

from __future__ import annotations

import math

from simloop.control.collision_monitor import CollisionMonitor
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

_BEHIND_RAD = 0.5 * math.pi
_STILL_BEHIND_RAD = 1.2  # for a robot that goes backwards: not to and fro
_ROOM_M = 0.02  # more than the monitor's margin, before a turn is begun on the way


def rear_first(
    monitor: CollisionMonitor, pose: FloatArray, path_yaw: float, reverses: bool
) -> bool:
    """Whether a robot at ``pose`` (3,) is to go backwards along a path with the heading
    ``path_yaw``, rad, in map. reverses: whether it does so already."""
    turn = wrap_angle(path_yaw - float(pose[2]))
    if abs(turn) <= (_STILL_BEHIND_RAD if reverses else _BEHIND_RAD):
        return False
    return not monitor.can_turn(turn, pose, _ROOM_M if reverses else 0.0)
