"""The typed messages that flow along every arrow of the loop.

Conventions: SI units, radians, yaw counter-clockwise, x forward, z up (REP-103);
frames map -> odom -> base_link -> laser/imu (REP-105). ``t_ns`` is simulated time
in integer nanoseconds. Arrays inside a message are read-only.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, fields
from enum import StrEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LEFT_BELT, RIGHT_BELT = "left belt not heard", "right belt not heard"
GYRO, NO_IMU, NO_COUNTS = "gyro's bias jumped", "no imu readings", "no encoder counts"
SHOVED, NO_SCANS = "moved by something else", "no scans"
NOTHING_SEEN, MISFIT, LOST = "nothing in sight", "scans do not fit", "lost"


FloatArray = NDArray[np.float64]
_ARRAYS = ("FloatArray", "NDArray[")


class BaseMessage:
    """Base of the messages: freezes every array that a message carries."""

    __slots__ = ()

    def __post_init__(self) -> None:
        kind: Any = self.__class__
        for get in _array_getters(kind):
            get(self).setflags(False)  # write; by its name it costs twice as much
        for get in _tuple_getters(kind):
            for array in get(self):
                array.setflags(False)


@cache
def _array_getters(kind: Any) -> tuple[Any, ...]:
    """Getters of the fields that hold an array, by their annotations.

    Those are the slots' own descriptors: asked for at each message made, ten thousand a run.
    """
    return tuple(getattr(kind, name).__get__ for name in _fields_of(kind, _ARRAYS))


@cache
def _tuple_getters(kind: Any) -> tuple[Any, ...]:
    """Getters of the fields that hold a tuple of arrays."""
    kinds = tuple(f"tuple[{array}" for array in _ARRAYS)
    return tuple(getattr(kind, name).__get__ for name in _fields_of(kind, kinds))


def _fields_of(kind: Any, annotations: tuple[str, ...]) -> list[str]:
    return [field.name for field in fields(kind) if str(field.type).startswith(annotations)]


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
class LowObstacles(BaseMessage):
    """What the camera has seen and the LiDAR has not.

    Attributes:
        t_ns: Simulated time, ns.
        surfaces_m: (k, 2) in map, m.
    """

    t_ns: int
    surfaces_m: FloatArray


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
class Estimate(BaseMessage):
    """The robot's belief of its own state.

    Attributes:
        t_ns: Simulated time, ns.
        state: (9,) x, y, m, and yaw, rad, of base_link in map; speed, m/s; yaw rate, rad/s; gyro
            bias, rad/s; gauge ratio; how far the middle of the tracks' centres of rotation lies
            to the left, m, and the vehicle's own to the front, m (see ``estimation.ekf_model``).
        covariance: (9, 9) of the state.
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
        """How much wider than its gauge the robot turns, because its tracks slip."""
        return float(self.state[6])


@dataclass(frozen=True, slots=True, eq=False)
class Frames(BaseMessage):
    """The transforms of REP-105: odom is smooth and drifts, map jumps with each pose fix.

    Attributes:
        t_ns: Simulated time, ns.
        odom_from_base: (3,) base_link in odom, m, m, rad.
        map_from_odom: (3,) odom in map, m, m, rad.
        odom_from_base_by_wheels: (3,) the same as ``odom_from_base`` by the encoders alone, with
            the centres of rotation that the filter has learnt.
    """

    t_ns: int
    odom_from_base: FloatArray
    map_from_odom: FloatArray
    odom_from_base_by_wheels: FloatArray


@dataclass(frozen=True, slots=True)
class Health:
    """What the robot thinks of its own localisation.

    Attributes:
        t_ns: Simulated time, ns.
        state: ``ok``, ``degraded`` or ``lost``.
        reasons: Why it is not ``ok``.
        halts: Whether it is reason enough not to drive on.
    """

    t_ns: int
    state: str
    reasons: tuple[str, ...]
    halts: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoseFix(BaseMessage):
    """The match of a scan with the map.

    Attributes:
        t_ns: Instant of the scan, ns.
        pose: (3,) base_link in map, m, m, rad.
        covariance: (3, 3) of the pose.
        score: Share of the points that meet the map, 0 to 1.
        ok: False where the match is not to be trusted: too few points, poor overlap.
    """

    t_ns: int
    pose: FloatArray
    covariance: FloatArray
    score: float
    ok: bool


@dataclass(frozen=True, slots=True, eq=False)
class MoverTracks(BaseMessage):
    """Things that the robot has seen move, as discs in map.

    Attributes:
        t_ns: Instant of the positions, ns.
        number: (n,) int64, the same number for the same thing.
        position_m: (n, 2) in map, m.
        velocity_mps: (n, 2) in map, m/s.
        radius_m: (n,) of what was seen of it, m.
        std_m: (n,) standard deviation of the position along one axis, m.
        pace_mps: (n,) the fastest that it went lately, m/s: what has just stopped may set off
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
        """Predict the things as discs at another instant.

        Args:
            t_ns: The instant, ns.
            about_m: By how much each is wider than was seen, m.

        Returns:
            (n, 3) x, y, radius in map, m.
        """
        return np.column_stack((self.places_at(t_ns), self.radius_m + about_m))


@dataclass(frozen=True, slots=True, eq=False)
class WorldView(BaseMessage):
    """What a planner may know of the world, all of it from the robot's own map.

    What lies outside the grid is unknown, and each user says how it reads it. The planners, the
    smoother and the elastic band take the distance of the nearest place inside ("edge" in
    `simloop.geometry.distance_field`): a wall that reaches the border goes on outside.
    `navigation.planner_world.opened` adds free space about the grid where that leaves no way.
    The check whether a goal can be reached at all (`navigation.feasibility`) takes it for free.
    Unknown cells inside the grid are free for all.

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
        safe: Whether the polyline keeps ``safe_distance_m`` all along (near a start that is too
            close to something, as much of it as the start allows).
        evaluations: How many paths and single segments were tried.
        generations: How many generations a population went through.
        planner: Name of the planner.
        reason: Why the plan was asked for.
        candidates_m: Some paths (., 2) of the final population, to look at.
        history: (H, 2) evaluations and the best J from then on, one row for each gain; empty if
            the planner keeps none.
        safe_distance_m: Distance from obstacles that the plan was asked to keep, m.
        start_turn_cost: What the turn from the robot's heading to the first segment adds to
            ``cost``.
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
    """A densely sampled path in map whose curvature is continuous.

    Attributes:
        t_ns: Simulated time of the plan's view, ns.
        xy_m: (K, 2) places of base_link, m.
        yaw_rad: (K,) headings, unwrapped, rad.
        curvature_1pm: (K,) signed curvature, left positive, 1/m.
        arc_m: (K,) length from the start, m.
        clearance_m: (K,) least distance from any of the footprint's disc centres to an obstacle,
            m.
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
