"""Sensor readings: all that the robot receives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages.base import BaseMessage, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class EncoderReading(BaseMessage):
    """Cumulative, quantised counts of the sprockets' encoders.

    Attributes:
        t_ns: Simulated time, ns.
        left_counts: Counts of the left sprocket since the start, 980 per turn by default.
        right_counts: Counts of the right sprocket since the start.
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
    """One full turn of the LiDAR. Each beam has its own instant.

    Attributes:
        t_ns: End of the turn, ns.
        angles_rad: (N,) directions of the beams in the laser frame, rad.
        ranges_m: (N,) ranges, m; inf if nothing came back.
        age_ns: (N,) int64: beam i was cast ``age_ns[i]`` before ``t_ns``, from the laser's pose
            at that instant.
        range_min_m: Least range of the sensor, m.
        range_max_m: Greatest range of the sensor, m.
    """

    t_ns: int
    angles_rad: FloatArray
    ranges_m: FloatArray
    age_ns: NDArray[np.int64]
    range_min_m: float
    range_max_m: float


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage(BaseMessage):
    """The image of a depth camera at one instant.

    Attributes:
        t_ns: Simulated time, ns.
        depth_m: (rows, cols) float32 along the optical axis, m, row 0 at the top; inf if nothing
            came back.
        focal_px: (2,) horizontal and vertical focal length, pixels; the axis is at the centre of
            the image.
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
        (count,) offset of the rays to the left (columns) or up (rows) for one metre of depth.
    """
    return np.asarray((0.5 * (count - 1) - np.arange(count)) / focal_px, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class GoalReading(BaseMessage):
    """A reading of the place of a moving goal.

    Attributes:
        t_ns: Simulated time, ns.
        position_m: (2,) in map, m.
    """

    t_ns: int
    position_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """All sensor readings of one control period. The robot receives nothing else.

    Attributes:
        encoders: Sprocket counts, every period.
        imu: Rates and accelerations, every period.
        scan: A full turn of the LiDAR, in the periods in which one ends.
        goal: The goal's place, if it moves and a reading is due.
        image: A depth image, if there is a camera and an image is due.
    """

    encoders: EncoderReading
    imu: ImuReading
    scan: LidarScan | None = None
    goal: GoalReading | None = None
    image: DepthImage | None = None
