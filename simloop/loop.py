"""The closed loop: plant -> sensors -> robot -> motors -> plant, in lockstep, from one seed."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from simloop.common.compile_listener import Report, listening, silent
from simloop.common.profiler import Profiler
from simloop.evaluation.metrics import RunMetrics
from simloop.messages import DepthImage, GoalReading, LidarScan, Readings, RobotStatus
from simloop.physics.faults import Faults
from simloop.physics.plant import Plant
from simloop.robot import Mission, Robot
from simloop.scenario.build import World, build_world
from simloop.scenario.scenario import Scenario
from simloop.sensors import DepthCamera, Encoders, Imu, Lidar
from simloop.truth import Published, RayFan, Truth
from simloop.worlds.movers.crowd import Crowd, MovingGoal

_WARM_UP_S = 0.5


_STILL_MPS = 0.01
_PROGRESS_TICKS = 20
_GAVE_UP = {
    RobotStatus.LOST: "lost",
    RobotStatus.UNREACHABLE: "unreachable",
    RobotStatus.GAVE_UP: "stuck",
}

Listener = Callable[[Published], None]


class Recorder(Protocol):
    """Whoever wants to hear every message."""

    def offer(self, message: Published) -> None:
        """Take one message; it is read-only."""
        ...


@dataclass(frozen=True, slots=True)
class RunResult:
    """outcome: reached, collision, stuck, unreachable, lost, missed, timeout.

    metrics: what ``--json`` writes.
    """

    outcome: str
    metrics: dict[str, Any]

    @property
    def reached(self) -> bool:
        """Whether the robot truly stands in the goal's tolerance."""
        return self.outcome == "reached"


