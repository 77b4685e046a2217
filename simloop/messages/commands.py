"""What the robot does, and what it says of that."""

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
    """It turns on the spot, as its path asks."""
    STOP = "stop"
    """It has no path."""
    ARRIVED = "arrived"
    """It stands within the goal's tolerance."""
    WAIT = "wait"
    """The watchdog lets it not drive."""
    HELD = "held"
    """Something that stands is in the way of what path tracking asks for."""
    YIELD = "yield"
    """Something that moves is."""
    DODGE = "dodge"
    """It gets out of the way of something that moves."""
    BACK_OFF = "back_off"
    """It was stuck, and frees itself."""
    DEGRADED = "degraded"
    """Its localisation is too poor to drive on."""
    LOST = "lost"
    """It does not know where it is."""


class RobotStatus(StrEnum):
    """What the robot says of its own mission."""

    DRIVING = "driving"
    ARRIVED = "arrived"
    """It believes that it stands within the goal's tolerance."""
    LOST = "lost"
    """It has not known where it is for too long to go on searching."""
    UNREACHABLE = "unreachable"
    """It takes its goal for closed off."""
    GAVE_UP = "gave_up"
    """It was stuck, and recovered in vain too often."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackCommand(BaseMessage):
    """What the motors are told for one period.

    Attributes:
        t_ns: Simulated time, ns.
        speed_mps: Forward speed that was chosen, m/s.
        yaw_rate_radps: Yaw rate that was chosen, rad/s.
        sprocket_radps: (2,) sprocket speeds that it takes, left and right, rad/s.
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
    """Something worth a line.

    Attributes:
        t_ns: Simulated time, ns.
        level: ``info`` or ``warning``.
        text: The line.
    """

    t_ns: int
    level: str
    text: str
