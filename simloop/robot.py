"""The robot's own software: sensor readings in, motor voltages out, and no truth anywhere.

readings -> Localiser -> Navigator (planner, smoother) -> Tracker -> VelocityArbiter -> Drive
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.control.arbiter import STILL, Situation, VelocityArbiter
from simloop.control.collision_monitor import CollisionMonitor
from simloop.control.drive import Drive
from simloop.control.rear_first import rear_first
from simloop.control.recovery import Recovery
from simloop.control.separation import Separation
from simloop.control.watchdog import Stale, StandingCounts, Watchdog
from simloop.localiser import Localiser
from simloop.messages import (
    DepthImage,
    EncoderReading,
    Estimate,
    Event,
    FloatArray,
    LidarScan,
    LowObstacles,
    MapUpdate,
    Message,
    Mode,
    Readings,
    RobotStatus,
    TrackCommand,
    WorldView,
)
from simloop.navigation.navigator import Navigator, Progress, Surroundings, plan_heading
from simloop.perception.low_obstacles import LowObstacleMap
from simloop.perception.mover_tracks import MoverTracker
from simloop.tracker import Tracker

_NOTHING = np.empty((0, 2))
_DOUBT_NS = 10_000_000_000  # a robot that cannot believe its pose at the goal gives up after this


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """What the robot is told before it starts.

    Attributes:
        start: (3,) its start pose in map, m, m, rad.
        goal: (2,) in map, m.
        goal_tolerance_m: Distance from the goal at which it is there, m.
    """

    start: FloatArray
    goal: FloatArray
    goal_tolerance_m: float


class Robot:
    """The software of one robot, a control period at a time.

    Attributes:
        messages: What there is to publish of the last period.
    """

    def __init__(
        self,
        config: Config,
        mission: Mission,
        base_from_laser: FloatArray,
        rng: np.random.Generator,
        profiler: Profiler,
        base_from_camera: FloatArray | None = None,
        laser_height_m: float = 0.0,
    ) -> None:
        """Set up all stages.

        Args:
            config: All settings.
            mission: Start and goal.
            base_from_laser: (3,) x, y, m, and yaw, rad, of the laser in base_link.
            rng: The planner's random numbers.
            profiler: Times the stages.
            base_from_camera: (3,) x, y, z of the depth camera in base_link, m, if there is one.
            laser_height_m: Height of the LiDAR's plane over the ground, m, for the camera's map.
        """
        has_camera = base_from_camera is not None
        self._localiser = Localiser(config, mission.start, base_from_laser, profiler)
        self._slam = self._localiser.slam
        self._movers, self._laser = MoverTracker(), np.array(base_from_laser, np.float64)
        self._low: LowObstacleMap | None = None
        if base_from_camera is not None:
            self._low = LowObstacleMap(
                config.low_obstacles, config.slam, base_from_camera, laser_height_m
            )
        self._navigator = Navigator(
            config, mission.goal, mission.goal_tolerance_m, rng, profiler, has_camera
        )
        self._set_up_control(config, mission, has_camera)
        self._counts, self._sprocket_radps = StandingCounts(), np.zeros(2)
        self._velocity, self._mode = STILL, Mode.STOP
        self._image_ns = self._t_ns = 0
        # The latest scan's points (n, 2) in base_link, and base_link's pose in map at its end.
        self._last_scan = (_NOTHING, np.zeros(3))
        self._driven = False
        # (k, 2) in base_link, where a robot that sees only ahead has been.
        self._trail_m = None if self._low is None else _NOTHING
        self.messages: list[Message] = []
        self._time = {name: profiler.stage(name) for name in ("slam", "tracker")}

    def _set_up_control(self, config: Config, mission: Mission, has_camera: bool) -> None:
        """Make what follows a path and what decides how much of that is driven."""
        rates, vehicle, drive = config.rates, config.vehicle, config.drive
        self._tracker = Tracker(
            config.tracker,
            drive,
            vehicle,
            config.planner.safe_distance_m,
            mission.goal,
            mission.goal_tolerance_m,
            has_camera,
        )
        self._monitor = CollisionMonitor(config.monitor, drive, vehicle, rates.lidar_s)
        self._recovery = Recovery(config.recovery)
        self._watchdog = Watchdog(config.watchdog, rates)
        self._arbiter = VelocityArbiter(
            drive,
            config.recovery,
            Separation(config.separation, config.monitor, drive, vehicle),
            self._monitor.limits,
            rates.control_s,
        )
        self._drive = Drive(drive, config.motor, config.encoder, vehicle, rates.control_s)

    @property
    def status(self) -> RobotStatus:
        """What the robot says of its mission; the first that holds."""
        if self._tracker.arrived:
            return RobotStatus.ARRIVED
        if self._localiser.gave_up or self._doubts_too_long:
            return RobotStatus.LOST
        if self._navigator.goal_is_closed_off:
            return RobotStatus.UNREACHABLE
        if self._recovery.exhausted:
            return RobotStatus.GAVE_UP
        return RobotStatus.DRIVING

    @property
    def _doubts_too_long(self) -> bool:
        """Whether the robot has waited at the goal for a pose that it can believe, in vain."""
        since_ns = self._tracker.doubts_since_ns
        return since_ns is not None and self._t_ns - since_ns > _DOUBT_NS

    def step(self, readings: Readings) -> TrackCommand:
        """Live through one control period.

        Args:
            readings: What the sensors say at its end.

        Returns:
            The command for the next period.
        """
        self.messages.clear()
        encoders = self._counts.believed(readings.encoders, self._sprocket_radps)
        self._localiser.predict(replace(readings, encoders=encoders), self._driven)
        if readings.scan is not None:
            self._take_scan(readings.scan)
        estimate = self._localiser.conclude()
        self.messages.extend(self._localiser.messages)
        self._follow_goal(readings, estimate)
        if readings.image is not None:
            self._look_low(readings.image, estimate)
        if not self._localiser.health.current.halts:
            self._navigate(estimate, readings.scan is not None)
        self.messages.append(estimate)
        with self._time["tracker"]:
            command = self._command(estimate, encoders)
        self._sprocket_radps = command.sprocket_radps
        left, right = command.voltage_v.tolist()
        self._driven = left != 0.0 or right != 0.0
        return command

    def _take_scan(self, scan: LidarScan) -> None:
        """Match a scan, see what moves in it, and enter the rest in the map."""
        localiser, movers = self._localiser, self._movers
        located = localiser.match(scan, movers.discs_at(scan.t_ns))
        if located is None:
            return
        if located.relocalised:
            movers.reset()
            self._navigator.forget()
            self._tracker.hold()
            self._monitor.forget()
        with self._time["slam"]:
            mask = movers.update(located.points_m, self._laser, located.pose, scan.t_ns)
        if movers.tracks is not None:
            self.messages.append(movers.tracks)
        self._navigator.note_surfaces(localiser.enter(located, mask))
        self._last_scan = located.points_m, located.pose
        standing = located.unanswered_m
        if self._low is not None:
            standing = np.concatenate((standing, self._low.surfaces_m))
        self._monitor.observe(located.points_m, located.pose, standing, scan.range_max_m)

    def _follow_goal(self, readings: Readings, estimate: Estimate) -> None:
        """Take news of a goal that moves."""
        if readings.goal is not None:
            self._navigator.hear_goal(readings.goal)
        if self._navigator.goal_moves:
            self._tracker.aim_at(self._navigator.goal_at(estimate.t_ns))

    def _look_low(self, image: DepthImage, estimate: Estimate) -> None:
        """Enter a depth image of this instant, if it is known from where it was taken."""
        self._image_ns = image.t_ns
        if self._low is None or self._localiser.health.current.halts:
            return
        with self._time["slam"]:
            scan, scan_pose = self._last_scan
            movers = self._movers.tracks
            fresh = self._low.update(image, estimate.pose, scan, scan_pose, movers)
            self._navigator.note_surfaces(fresh)
        self.messages.append(LowObstacles(estimate.t_ns, self._low.surfaces_m.copy()))

    def _navigate(self, estimate: Estimate, new_scan: bool) -> None:
        """Plan if need be, take up a new path, and choose which end goes first."""
        navigator, tracker, low = self._navigator, self._tracker, self._low
        has_news = new_scan or tracker.path is None or self._watchdog.cause is Stale.OLD_PATH
        if not (has_news or navigator.is_due(estimate.t_ns)):
            return
        navigator.messages.clear()
        now = Surroundings(
            new_scan,
            self._movers.tracks,
            [None] if low is None else [low.surfaces_m, low.seen_m],
            lambda place, standing: self._slam.view(estimate.t_ns, place, standing),
        )
        plan = navigator.step(estimate, now, self._progress())
        if plan is not None:
            reverses = self._rear_first(estimate.pose, plan_heading(plan))
            path = navigator.smooth(estimate, reverses)
            tracker.follow(path, estimate.gauge_ratio, reverses)
        self._publish_plans(estimate.t_ns)
        if new_scan:
            if tracker.path is not None:
                tracker.reverses = self._rear_first(estimate.pose, tracker.path_yaw)
            self._trail_m = None if low is None else low.trail_from(estimate.pose)

    def _progress(self) -> Progress:
        """How far the robot has come on its path."""
        tracker = self._tracker
        may_plan = self._localiser.mapped and not (tracker.arrived or self._recovery.active)
        is_old = self._watchdog.cause is Stale.OLD_PATH
        return Progress(tracker.path, tracker.next_sample, is_old, may_plan)

    def _publish_plans(self, t_ns: int) -> None:
        """Publish what navigation said, with the map that a plan was made in."""
        for message in self._navigator.messages:
            self.messages.append(message)
            if isinstance(message, WorldView):
                grid = self._slam
                self.messages.append(
                    MapUpdate(t_ns, grid.origin_m.copy(), grid.resolution_m, grid.log_odds.copy())
                )

    def _rear_first(self, pose: FloatArray, path_yaw: float) -> bool:
        """Whether to go rear first along a path; with a camera only the way that it came."""
        if self._low is not None and not self._low.has_driven(pose, path_yaw):
            return False
        return rear_first(self._monitor, pose, path_yaw, self._tracker.reverses)

    def _command(self, estimate: Estimate, encoders: EncoderReading) -> TrackCommand:
        """Ask for what follows the path, and command what the arbiter makes of it."""
        health = self._localiser.health
        self._check_freshness(estimate)
        self._t_ns = estimate.t_ns
        asked, doing = self._tracker.velocity(estimate, self._localiser.is_sure)
        if health.current.halts:
            doing = Mode(health.current.state)
        elif self._watchdog.stops and doing in (Mode.FOLLOW, Mode.TURN):
            doing = Mode.WAIT
        stuck = self._is_stuck(estimate, doing)
        now = Situation(
            estimate.t_ns,
            estimate.pose,
            self._monitor.points_at(estimate.pose),
            self._movers.tracks,
            doing,
            0.0 if health.current.halts else self._speed_cap_mps,
            True,
            self._trail_m,
            not self._tracker.arrived,
            stuck,
            self._recovery.towards,
        )
        self._velocity, self._mode = self._arbiter.choose(asked, self._velocity, now)
        return self._drive.command(
            self._velocity, self._mode, estimate, encoders, health.belts_heard
        )

    @property
    def _speed_cap_mps(self) -> float:
        """The largest speed, m/s, at which what the robot drives by is fresh and far enough."""
        return min(self._watchdog.speed_cap_mps, self._monitor.speed_cap_mps)

    def _is_stuck(self, estimate: Estimate, doing: Mode) -> bool:
        """Whether the robot frees itself now; begins and ends a recovery."""
        recovery = self._recovery
        if self._localiser.health.current.halts:
            recovery.is_stuck(estimate, wants_to_move=False)  # who has to stand is not stuck
            return False
        if recovery.active:
            if not recovery.goes_on(estimate):
                self._tracker.hold()
            return recovery.active
        yields = self._mode in (Mode.YIELD, Mode.DODGE)
        if recovery.is_stuck(estimate, doing in (Mode.FOLLOW, Mode.TURN) and not yields):
            self._navigator.distrust_narrow_gaps()
            towards = self._navigator.next_place(estimate.pose, self._progress())
            recovery.start(estimate, towards)
            self.messages.append(Event(estimate.t_ns, "warning", "stuck: backing off"))
        return recovery.active

    def _check_freshness(self, estimate: Estimate) -> None:
        """Have the watchdog look at what the robot is about to drive by."""
        tracker = self._tracker
        followed = tracker.path is not None and not (tracker.arrived or self._recovery.active)
        event = self._watchdog.check(
            estimate.t_ns,
            self._localiser.health.current.reasons,
            self._navigator.path_ns if followed else None,
            None if self._low is None else self._image_ns,
        )
        if event is not None:
            self.messages.append(event)