class Simulation:
    """One run of a scenario. Raises InputError for a scenario that cannot be run.

    recorder and listeners hear every message and can change nothing.
    """

    def __init__(
        self,
        scenario: Scenario,
        recorder: Recorder | None = None,
        listeners: Sequence[Listener] = (),
        profiler: Profiler | None = None,
        world: World | None = None,
    ) -> None:
        config, rates = scenario.config, scenario.config.rates
        self.scenario = scenario
        self.world = world or build_world(scenario)
        self.plant = Plant(self.world.model, config)
        rngs = np.random.default_rng(scenario.seed).spawn(7)
        imu_rng, lidar_rng, planner_rng, fault_rng, crowd_rng, goal_rng, camera_rng = rngs
        self._encoders = Encoders(config.encoder)
        self._imu = Imu(config.imu, rates.control_s, imu_rng)
        mount = self.plant.base_from_laser
        self._lidar = Lidar(config.lidar, rates.lidar_s, mount, lidar_rng)
        start, goal = np.array(scenario.start), np.array(scenario.goal)
        mission = Mission(start, goal, scenario.goal_tolerance_m)
        self._faults = Faults(scenario.faults, fault_rng)
        self._rays = self._faults.rays(self.plant)
        self.profiler = watch = profiler or Profiler()
        laser = np.array([mount[0], mount[1], 0.0])
        camera, self._shoot = None, _blind
        if config.camera.enabled:
            camera = self.plant.base_from_camera
            shoot = DepthCamera(config.camera, config.camera.period_s, camera, camera_rng).shoot
            self._shoot = watch.wrap("camera", shoot)
        self.robot = Robot(config, mission, laser, planner_rng, watch, camera)
        self.metrics = RunMetrics(scenario, self.world.floor, self.world.body)
        offers = [] if recorder is None else [watch.wrap("recorder", recorder.offer)]
        self._listeners: list[Listener] = [self.metrics.offer, *offers, *listeners]
        self._crowd = self._moving_goal = None
        if self.world.movers:
            self._crowd = Crowd(
                self.world.movers, self.world.floor, self.world.body, rates.control_s, crowd_rng
            )
        if scenario.goal_motion is not None:
            self._moving_goal = MovingGoal(
                scenario.goal_motion,
                scenario.goal,
                self.world.floor,
                self.world.body,
                rates.control_s,
                goal_rng,
            )
        self._goal, self._limit_ns = goal, round(scenario.time_limit_s * 1e9)
        self._period_ns = round(rates.control_s * 1e9)
        self._step = watch.wrap("plant", self.plant.step)
        self._sweep = watch.wrap("lidar", self._lidar.sweep)

    def run(self, progress: Callable[[float, float], bool] | None = None) -> RunResult:
        """Run to the end, once. progress: called now and then with simulated s and m to go.

        Ends when the robot stands at its goal, touches something, gives up, or is out of time;
        or, as ``interrupted``, when ``progress`` answers False.
        """
        if self.plant.t_ns:
            raise RuntimeError("a simulation runs once: make another for another run")
        began = time.perf_counter()
        voltage, truth = np.zeros(2), self.plant.reset(np.array(self.scenario.start))
        self._publish([truth])
        outcome, ticks, faults = "", 0, self._faults
        with _no_collector():
            while not outcome:
                faults.act(self.plant, truth)
                goal = self._move_all(truth)
                before, truth = truth, self._step(voltage)
                encoders = faults.encoders(self._encoders.read(truth))
                imu = faults.imu(self._imu.read(truth))
                faults.at(truth.t_ns)
                scan = faults.scan(self._sweep(before, truth, self._rays), truth.t_ns)
                image = faults.image(self._shoot(truth, self.plant), truth.t_ns)
                command = self.robot.step(Readings(encoders, imu, scan, goal, image))
                voltage = command.voltage_v
                heard = self._heard(scan, goal, image)
                self._publish([truth, encoders, imu, *heard, command])
                self._publish(self.robot.said)
                outcome, ticks = self._outcome(truth), ticks + 1
                if progress and not outcome and ticks % _PROGRESS_TICKS == 0:
                    goes_on = progress(truth.t_ns * 1e-9, self._distance(truth))
                    outcome = "" if goes_on else "interrupted"
        return self._result(outcome, time.perf_counter() - began)

    def _move_all(self, truth: Truth) -> GoalReading | None:
        """Send the movers and the goal on their way; what the robot is told of the goal."""
        if self._crowd is not None:
            self.plant.move(self._crowd.step(truth.pose_xyyaw, truth.in_contact))
        if self._moving_goal is None:
            return None
        self._goal = self._moving_goal.step()
        return self._moving_goal.reading(truth.t_ns + self._period_ns, self._goal)

    def _heard(
        self, scan: LidarScan | None, goal: GoalReading | None, image: DepthImage | None
    ) -> list[Published]:
        """What comes less often, and the truth to hold against it."""
        heard: list[Published] = [message for message in (goal, image) if message is not None]
        if scan is None:
            return heard
        heard += [scan, self.plant.track_truth()]
        loose = self.plant.loose_truth()
        return heard if loose is None else [*heard, loose]

    def _result(self, outcome: str, wall_time_s: float) -> RunResult:
        metrics = self.metrics.result(
            outcome=outcome,
            wall_time_s=wall_time_s,
            state_hash=self.plant.state_hash(),
            plan_ms=self.profiler.stage("planner").milliseconds,
            goal=self._goal,
        )
        return RunResult(outcome, metrics)

    def _publish(self, messages: Sequence[Published]) -> None:
        for listener in self._listeners:
            for message in messages:
                listener(message)

    def _distance(self, truth: Truth) -> float:
        return float(np.hypot(*(truth.pose_xyyaw[:2] - self._goal)))

    def _outcome(self, truth: Truth) -> str:
        """How the run ended, or nothing while it goes on. Only the referee knows the truth."""
        if truth.contact_count:
            return "collision"
        status = self.robot.status
        if status is RobotStatus.ARRIVED:
            still = self._moving_goal is not None or abs(truth.velocity_body[0]) < _STILL_MPS
            near = self._distance(truth) <= self.scenario.goal_tolerance_m
            if still:
                return "reached" if near else "missed"
        elif status is not RobotStatus.DRIVING:
            return _GAVE_UP[status]
        return "timeout" if truth.t_ns >= self._limit_ns else ""


def _blind(truth: Truth, world: RayFan) -> DepthImage | None:
    """The eye of a robot without a camera."""
    return None


@contextmanager
def _no_collector() -> Iterator[None]:
    """Keeps Python's cycle collector out of the loop: it makes no cycles, and pauses are jitter."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def warm_up(scenario: Scenario, world: World, report: Report = silent) -> int:
    """Run half a simulated second, thrown away, so that every stage's kernels are ready.

    report: called with a kernel's name and its number just before it is compiled; never, where
    all come from the cache. Returns how many were compiled.
    """
    with listening(report) as listener:
        Simulation(replace(scenario, time_limit_s=_WARM_UP_S), world=world).run()
    return listener.count
