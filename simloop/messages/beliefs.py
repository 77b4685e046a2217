"""What the robot believes: its state, its health, its map and the moving obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from simloop.messages.base import BaseMessage, FloatArray


class HealthState(StrEnum):
    """How well the robot knows its pose."""

    OK = "ok"
    DEGRADED = "degraded"
    LOST = "lost"


class HealthReason(StrEnum):
    """The reason why the robot knows its pose less well."""

    LEFT_BELT = "left belt not heard"
    RIGHT_BELT = "right belt not heard"
    GYRO = "gyro's bias jumped"
    NO_IMU = "no imu readings"
    NO_COUNTS = "no encoder counts"
    SHOVED = "moved by something else"
    SLIDES = "slides on the ground"
    NO_SCANS = "no scans"
    NOTHING_SEEN = "nothing in sight"
    MISFIT = "scans do not fit"
    NEVER_SEEN = "nothing has ever come back"
    BLIND = "beams do not come back"
    THIN = "many beams do not come back"
    NOISY = "ranges are noisy"
    UNSURE = "pose is uncertain"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class Estimate(BaseMessage):
    """The robot's estimate of its own state.

    Attributes:
        t_ns: Simulated time, ns.
        state: (9,) x, y, m, and yaw, rad, of base_link in map; speed, m/s; yaw rate, rad/s; gyro
            bias, rad/s; gauge ratio; offset to the left of the middle of the tracks' centres of
            rotation, m; offset to the front of the vehicle's own centre of rotation, m (see
            ``estimation.ekf_model``).
        covariance: (9, 9) covariance of the state.
    """

    t_ns: int
    state: FloatArray
    covariance: FloatArray

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y, yaw of base_link in map."""
        return self.state[:3]

    @property
    def speed(self) -> float:
        """Forward speed, m/s."""
        return float(self.state[3])

    @property
    def yaw_rate(self) -> float:
        """Yaw rate, rad/s."""
        return float(self.state[4])

    @property
    def gauge_ratio(self) -> float:
        """Ratio of the effective to the real gauge. It is above 1 because the tracks slip."""
        return float(self.state[6])


@dataclass(frozen=True, slots=True, eq=False)
class Frames(BaseMessage):
    """The transforms of REP-105: odom is smooth and drifts; map jumps with each pose fix.

    Attributes:
        t_ns: Simulated time, ns.
        odom_from_base: (3,) base_link in odom, m, m, rad.
        map_from_odom: (3,) odom in map, m, m, rad.
        odom_from_base_by_wheels: (3,) as ``odom_from_base``, but from the encoders only, with the
            centres of rotation that the filter has learnt.
    """

    t_ns: int
    odom_from_base: FloatArray
    map_from_odom: FloatArray
    odom_from_base_by_wheels: FloatArray


@dataclass(frozen=True, slots=True)
class Health:
    """The robot's assessment of its own localisation.

    Attributes:
        t_ns: Simulated time, ns.
        state: How well it knows its pose.
        reasons: Why it is not ``OK``.
        halts: Whether the robot must stop for this reason.
    """

    t_ns: int
    state: HealthState
    reasons: tuple[HealthReason, ...]
    halts: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoseFix(BaseMessage):
    """The match of a scan with the map.

    Attributes:
        t_ns: Instant of the scan, ns.
        pose: (3,) base_link in map, m, m, rad.
        covariance: (3, 3) covariance of the pose.
        score: Share of the points that match the map, 0 to 1.
        ok: False if the match is not reliable: too few points, or poor overlap.
    """

    t_ns: int
    pose: FloatArray
    covariance: FloatArray
    score: float
    ok: bool


@dataclass(frozen=True, slots=True, eq=False)
class MoverTracks(BaseMessage):
    """Moving obstacles that the robot has observed, as discs in map.

    Attributes:
        t_ns: Instant of the positions, ns.
        number: (n,) int64, the same number for the same obstacle.
        position_m: (n, 2) in map, m.
        velocity_mps: (n, 2) in map, m/s.
        radius_m: (n,) radius of its visible part, m.
        std_m: (n,) standard deviation of the position along one axis, m.
        pace_mps: (n,) its greatest recent speed, m/s. An obstacle that has just stopped may move
            again.
    """

    t_ns: int
    number: NDArray[np.int64]
    position_m: FloatArray
    velocity_mps: FloatArray
    radius_m: FloatArray
    std_m: FloatArray
    pace_mps: FloatArray

    def places_at(self, t_ns: int) -> FloatArray:
        """Predict positions at another instant, at constant velocity.

        Args:
            t_ns: The instant, ns.

        Returns:
            (n, 2) in map, m.
        """
        return self.position_m + 1e-9 * (t_ns - self.t_ns) * self.velocity_mps

    def discs_at(self, t_ns: int, about_m: float) -> FloatArray:
        """Predict the obstacles as discs at another instant.

        Args:
            t_ns: The instant, ns.
            about_m: Distance by which each radius is enlarged, m.

        Returns:
            (n, 3) x, y, radius in map, m.
        """
        return np.column_stack((self.places_at(t_ns), self.radius_m + about_m))


@dataclass(frozen=True, slots=True, eq=False)
class LowObstacles(BaseMessage):
    """Obstacles that the camera has seen and the LiDAR has not.

    Attributes:
        t_ns: Simulated time, ns.
        surfaces_m: (k, 2) points of their surfaces in map, m.
    """

    t_ns: int
    surfaces_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MapUpdate(BaseMessage):
    """The robot's occupancy grid when a plan was made.

    Attributes:
        t_ns: Simulated time, ns.
        origin_m: (2,) lower left corner of cell (0, 0) in map, m.
        resolution_m: Size of a cell, m.
        log_odds: (rows, cols) float32, [iy, ix]; 0 is unknown.
    """

    t_ns: int
    origin_m: FloatArray
    resolution_m: float
    log_odds: NDArray[np.float32]
