"""What the robot does, and what it reports about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from simloop.messages.base import BaseMessage, FloatArray


class Velocity(NamedTuple):
    """A velocity of base_link: forward speed, m/s, and yaw rate, rad/s, counter-clockwise."""

    speed_mps: float
    yaw_rate_radps: float


class Mode(StrEnum):
    """What the robot does with its tracks."""

    FOLLOW = "follow"
    """It follows its path."""
    TURN = "turn"
    """It turns on the spot, because its path requires it."""
    STOP = "stop"
    """It has no path."""
    ARRIVED = "arrived"
    """It stands within the goal's tolerance."""
    WAIT = "wait"
    """The watchdog does not allow it to drive."""
    HELD = "held"
    """A static obstacle is in the way of the motion that path tracking requests."""
    YIELD = "yield"
    """A moving obstacle is in the way of that motion."""
    DODGE = "dodge"
    """It evades a moving obstacle."""
    BACK_OFF = "back_off"
    """It was stuck, and frees itself."""
    DEGRADED = "degraded"
    """Its localisation is too poor to drive."""
    LOST = "lost"
    """It does not know its pose."""


class RobotStatus(StrEnum):
    """What the robot reports about its own mission."""

    DRIVING = "driving"
    ARRIVED = "arrived"
    """It believes that it stands within the goal's tolerance."""
    LOST = "lost"
    """It has searched for its pose for too long."""
    UNREACHABLE = "unreachable"
    """It believes that obstacles enclose the goal."""
    GAVE_UP = "gave_up"
    """It was stuck, and too many recoveries failed."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackCommand(BaseMessage):
    """The command to the motors for one period.

    Attributes:
        t_ns: Simulated time, ns.
        speed_mps: Selected forward speed, m/s.
        yaw_rate_radps: Selected yaw rate, rad/s.
        sprocket_radps: (2,) sprocket speeds for this motion, left and right, rad/s.
        voltage_v: (2,) motor voltages, V.
        mode: What the robot does.
    """

    t_ns: int
    speed_mps: float
    yaw_rate_radps: float
    sprocket_radps: FloatArray
    voltage_v: FloatArray
    mode: Mode


@dataclass(frozen=True, slots=True)
class Event:
    """A line for the log.

    Attributes:
        t_ns: Simulated time, ns.
        level: ``info`` or ``warning``.
        text: The line.
    """

    t_ns: int
    level: str
    text: str
