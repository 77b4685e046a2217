"""The robot's own software: sensor messages in, motor voltages out, and no truth anywhere.

encoders, imu -> Ekf <-> GridSlam -> Planner -> Smoother -> Tracker -> monitor -> motor loops
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from simloop.bezier import Smoother
from simloop.blockage import stands_in_the_way
from simloop.config import Config
from simloop.ekf import GAUGE, Ekf
from simloop.messages import (
    EncoderReading,
    Estimate,
    Event,
    FloatArray,
    ImuReading,
    LidarScan,
    MapUpdate,
    Message,
    Plan,
    TrackCommand,
    WorldView,
)
from simloop.monitor import CollisionMonitor
from simloop.profiler import Profiler
from simloop.recovery import Recovery
from simloop.slam_grid import GridSlam
from simloop.tracker import Drive, Tracker
from simloop.widths import WidthPlanner

_BLOCKED_SLACK_M = 0.02  # the map's grain: a path is blocked only when it is clearly so
_HOPELESS_NS = 500_000_000  # between replans for a blockage that the last plan could not avoid
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
    ) -> None:
        rates, vehicle = config.rates, config.vehicle
        safe = config.planner.safe_distance_m
        period = rates.control_s
        self._config, self._mission = config, mission
        self._ekf = Ekf(
            config.ekf, config.encoder, config.imu, vehicle, mission.start, rates.control_s
        )
        self._slam = GridSlam(config.slam, vehicle, base_from_laser)
        self._planner = WidthPlanner(config, mission.goal, rng)
        self._tracker = Tracker(
            config.tracker, vehicle, safe, mission.goal, mission.goal_tolerance_m, period
        )
        self._drive = Drive(config.tracker, config.motor, config.encoder, vehicle, period)
        self._monitor = CollisionMonitor(config.tracker, vehicle)
        self._recovery = Recovery(config.tracker, self._monitor)
        self._trail: deque[Estimate] = deque(maxlen=round(rates.lidar_s / period) + 2)
        self._plan_ns = round(rates.plan_s * 1e9)
        self._plan: Plan | None = None
        self._pending: tuple[int, Plan, Smoother, WorldView] | None = None
        self._planned_ns = 0
        self._mapped = False
        self._unchecked: list[FloatArray] = []
        self._offsets = np.array(vehicle.footprint_offsets_m)
        self.said: list[Message] = []
        stages = ("ekf", "slam", "planner", "smoother", "tracker")
        self._time = {name: profiler.stage(name) for name in stages}

    @property
    def arrived(self) -> bool:
        """Whether it believes to be in the goal's tolerance."""
        return self._tracker.arrived

    @property
    def gave_up(self) -> bool:
        """Whether recoveries have been tried too often."""
        return self._recovery.exhausted

    def step(
        self, encoders: EncoderReading, imu: ImuReading, scan: LidarScan | None
    ) -> TrackCommand:
        """Take one period's readings; answer with the command for the next period."""
        self.said.clear()
        with self._time["ekf"]:
            estimate = self._ekf.advance(encoders, imu)
        self._trail.append(estimate)
        if scan is not None:
            estimate = self._localise_and_map(scan, estimate)
        reason = self._reason_to_plan(estimate, scan is not None)
        if reason:
            self._replan(estimate, reason)
        self._take_up_plan(estimate)
        self.said.append(estimate)
        with self._time["tracker"]:
            return self._command(estimate, encoders)

    def _localise_and_map(self, scan: LidarScan, estimate: Estimate) -> Estimate:
        with self._time["slam"]:
            times = np.array([e.t_ns for e in self._trail], np.int64)
            poses = np.array([e.pose for e in self._trail])
            fix = self._slam.match(scan, times, poses, estimate.pose, self._ekf.covariance_in_map)
        with self._time["ekf"]:
            taken = self._ekf.correct(fix)
            estimate = self._ekf.estimate()
        self._trail[-1] = estimate
        with self._time["slam"]:
            if taken or not self._mapped:
                self._slam.insert(scan, estimate.pose)
                self._ekf.mapped(self._slam.new_share)
                self._mapped = True
                self._unchecked.append(self._slam.new_surfaces_m)
            elif fix.ok:
                self._say(Event(scan.t_ns, "warning", "scan match refused by the filter's gate"))
        self._monitor.observe(self._slam.points_m, estimate.pose)
        self.said.append(fix)
        return estimate

    def _reason_to_plan(self, estimate: Estimate, new_scan: bool) -> str:
        """Why to plan now: a frame is due, the path ahead is blocked, or there is none yet."""
        if self.arrived or not self._mapped or self._pending or self._recovery.active:
            return ""
        if self._plan is None:
            return "first"
        if estimate.t_ns % self._plan_ns == 0:
            return "frame"
        if new_scan and self._blocked(estimate):
            return "blocked"
        if self._tracker.path is None:
            return "recovered"
        return ""

    def _blocked(self, estimate: Estimate) -> bool:
        """Whether what came into the map since the plan's view stands in the path's way."""
        path = self._tracker.path
        if path is None or self._plan is None:
            return False
        if not self._plan.safe and estimate.t_ns - self._planned_ns < _HOPELESS_NS:
            return False
        limit = self._config.planner.safe_distance_m - _BLOCKED_SLACK_M
        with self._time["slam"]:
            surfaces = np.concatenate(self._unchecked or [np.empty((0, 2))])
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
        with self._time["slam"]:
            view = self._slam.view(estimate.t_ns, self._mission.goal)
            self._unchecked.clear()
        with self._time["planner"]:
            plan, smoother = self._planner.plan(view, estimate.pose, self._plan, reason)
        self._planned_ns = estimate.t_ns
        self._pending = (estimate.t_ns + self._latency_ns(plan), plan, smoother, view)
        grid = self._slam
        self._say(plan, view)
        self._say(
            MapUpdate(estimate.t_ns, grid.origin_m.copy(), grid.resolution_m, grid.log_odds.copy())
        )
        if not plan.safe:
            self._say(Event(plan.t_ns, "warning", "no safe path found; going on with the best"))

    def _latency_ns(self, plan: Plan) -> int:
        """The simulated time that planning takes: given, never measured."""
        planner = self._config.planner
        runs = plan.evaluations if planner.latency == "per_evaluation" else 1
        period = round(self._config.rates.control_s * 1e9)
        return round(planner.latency_s * runs * 1e9 / period) * period

    def _take_up_plan(self, estimate: Estimate) -> None:
        if self._pending is None or estimate.t_ns < self._pending[0]:
            return
        _, plan, smoother, view = self._pending
        self._pending, self._plan = None, plan
        with self._time["smoother"]:
            path = smoother.smooth(plan, view, estimate.pose)
        self._tracker.follow(path, float(estimate.state[GAUGE]))
        self._say(path)

    def _command(self, estimate: Estimate, encoders: EncoderReading) -> TrackCommand:
        tracker, recovery = self._tracker, self._recovery
        if recovery.active:
            speed, rate, mode = recovery.velocity(estimate)
            if not recovery.active:
                tracker.hold()
        else:
            speed, rate, mode = tracker.velocity(estimate)
            if recovery.watch(estimate, mode in ("follow", "turn")):
                self._planner.distrust_tight_gaps()
                recovery.start(estimate, self._next_part(estimate.pose))
                self._say(Event(estimate.t_ns, "warning", "stuck: backing off"))
        free_speed, free_rate = self._monitor.allow(speed, rate, estimate.pose)
        if (free_speed, free_rate) != (speed, rate):
            mode = "held"
            tracker.overrule(free_speed, free_rate)
        return self._drive.command((free_speed, free_rate, mode), estimate, encoders)

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
