"""The typed messages that flow along every arrow of the loop.

Conventions: SI units, radians, yaw counter-clockwise, x forward, z up (REP-103);
frames map -> odom -> base_link -> laser/imu (REP-105). ``t_ns`` is simulated time
in integer nanoseconds. Arrays inside a message are read-only.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, fields
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEFT_BELT, RIGHT_BELT = "left belt not heard", "right belt not heard"
GYRO, NO_IMU, NO_COUNTS = "gyro's bias jumped", "no imu readings", "no encoder counts"
SHOVED, NO_SCANS = "moved by something else", "no scans"
NOTHING_SEEN, MISFIT, LOST = "nothing in sight", "scans do not fit", "lost"


FloatArray = NDArray[np.float64]


class BaseMessage:
    """Base of the messages: freezes every array that a message carries."""

    __slots__ = ()

    def __post_init__(self) -> None:
        kind: Any = self.__class__
        for get in _array_getters(kind):
            get(self).setflags(False)  # write; by its name it costs twice as much


@cache
def _array_getters(kind: Any) -> tuple[Any, ...]:
    """Getters of the fields that hold an array, by their annotations.

    Those are the slots' own descriptors: asked for at each message made, ten thousand a run.
    """
    arrays = ("FloatArray", "NDArray[")
    names = [field.name for field in fields(kind) if str(field.type).startswith(arrays)]
    return tuple(getattr(kind, name).__get__ for name in names)


@dataclass(frozen=True, slots=True, eq=False)
class EncoderReading(BaseMessage):
    """Cumulative sprocket counts (980 a turn), quantised."""

    t_ns: int
    left_counts: int
    right_counts: int


@dataclass(frozen=True, slots=True, eq=False)
class ImuReading(BaseMessage):
    """gyro_radps, accel_mps2: (3,) in the imu frame, which is parallel to base_link."""

    t_ns: int
    gyro_radps: FloatArray
    accel_mps2: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan(BaseMessage):
    """One full turn. Beam i was cast at ``t_ns - age_ns[i]``, from the laser's pose then.

    angles_rad: (N,) in the laser frame; ranges_m: (N,), inf where nothing came back;
    age_ns: (N,) int64, how long before ``t_ns`` (the end of the turn) the beam was cast.
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

    depth_m: (rows, cols) float32 along the optical axis, row 0 on top, inf where nothing came back.
    focal_px: (2,) horizontal, vertical; the axis goes through the image's middle.
    """

    t_ns: int
    depth_m: NDArray[np.float32]
    focal_px: FloatArray


def pixel_slopes(count: int, focal_px: float) -> FloatArray:
    """(count,) how far the rays through columns of pixels lead left, rows up, for one of depth."""
    return np.asarray((0.5 * (count - 1) - np.arange(count)) / focal_px, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class LowObstacles(BaseMessage):
    """What the camera has seen and the LiDAR has not: surfaces_m (k, 2) in map."""

    t_ns: int
    surfaces_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class GoalReading(BaseMessage):
    """Where a goal that moves is, as the robot is told; position_m: (2,) in map."""

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
class Estimate(BaseMessage):
    """The robot's belief.

    state: (9,) x, y, yaw, speed, yaw rate, gyro bias, gauge ratio k, how far the middle of the
    tracks' centres of rotation lies to the left, and the vehicle's own to the front, m (see
    ``ekf_model``). covariance: (9, 9). ``pose`` is base_link in map.
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
        """rad/s."""
        return float(self.state[4])


@dataclass(frozen=True, slots=True, eq=False)
class Frames(BaseMessage):
    """REP-105: odom_from_base (3,) is smooth and drifts, map_from_odom (3,) jumps with the fixes.

    odom_from_base_by_wheels: (3,) what the encoders alone, with the centres of rotation that the
    filter has learnt, make of the way since the start.
    """

    t_ns: int
    odom_from_base: FloatArray
    map_from_odom: FloatArray
    odom_from_base_by_wheels: FloatArray


@dataclass(frozen=True, slots=True)
class Health:
    """What the robot thinks of its own localisation: ``ok``, ``degraded`` or ``lost``, and why.

    halts: whether it is reason enough not to drive on.
    """

    t_ns: int
    state: str
    reasons: tuple[str, ...]
    halts: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoseFix(BaseMessage):
    """A scan-to-map match: pose (3,) of base_link in map at ``t_ns``, with covariance (3, 3).

    ``ok`` is False where the match is not to be trusted (too few points, poor overlap).
    """

    t_ns: int
    pose: FloatArray
    covariance: FloatArray
    score: float
    ok: bool


@dataclass(frozen=True, slots=True, eq=False)
class MoverTracks(BaseMessage):
    """Things that the robot has seen move, as discs in map at ``t_ns``.

    number: (n,) int64, the same for the same thing. position_m, velocity_mps: (n, 2); radius_m:
    (n,) of what was seen of it; std_m: (n,) of its place, one axis. pace_mps: (n,) the fastest
    that it went of late: what has just stopped may set off again.
    """

    t_ns: int
    number: NDArray[np.int64]
    position_m: FloatArray
    velocity_mps: FloatArray
    radius_m: FloatArray
    std_m: FloatArray
    pace_mps: FloatArray

    def places_at(self, t_ns: int) -> FloatArray:
        """(n, 2) where they are at another instant if they go on as they go."""
        return self.position_m + 1e-9 * (t_ns - self.t_ns) * self.velocity_mps

    def discs_at(self, t_ns: int, about_m: float) -> FloatArray:
        """(n, 3) x, y, radius in map at another instant, each ``about_m`` wider than was seen."""
        return np.column_stack((self.places_at(t_ns), self.radius_m + about_m))


