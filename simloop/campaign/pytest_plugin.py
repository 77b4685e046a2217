"""A pytest fixture that runs a scenario and checks that the robot reaches its goal.

    def test_my_room(simloop_run):
        run = simloop_run("my_room.toml", seed=3)
        run.assert_reached(within_s=30.0)

The simulator is imported only when a test uses the fixture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from simloop.campaign.spec import RunSpec


@dataclass(frozen=True, slots=True)
class SimloopRun:
    """A finished run.

    Attributes:
        spec: The run's description.
        metrics: All its figures, as ``simloop run --json`` writes them.
        folder: Folder of the recording if an assertion fails.
    """

    spec: RunSpec
    metrics: dict[str, Any]
    folder: Path

    @property
    def outcome(self) -> str:
        """One of the words of ``simloop.evaluation.referee.Outcome``."""
        return str(self.metrics["outcome"])

    def assert_reached(
        self, within_s: float | None = None, path_ratio: float | None = None
    ) -> None:
        """Check that the robot reached the goal.

        Args:
            within_s: Largest simulated time allowed, s. None: no limit.
            path_ratio: Largest length of its path, as a multiple of the shortest safe path.
                None: no limit.

        Raises:
            AssertionError: If it did not. The message tells what happened, the command that
                repeats the run, and the file of its recording.
        """
        __tracebackhide__ = True
        wrong = self._wrong(within_s, path_ratio)
        if wrong:
            raise AssertionError(f"{wrong}\n  again: {self.spec.command()}\n  {self._recorded()}")

    def _wrong(self, within_s: float | None, path_ratio: float | None) -> str:
        from simloop.campaign.summary import figure_of
        from simloop.evaluation.referee import Outcome

        took, to_go = self.metrics["sim_time_s"], self.metrics["distance_to_go_m"]
        if self.outcome != Outcome.REACHED:
            return f"{self.outcome} after {took:.1f} s, {to_go:.2f} m from the goal"
        if within_s is not None and took > within_s:
            return f"reached after {took:.1f} s, not within {within_s:g} s"
        ratio = figure_of(self.metrics, "path_ratio")
        if path_ratio is not None and ratio is not None and ratio > path_ratio:
            return f"reached on {ratio:.3f} times the shortest path, more than {path_ratio:g} times"
        return ""

    def _recorded(self) -> str:
        from simloop.campaign.closer_look import record

        (file,) = record([(self.spec, self.metrics)], self.folder)
        return f"recorded: rerun {file}"


@pytest.fixture
def simloop_run(tmp_path: Path) -> Callable[..., SimloopRun]:
    """Return a function that runs a scenario.

    Args:
        tmp_path: pytest's directory for this test.

    Returns:
        ``simloop_run(scenario, seed=0, planner=None, overrides=())``: the scenario is a name or a
        TOML file, the planner a name, and each override a text ``key=value``. It returns a
        ``SimloopRun`` and raises InputError if the scenario is wrong.
    """

    def run(
        scenario: str | Path,
        seed: int = 0,
        planner: str | None = None,
        overrides: Sequence[str] = (),
    ) -> SimloopRun:
        from simloop.campaign.spec import RunSpec
        from simloop.loop import Simulation

        spec = RunSpec(str(scenario), planner, (), tuple(overrides), seed)
        return SimloopRun(spec, Simulation(spec.load()).run().metrics, tmp_path)

    return run
