"""Drive once: the work of the benchmark on a worker, with the driven path in the run's row."""

from __future__ import annotations

import math
from functools import lru_cache
from time import process_time, thread_time_ns

import numpy as np

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import TIMING, Row, do_run
from simloop.common.profiler import Profiler
from simloop.loop import Simulation, warm_up
from simloop.messages import GoalReading
from simloop.scenario.build import World, build_world
from simloop.scenario.load import load
from simloop.scenario.scenario import Scenario
from simloop.truth import Published, Truth

_ROOM = "experiment"

SPACING_M = 0.05
"""Least distance between two points of a stored path, m."""

TIMES = (*TIMING, "frame_ms", "cpu_s")
"""The columns that depend on the machine's speed. All others are the same on every machine."""


class Trace:
    """Observer of a run: the driven path, the way of a moving goal, and the time of each frame."""

    def __init__(self) -> None:
        """Begin with empty paths."""
        self._path: list[tuple[float, float]] = []
        self._goal: list[tuple[float, float]] = []
        self._last: Truth | None = None

    def offer(self, message: Published) -> None:
        """Receive a message of the run.

        Args:
            message: The message. True poses and readings of the goal are used.
        """
        if isinstance(message, Truth):
            self._last = message
            _append(self._path, message.pose_xyyaw)
        elif isinstance(message, GoalReading):
            _append(self._goal, message.position_m)

    def columns(self, simulation: Simulation) -> Row:
        """Make the additional columns after the run.

        Args:
            simulation: The finished run.

        Returns:
            ``path_m`` and ``goal_path_m``, points x, y in map, m, rounded to 1 mm, and
            ``frame_ms``, the processor time of each planning frame, ms: what else runs on the
            machine does not count.
        """
        if self._last is not None:
            self._path.append((float(self._last.pose_xyyaw[0]), float(self._last.pose_xyyaw[1])))
        frames = simulation.profiler.stage("planner").milliseconds
        return {
            "path_m": np.round(np.array(self._path).reshape(-1, 2), 3).tolist(),
            "goal_path_m": np.round(np.array(self._goal).reshape(-1, 2), 3).tolist(),
            "frame_ms": [round(ms, 3) for ms in frames],
        }


def drive(spec: RunSpec) -> Row:
    """Simulate one run.

    The kernels of the run are loaded before, so that the first frame is not slower than others.

    Args:
        spec: The run.

    Returns:
        The run's row, see `campaign.work.do_run`, with the columns of `Trace` and ``cpu_s``, the
        processor time of the whole run without the loading of kernels, s.
    """

    loading_s = 0.0

    def observe(scenario: Scenario, world: World) -> Trace:
        nonlocal loading_s
        before = process_time()
        _load_kernels(scenario.config.planner.name)
        loading_s = process_time() - before
        return Trace()

    began = process_time()
    row = do_run(spec, observe, lambda: Profiler(thread_time_ns))
    return row | {"cpu_s": process_time() - began - loading_s}


def _append(points: list[tuple[float, float]], position: np.ndarray) -> None:
    """Add a position that is far enough from the last one."""
    x, y = float(position[0]), float(position[1])
    if not points or math.hypot(x - points[-1][0], y - points[-1][1]) >= SPACING_M:
        points.append((x, y))


@lru_cache(maxsize=128)
def _load_kernels(planner: str) -> None:
    """Run the beginning of a run and discard it, once for each planner in a process."""
    scenario = load(_ROOM, planner=planner)
    warm_up(scenario, build_world(scenario))
