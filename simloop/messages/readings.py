"""What the robot is told: sensor readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages.base import BaseMessage, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class EncoderReading(BaseMessage):
    """Cumulative counts of the sprockets' encoders, quantised.

    Attributes:
        t_ns: Simulated time, ns.
        left_counts: Counts since the start, 980 a turn by default.
        right_counts: The same of the right sprocket.
    """

    t_ns: int
    left_counts: int
    right_counts: int


@dataclass(frozen=True, slots=True, eq=False)
class ImuReading(BaseMessage):
    """Rates and accelerations in the imu frame, which is parallel to base_link.

    Attributes:
        t_ns: Simulated time, ns.
        gyro_radps: (3,) rates, rad/s.
        accel_mps2: (3,) proper acceleration, m/s^2: at rest it is +g upwards.
    """

    t_ns: int
    gyro_radps: FloatArray
    accel_mps2: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan(BaseMessage):
    """One full turn of the LiDAR, swept: each beam has its own instant.

    Attributes:
        t_ns: End of the turn, ns.
        angles_rad: (N,) directions of the beams in the laser frame, rad.
        ranges_m: (N,) ranges, m; inf where nothing came back.
        age_ns: (N,) int64: beam i was cast ``age_ns[i]`` before ``t_ns``, from the laser's pose
            at that instant.
        range_min_m: Least range that the sensor measures, m.
        range_max_m: Greatest range that it measures, m.
    """

    t_ns: int
    angles_rad: FloatArray
    ranges_m: FloatArray
    age_ns: NDArray[np.int64]
    range_min_m: float
    range_max_m: float


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage(BaseMessage):
    """What a depth camera sees at one instant.

    Attributes:
        t_ns: Simulated time, ns.
        depth_m: (rows, cols) float32 along the optical axis, m, row 0 on top; inf where nothing
            came back.
        focal_px: (2,) horizontal and vertical focal length, pixels; the axis goes through the
            image's middle.
    """

    t_ns: int
    depth_m: NDArray[np.float32]
    focal_px: FloatArray


def pixel_slopes(count: int, focal_px: float) -> FloatArray:
    """Compute the slopes of the rays through an image's columns or rows.

    Args:
        count: Number of columns or rows.
        focal_px: Focal length, pixels.

    Returns:
        (count,) how far the rays lead left (columns) or up (rows) for one metre of depth.
    """
    return np.asarray((0.5 * (count - 1) - np.arange(count)) / focal_px, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class GoalReading(BaseMessage):
    """Where a goal that moves is, as the robot is told.

    Attributes:
        t_ns: Simulated time, ns.
        position_m: (2,) in map, m.
    """

    t_ns: int
    position_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """All sensor readings of one control period, which is everything that the robot learns.

    Attributes:
        encoders: Sprocket counts, every period.
        imu: Rates and accelerations, every period.
        scan: A full turn of the LiDAR, in the periods in which one ends.
        goal: Where the goal is, if it moves and there is news of it.
        image: A depth image, if there is a camera and one is due.
    """

    encoders: EncoderReading
    imu: ImuReading
    scan: LidarScan | None = None
    goal: GoalReading | None = None
    image: DepthImage | None = None
