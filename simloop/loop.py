"""The closed loop: plant, sensors, robot and referee in lockstep. One seed reproduces a run."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simloop.common.compile_listener import Report, listening, silent
from simloop.common.profiler import Profiler
from simloop.evaluation.metrics import RunMetrics
from simloop.evaluation.referee import Outcome, Referee, distance_to_go_m
from simloop.messages import Readings, TrackCommand
from simloop.physics.faults import Faults
from simloop.physics.plant import Plant
from simloop.robot import Mission, Robot
from simloop.scenario.build import World, build_world
from simloop.scenario.scenario import Scenario
from simloop.simulation.environment import Environment
from simloop.simulation.random_streams import RandomStreams
from simloop.simulation.sensor_suite import SensorSuite
from simloop.truth import Published, Truth

_WARM_UP_S = 0.5
_PROGRESS_PERIODS = 20

Listener = Callable[[Published], None]
"""Receives every message of a run. Messages are read-only, so a listener cannot change the run."""
Progress = Callable[[float, float], bool]
"""Receives simulated time, s, and distance to go, m. Returns False to stop the run."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended.

    Attributes:
        outcome: The referee's decision.
        metrics: The metrics of the run, as ``simloop run --json`` writes them.
        unstable: Why the physics broke down, if it did.
    """

    outcome: Outcome
    metrics: dict[str, Any]
    unstable: str = ""

    @property
    def reached(self) -> bool:
        """Whether the robot truly stands within the goal's tolerance."""
        return self.outcome.success


class Simulation:
    """One run of a scenario.

    Attributes:
        scenario: The scenario.
        world: The built world.
        plant: The simulated vehicle in its world.
        robot: The robot's software.
        metrics: Collects the metrics of the run.
        profiler: Wall times of the stages.
    """

    def __init__(
        self,
        scenario: Scenario,
        listeners: Sequence[Listener] = (),
        profiler: Profiler | None = None,
        world: World | None = None,
    ) -> None:
        """Build all parts of the run.

        Args:
            scenario: The scenario to run.
            listeners: Called with every message, in order.
            profiler: Records the wall times of the stages.
            world: The scenario's world, if it is already built.

        Raises:
            InputError: The scenario cannot be run.
        """
        config, random = scenario.config, RandomStreams.from_seed(scenario.seed)
        self.scenario = scenario
        self.profiler = profiler or Profiler()
        self.world = world or build_world(scenario)
        self.plant = plant = Plant(self.world.model, config)
        faults = Faults(scenario.faults, random.faults)
        self._environment = Environment(scenario, self.world, faults, random)
        self._goal = goal = self._environment.goal
        self._sensors = SensorSuite(config, plant, goal, faults, random, self.profiler)
        mission = Mission(np.array(scenario.start), goal.position_m, scenario.goal_tolerance_m)
        laser = np.array([*plant.base_from_laser[:2], 0.0])
        camera = plant.base_from_camera if config.camera.enabled else None
        laser_height_m = float(plant.base_from_laser[2])
        self.robot = Robot(
            config, mission, laser, random.planner, self.profiler, camera, laser_height_m
        )
        self.metrics = RunMetrics(scenario, self.world.floor, self.world.body)
        self._referee = Referee(scenario.goal_tolerance_m, scenario.time_limit_s, goal.moves)
        self._listeners: list[Listener] = [self.metrics.offer, *listeners]
        self._step = self.profiler.wrap("plant", self.plant.step)
        self._progress_ns = _PROGRESS_PERIODS * round(config.rates.control_s * 1e9)

    def run(self, progress: Progress | None = None) -> RunResult:
        """Run to the end. A simulation runs once.

        Args:
            progress: Called every 20 control periods.

        Returns:
            The outcome and the metrics.

        Raises:
            RuntimeError: The simulation has already run.
        """
        if self.plant.t_ns:
            raise RuntimeError("a simulation runs only once: make a new one for another run")
        began = time.perf_counter()
        voltage, truth = np.zeros(2), self.plant.reset(np.array(self.scenario.start))
        self._publish([truth])
        outcome: Outcome | None = None
        with _no_garbage_collection():
            while outcome is None:
                self._environment.step(self.plant, truth)
                before, truth = truth, self._step(voltage)
                if truth.unstable:  # no sensor could measure such a state
                    outcome = Outcome.UNSTABLE
                    break
                readings = self._sensors.read(before, truth)
                command = self.robot.step(readings)
                voltage = command.voltage_v
                self._publish(self._messages(truth, readings, command))
                outcome = self._referee.judge(truth, self.robot.status, self._goal.position_m)
                outcome = outcome or self._interruption(truth, progress)
        assert outcome is not None
        return self._result(outcome, time.perf_counter() - began, truth.unstable)

    def _messages(self, truth: Truth, readings: Readings, command: TrackCommand) -> list[Published]:
        """Collect the messages of one control period in the order in which listeners get them."""
        messages: list[Published] = [truth, readings.encoders, readings.imu]
        seldom = (readings.goal, readings.image, readings.scan)
        messages += [reading for reading in seldom if reading is not None]
        if readings.scan is not None:
            messages.append(self.plant.track_truth())
            loose = self.plant.loose_truth()
            messages += [] if loose is None else [loose]
        return [*messages, command, *self.robot.messages]

    def _publish(self, messages: Sequence[Published]) -> None:
        for listener in self._listeners:
            for message in messages:
                listener(message)

    def _interruption(self, truth: Truth, progress: Progress | None) -> Outcome | None:
        """Report progress, if it is due, and check whether to stop."""
        if progress is None or truth.t_ns % self._progress_ns:
            return None
        to_go_m = distance_to_go_m(truth, self._goal.position_m)
        return None if progress(truth.t_ns * 1e-9, to_go_m) else Outcome.INTERRUPTED

    def _result(self, outcome: Outcome, wall_time_s: float, unstable: str) -> RunResult:
        metrics = self.metrics.result(
            outcome=outcome,
            wall_time_s=wall_time_s,
            state_hash=self.plant.state_hash(),
            plan_ms=self.profiler.stage("planner").milliseconds,
            goal=self._goal.position_m,
        )
        return RunResult(outcome, metrics, unstable)


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Pause Python's cycle collector: the loop makes no cycles, and a pause would be jitter."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def warm_up(scenario: Scenario, world: World, report: Report = silent) -> int:
    """Run half a simulated second and discard it, so that every stage's kernels are compiled.

    Args:
        scenario: The scenario to run afterwards.
        world: The scenario's world.
        report: Called with a kernel's name and its number just before it is compiled. It is not
            called if all kernels come from the cache.

    Returns:
        The number of compiled kernels.
    """
    with listening(report) as listener:
        Simulation(replace(scenario, time_limit_s=_WARM_UP_S), world=world).run()
    return listener.count
