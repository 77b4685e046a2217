"""The typed messages between the parts of the loop.

Conventions: SI units, radians, yaw counter-clockwise, x forward, z up (REP-103);
frames map -> odom -> base_link -> laser/imu (REP-105). ``t_ns`` is simulated time
in integer nanoseconds. Arrays inside a message are read-only.
"""

from __future__ import annotations

from simloop.messages.base import BaseMessage, FloatArray
from simloop.messages.beliefs import (
    Estimate,
    Frames,
    Health,
    HealthReason,
    HealthState,
    LowObstacles,
    MapUpdate,
    MoverTracks,
    PoseFix,
)
from simloop.messages.commands import Event, Mode, RobotStatus, TrackCommand, Velocity
from simloop.messages.plans import Plan, SmoothPath, WorldView
from simloop.messages.readings import (
    DepthImage,
    EncoderReading,
    GoalReading,
    ImuReading,
    LidarScan,
    Readings,
    pixel_slopes,
)

__all__ = [
    "BaseMessage",
    "DepthImage",
    "EncoderReading",
    "Estimate",
    "Event",
    "FloatArray",
    "Frames",
    "GoalReading",
    "Health",
    "HealthReason",
    "HealthState",
    "ImuReading",
    "LidarScan",
    "LowObstacles",
    "MapUpdate",
    "Message",
    "Mode",
    "MoverTracks",
    "Plan",
    "PoseFix",
    "Readings",
    "RobotStatus",
    "SmoothPath",
    "TrackCommand",
    "Velocity",
    "WorldView",
    "pixel_slopes",
]

Message = (
    EncoderReading
    | ImuReading
    | LidarScan
    | DepthImage
    | LowObstacles
    | Estimate
    | Frames
    | Health
    | PoseFix
    | WorldView
    | Plan
    | SmoothPath
    | TrackCommand
    | MoverTracks
    | GoalReading
    | MapUpdate
    | Event
)
