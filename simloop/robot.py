"""The robot's own software: sensor messages in, motor voltages out, and no truth anywhere.

encoders, imu, scan -> Localiser -> Planner -> Smoother -> Tracker -> monitor -> motor loops
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.control.arbiter import rear_first
from simloop.control.collision_monitor import CollisionMonitor
from simloop.control.recovery import Recovery
from simloop.control.separation import Separation
from simloop.control.watchdog import OLD_PATH, StandingCounts, Watchdog
from simloop.ekf import GAUGE
from simloop.geometry.se2 import about_face
from simloop.localiser import Localiser
from simloop.messages import (
    DepthImage,
    EncoderReading,
    Estimate,
    Event,
    FloatArray,
    LowObstacles,
    MapUpdate,
    Message,
    Plan,
    Readings,
    RobotStatus,
    TrackCommand,
    WorldView,
)
from simloop.navigation.bezier_smoother import Smoother
from simloop.navigation.feasibility import Reachability, stands_in_the_way
from simloop.navigation.gap_choice import GapChooser
from simloop.navigation.moving_goal import Pursuit
from simloop.navigation.planner_world import foresee, opened
from simloop.perception.low_obstacles import LowObstacleMap, looking_ahead
from simloop.tracker import Drive, Tracker

_BLOCKED_SLACK_M = 0.02  # the map's grain: a path is blocked only when it is clearly so
_HOPELESS_NS = 500_000_000  # between replans for a blockage that the last plan could not avoid
_MOVERS_M, _MOVERS_NS = 3.0, 600_000_000  # from what moves; and how old a plan is then too old
_NOTHING = np.empty((0, 2))
_NEXT_M = 0.4  # where on its path a robot that is held would like to be


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """What the robot is told: its start pose (3,), its goal (2,) in map, and when it is there."""

    start: FloatArray
    goal: FloatArray
    goal_tolerance_m: float


class Robot:
    """One control period at a time; keeps what it said in ``said`` for whoever records."""

    def __init__(
        self,
        config: Config,
        mission: Mission,
        base_from_laser: FloatArray,
        rng: np.random.Generator,
        profiler: Profiler,
        base_from_camera: FloatArray | None = None,
    ) -> None:
        """base_from_laser: (3,) x, y, yaw; base_from_camera: (3,) x, y, z, if there is one."""
        if base_from_camera is not None:
            config = looking_ahead(config)
        rates, vehicle = config.rates, config.vehicle
        safe = config.planner.safe_distance_m
        period = rates.control_s
        self._config = config
        self._localiser = Localiser(config, mission.start, base_from_laser, profiler)
        self._slam = self._localiser.slam
        self._low: LowObstacleMap | None = None
        if base_from_camera is not None:
            self._low = LowObstacleMap(config.low_obstacles, config.slam, base_from_camera)
        self._pursuit = Pursuit(mission.goal)
        self._planner = GapChooser(config, rng)
        self._smoother = Smoother(config.smoother, vehicle)
        self._tracker = Tracker(
            config.tracker, vehicle, safe, mission.goal, mission.goal_tolerance_m, period
        )
        self._drive = Drive(config.tracker, config.motor, config.encoder, vehicle, period)
        self._monitor = CollisionMonitor(config.tracker, vehicle, rates.lidar_s)
        self._separation = Separation(config.tracker, vehicle, self._monitor)
        self._recovery = Recovery(config.tracker, self._monitor)
        self._watchdog = Watchdog(config.watchdog, rates, config.tracker)
        self._reach = Reachability(mission.goal_tolerance_m, vehicle.width_m)
        self._pace_mps = config.tracker.max_speed_mps
        self._plan_ns = round(rates.plan_s * 1e9)
        self._plan: Plan | None = None
        self._pending: tuple[int, Plan, WorldView] | None = None
        self._counts, self._sprocket_radps = StandingCounts(), np.zeros(2)
        self._planned_ns = self._path_ns = self._image_ns = 0
        self._driven = self._yields = False
        self._unchecked: list[FloatArray] = []
        self._offsets = np.array(vehicle.footprint_offsets_m)
        self.said: list[Message] = []
        stages = ("slam", "planner", "smoother", "tracker")
        self._time = {name: profiler.stage(name) for name in stages}

    @property
    def arrived(self) -> bool:
        """Whether it believes to be in the goal's tolerance."""
        return self._tracker.arrived

    @property
    def status(self) -> RobotStatus:
        """What the robot says of its mission; the first that holds."""
        if self._tracker.arrived:
            return RobotStatus.ARRIVED
        if self._localiser.gave_up:
            return RobotStatus.LOST
        if self._reach.hopeless:
            return RobotStatus.UNREACHABLE
        if self._recovery.exhausted:
            return RobotStatus.GAVE_UP
        return RobotStatus.DRIVING

    def step(self, readings: Readings) -> TrackCommand:
        """Take the readings of one control period; return the command for the next period."""
        encoders, imu, scan = readings.encoders, readings.imu, readings.scan
        goal, image = readings.goal, readings.image
        self.said.clear()
        localiser = self._localiser
        encoders = self._counts.believed(encoders, self._sprocket_radps)
        estimate = localiser.step(encoders, imu, scan, self._driven)
        if goal is not None:
            self._pursuit.hear(goal)
        if self._pursuit.moves:
            self._tracker.aim_at(self._pursuit.place(estimate.t_ns))
        self.said.extend(localiser.said)
        if localiser.jumped:
            self._begin_anew()
        if localiser.new_surfaces_m is not None:
            self._unchecked.append(localiser.new_surfaces_m)
        if image is not None:
            self._look_low(image, estimate)
        if localiser.seen_from is not None:
            self._monitor.observe(self._slam.points_m, localiser.seen_from, self._standing_m)
        if not localiser.health.said.halts:
            reason = self._reason_to_plan(estimate, scan is not None)
            if reason:
                self._replan(estimate, reason)
            self._take_up_plan(estimate)
            if scan is not None and self._tracker.path is not None:
                self._tracker.reverses = self._rear_first(estimate.pose, self._tracker.path_yaw)
        self.said.append(estimate)
        with self._time["tracker"]:
            command = self._command(estimate, encoders)
        self._sprocket_radps = command.sprocket_radps
        left, right = command.voltage_v.tolist()
        self._driven = left != 0.0 or right != 0.0
        return command

    def _beliefs(self) -> list[FloatArray | None]:
        """What stands there though no scan shows it: with all that is guessed of it, and, if that
        leaves no way, without."""
        return [None] if self._low is None else [self._low.surfaces_m, self._low.seen_m]

    @property
    def _standing_m(self) -> FloatArray | None:
        """(k, 2) in map, what stands there though no scan shows it."""
        return None if self._low is None else self._low.surfaces_m

    def _look_low(self, image: DepthImage, estimate: Estimate) -> None:
        """Enter a depth image of this instant, if it is known from where it was taken."""
        self._image_ns = image.t_ns
        if self._low is None or self._localiser.health.said.halts:
            return
        with self._time["slam"]:
            scan = self._slam.points_m if self._localiser.seen_from is not None else _NOTHING
            fresh = self._low.look(image, estimate.pose, scan, self._localiser.movers)
            self._unchecked.append(fresh)
        self._say(LowObstacles(estimate.t_ns, self._low.surfaces_m.copy()))

    def _begin_anew(self) -> None:
        """Forget all that was meant for another place: the plan, the path, what was near."""
        self._plan = self._pending = None
        self._unchecked.clear()
        self._tracker.hold()
        self._monitor.forget()

    def _reason_to_plan(self, estimate: Estimate, new_scan: bool) -> str:
        """Why to plan now: a frame is due, the path ahead is blocked, or there is none yet."""
        if self.arrived or not self._localiser.mapped or self._pending or self._recovery.active:
            return ""
        if self._plan is None:
            return "first"
        if estimate.t_ns % self._plan_ns == 0:
            return "frame"
        if new_scan and self._blocked(estimate):
            return "blocked"
        if new_scan and self._met(estimate):
            return "mover"
        if new_scan and self._pursuit.strays(estimate.t_ns, estimate.pose, self._pace_mps):
            return "goal"
        if self._tracker.path is None:
            return "recovered"
        return "stale" if self._watchdog.cause == OLD_PATH else ""

    def _met(self, estimate: Estimate) -> bool:
        """Whether something moves so near that a plan of a while ago may lead into its way."""
        movers = self._localiser.movers
        if movers is None or estimate.t_ns - self._planned_ns < _MOVERS_NS:
            return False
        return bool((np.hypot(*(movers.position_m - estimate.pose[:2]).T) < _MOVERS_M).any())

    def _blocked(self, estimate: Estimate) -> bool:
        """Whether what came into the map since the plan's view stands in the path's way."""
        path = self._tracker.path
        if path is None or self._plan is None:
            return False
        if not self._plan.safe and estimate.t_ns - self._planned_ns < _HOPELESS_NS:
            return False
        limit = self._config.planner.safe_distance_m - _BLOCKED_SLACK_M
        with self._time["slam"]:
            surfaces = np.concatenate(self._unchecked or [_NOTHING])
            self._unchecked.clear()
            return stands_in_the_way(
                surfaces,
                path.xy_m,
                path.yaw_rad,
                path.clearance_m,
                self._tracker.ahead.start,
                self._offsets,
                limit,
                _BLOCKED_SLACK_M,
            )

    def _replan(self, estimate: Estimate, reason: str) -> None:
        self._unchecked.clear()
        for standing in self._beliefs():
            with self._time["slam"]:
                place = self._pursuit.place(estimate.t_ns)
                still = self._slam.view(estimate.t_ns, place, standing)
            with self._time["planner"]:
                pose, pace = estimate.pose, self._pace_mps
                goal = self._pursuit.aim(still, pose, pace, self._config.planner.safe_distance_m)
                view = foresee(still, self._localiser.movers, pose, pace)
                plan, view = self._find_way(view, pose, goal, reason)
            if plan.safe:
                break
        self._planned_ns = estimate.t_ns
        self._pending = (estimate.t_ns + self._latency_ns(plan), plan, view)
        grid = self._slam
        self._say(plan, view)
        self._say(
            MapUpdate(estimate.t_ns, grid.origin_m.copy(), grid.resolution_m, grid.log_odds.copy())
        )
        # What moves may close a way off, and clears it again.
        still_there = self._localiser.movers is None
        if still_there and self._reach.look(still, pose, goal, plan.safe):
            text = "the goal cannot be reached: what is known closes it off"
            self._say(Event(plan.t_ns, "warning", text))
        if not plan.safe:
            self._say(Event(plan.t_ns, "warning", "no safe path found; going on with the best"))

    def _find_way(
        self, view: WorldView, pose: FloatArray, goal: FloatArray, reason: str
    ) -> tuple[Plan, WorldView]:
        """The plan from ``pose`` (3,) to ``goal`` (2,), and the view that it was found in."""
        plan = self._planner.plan(view, pose, goal, self._plan, reason)
        if plan.safe or view.movers is not None:  # what moves clears the way again
            return plan, view
        wider = opened(view)
        other = self._planner.plan(wider, pose, goal, self._plan, reason)
        spent = plan.evaluations + other.evaluations
        if other.safe:
            return replace(other, evaluations=spent), wider
        return replace(plan, evaluations=spent), view

    def _latency_ns(self, plan: Plan) -> int:
        """The simulated time that planning takes: given, never measured."""
        planner = self._config.planner
        runs = plan.evaluations if planner.latency == "per_evaluation" else 1
        period = round(self._config.rates.control_s * 1e9)
        return round(planner.latency_s * runs * 1e9 / period) * period

    def _take_up_plan(self, estimate: Estimate) -> None:
        if self._pending is None or estimate.t_ns < self._pending[0]:
            return
        _, plan, view = self._pending
        self._pending, self._plan, self._path_ns = None, plan, estimate.t_ns
        pose, (ahead, aside) = estimate.pose, plan.waypoints_m[1] - plan.waypoints_m[0]
        reverses = self._rear_first(pose, math.atan2(aside, ahead))
        with self._time["smoother"]:
            path = self._smoother.smooth(plan, view, about_face(pose) if reverses else pose)
        self._tracker.follow(path, float(estimate.state[GAUGE]), reverses)
        self._say(path)

    def _rear_first(self, pose: FloatArray, path_yaw: float) -> bool:
        if self._low is not None and not self._low.has_been_on(pose, path_yaw):
            return False
        return rear_first(self._monitor, pose, path_yaw, self._tracker.reverses)

    def _command(self, estimate: Estimate, encoders: EncoderReading) -> TrackCommand:
        tracker, recovery, health = self._tracker, self._recovery, self._localiser.health
        watchdog = self._watchdog
        self._look_whether_fresh(estimate)
        if health.said.halts:
            tracker.overrule(0.0, 0.0)
            return self._drive.command((0.0, 0.0, health.said.state), estimate, encoders)
        if recovery.active:
            speed, rate, mode = recovery.velocity(estimate)
            if not recovery.active:
                tracker.hold()
        else:
            speed, rate, mode = tracker.velocity(estimate)
            mode = "wait" if watchdog.stops and mode in ("follow", "turn") else mode
            if recovery.watch(estimate, mode in ("follow", "turn") and not self._yields):
                self._planner.stop_trying_tight_gaps()
                recovery.start(estimate, self._next_part(estimate.pose))
                self._say(Event(estimate.t_ns, "warning", "stuck: backing off"))
        asked, (speed, rate) = (speed, rate), watchdog.limit(speed, rate)
        if (speed, rate) != asked:
            tracker.overrule(speed, rate)
        free_speed, free_rate = self._monitor.allow(speed, rate, estimate.pose)
        free_speed, free_rate, manner = self._separation.allow(
            free_speed,
            free_rate,
            estimate.pose,
            self._localiser.movers,
            estimate.t_ns,
            not self.arrived,
        )
        self._yields = bool(manner)
        if (free_speed, free_rate) != (speed, rate):
            mode = manner or "held"
            tracker.overrule(free_speed, free_rate)
        return self._drive.command(
            (free_speed, free_rate, mode), estimate, encoders, health.belts_heard
        )

    def _look_whether_fresh(self, estimate: Estimate) -> None:
        """Have the watchdog look at what the robot is about to drive by."""
        tracker = self._tracker
        followed = tracker.path is not None and not (tracker.arrived or self._recovery.active)
        reasons = self._localiser.health.said.reasons
        path_ns = self._path_ns if followed else None
        image_ns = None if self._low is None else self._image_ns
        event = self._watchdog.look(estimate.t_ns, reasons, path_ns, image_ns)
        if event is not None:
            self._say(event)

    def _next_part(self, pose: FloatArray) -> FloatArray | None:
        """The first place (2,) of the path ahead that is ``_NEXT_M`` away from ``pose`` (3,)."""
        path = self._tracker.path
        if path is None:
            return None
        ahead = path.xy_m[self._tracker.ahead]
        far = np.hypot(*(ahead - pose[:2]).T) > _NEXT_M
        return ahead[int(np.argmax(far)) if far.any() else -1]

    def _say(self, *messages: Message) -> None:
        self.said.extend(messages)
