"""Which end of the robot goes first along a path."""

from __future__ import annotations

import math

from simloop.control.collision_monitor import CollisionMonitor
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

_BEHIND_RAD = 0.5 * math.pi
_STILL_BEHIND_RAD = 1.2  # for a robot that already goes backwards: no changing to and fro
_TURN_ROOM_M = 0.02  # beyond the monitor's margin, before a turn is begun on the way


def rear_first(
    monitor: CollisionMonitor, pose: FloatArray, path_yaw: float, reverses: bool
) -> bool:
    """Decide which end of the robot goes first along a path.

    A path that leads behind is mostly taken after a turn on the spot. Where the corners would meet
    something in that turn, the robot follows the same path backwards, until there is room to turn.

    Args:
        monitor: What has been seen near the robot.
        pose: (3,) of base_link in map, m, m, rad.
        path_yaw: Heading of the path here, rad, in map.
        reverses: Whether the robot already goes backwards.

    Returns:
        True if the rear goes first.
    """
    turn = wrap_angle(path_yaw - float(pose[2]))
    if abs(turn) <= (_STILL_BEHIND_RAD if reverses else _BEHIND_RAD):
        return False
    return not monitor.can_turn(turn, pose, _TURN_ROOM_M if reverses else 0.0)