@dataclass(frozen=True, slots=True, eq=False)
class WorldView(BaseMessage):
    """What a planner may know of the world, all of it from the robot's own map.

    Unknown cells inside the grid are free. Outside the grid planners and smoother take the
    distance of the nearest place inside ("edge", `geometry.distance_field`): a wall that reaches
    the border goes on. Only `navigation.feasibility` takes the outside for free.

    Attributes:
        t_ns: Simulated time, ns.
        origin_m: (2,) lower left corner of cell (0, 0), in map, m.
        resolution_m: Side of a cell, m.
        distance_m: (rows, cols) float32 [iy, ix], distance from a cell's centre to the nearest
            occupied cell's surface, m; (0, 0) if there is no grid.
        discs_xyr_m: (K, 3) x, y, radius of obstacles as discs, in map, m.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the space in which waypoints may lie, m.
        polygons_m: Corners (N, 2) of convex obstacles, in map, m.
        movers: What moves, which is in none of the others; None where nothing is known to.
    """

    t_ns: int
    origin_m: FloatArray
    resolution_m: float
    distance_m: NDArray[np.float32]
    discs_xyr_m: FloatArray
    bounds_m: FloatArray
    polygons_m: tuple[FloatArray, ...] = ()
    movers: MoverTracks | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Plan(BaseMessage):
    """A planner's answer to a task: a polyline and what it costs.

    Attributes:
        t_ns: Simulated time of the view that was planned in, ns.
        waypoints_m: (M, 2) from the start to the goal, in map, m.
        cost: J of the whole polyline as the planner minimises it: length, turning, the turn at
            the start and, where clearance is lacking, its penalty.
        length_m: Length, m.
        turning_rad: Sum of the turns at the inner waypoints, rad.
        safe: Whether the polyline keeps ``safe_distance_m`` all along, or what its start allows.
        evaluations: How many paths and single segments were tried.
        generations: How many generations a population went through.
        planner: Name of the planner.
        reason: Why the plan was asked for.
        candidates_m: Some paths (., 2) of the final population, to look at.
        history: (H, 2) evaluations and the best J from then on, if the planner keeps them.
        safe_distance_m: Distance from obstacles that the plan was asked to keep, m.
        start_turn_cost: What the turn from the robot's heading to the first segment adds to J.
    """

    t_ns: int
    waypoints_m: FloatArray
    cost: float
    length_m: float
    turning_rad: float
    safe: bool
    evaluations: int
    generations: int
    planner: str
    reason: str = "frame"
    candidates_m: tuple[FloatArray, ...] = ()
    history: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    _: KW_ONLY
    safe_distance_m: float
    start_turn_cost: float = 0.0

    @property
    def path_cost(self) -> float:
        """J without the turn at the start: what it costs whichever way the robot faces now."""
        return self.cost - self.start_turn_cost


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath(BaseMessage):
    """A densely sampled, curvature-continuous path in map.

    Attributes:
        t_ns: Simulated time of the plan's view, ns.
        xy_m: (K, 2) places of base_link, m.
        yaw_rad: (K,) headings, unwrapped, rad.
        curvature_1pm: (K,) signed curvature, left positive, 1/m.
        arc_m: (K,) length from the start, m.
        clearance_m: (K,) least distance from the footprint's disc centres to an obstacle, m.
        safe: Whether the footprint's discs keep the plan's safe distance at every sample, to
            1 mm. Near a start that is too close to something less is asked for, as of the plan.
    """

    t_ns: int
    xy_m: FloatArray
    yaw_rad: FloatArray
    curvature_1pm: FloatArray
    arc_m: FloatArray
    clearance_m: FloatArray
    safe: bool


@dataclass(frozen=True, slots=True, eq=False)
class TrackCommand(BaseMessage):
    """What the tracker wants: sprocket speeds and the motor voltages that shall bring them.

    speed_mps, yaw_rate_radps: the body velocity asked for. mode: what the tracker is doing
    (follow, turn, stop, back_off, arrived, ...).
    """

    t_ns: int
    speed_mps: float
    yaw_rate_radps: float
    sprocket_radps: FloatArray
    voltage_v: FloatArray
    mode: str


@dataclass(frozen=True, slots=True, eq=False)
class MapUpdate(BaseMessage):
    """The robot's map at a plan's frame. log_odds: (rows, cols) float32, [iy, ix], 0 unknown.

    Cell (0, 0) has its lower left corner at origin_m (2,).
    """

    t_ns: int
    origin_m: FloatArray
    resolution_m: float
    log_odds: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth a line: level is ``info`` or ``warning``."""

    t_ns: int
    level: str
    text: str


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
