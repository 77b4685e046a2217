"""Connect recording, pictures and plan log to a run, and finish them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simloop.evaluation.plan_gap import PlanLog, PlanRecord
from simloop.recording.outputs import Outputs
from simloop.recording.scene_shapes import scene_of, title_of
from simloop.scenario.build import World
from simloop.scenario.scenario import Scenario
from simloop.truth import Published

if TYPE_CHECKING:
    from simloop.recording.recorder import RerunRecorder
    from simloop.recording.snapshots import Snapshots


@contextmanager
def watch(scenario: Scenario, world: World, outputs: Outputs) -> Iterator[Watch]:
    """Watch one run: its ``listeners`` go to the simulation. Leaving the context closes the files.

    If the body raises, the recording is closed as it is, and no picture is drawn. Example:

        with watch(scenario, world, Outputs(recording=Path("run.rrd"))) as watched:
            Simulation(scenario, watched.listeners, world=world).run()

    Args:
        scenario: The scenario of the run.
        world: Its built world.
        outputs: The requested files.

    Yields:
        The watch.

    Raises:
        OSError: The recording cannot be opened, or a picture cannot be written.
    """
    watched = Watch(scenario, world, outputs)
    try:
        yield watched
        watched.finish()
    finally:
        watched.close()


class Watch:
    """The listeners of one run and their data.

    Attributes:
        listeners: Functions that get every message of the run.
    """

    def __init__(self, scenario: Scenario, world: World, outputs: Outputs) -> None:
        self.listeners: list[Callable[[Published], None]] = []
        self._recorder: RerunRecorder | None = None
        self._pictures: Snapshots | None = None
        self._plans: PlanLog | None = None
        self._plan_records: list[PlanRecord] | None = None
        self._finished = False
        if outputs.recording is not None or outputs.result is not None:
            self._plans = PlanLog(scenario.config.planner)
            self.listeners.append(self._plans.offer)
        if outputs.recording is not None:
            self._recorder = recorder_for(outputs.recording, scenario, world)
            self.listeners.append(self._recorder.offer)
        if outputs.snapshots is not None:
            self._pictures = snapshots_for(outputs.snapshots, scenario, world)
            self.listeners.append(self._pictures.offer)

    def plan_figures(self) -> dict[str, Any]:
        """Compare each plan with the exact optimum, for the result file.

        Returns:
            ``plans``: one table for each plan; empty if there is no plan log.
        """
        if self._plans is None:
            return {}
        return {"plans": [asdict(record) for record in self._records(self._plans)]}

    def finish(self) -> None:
        """Write the plans' gaps, close the recording and draw the pictures. Runs only once.

        Raises:
            OSError: A picture cannot be written.
        """
        if self._finished:
            return
        self._finished = True
        if self._recorder is not None and self._plans is not None:
            self._recorder.add_plan_records(self._records(self._plans))
        self.close()
        if self._pictures is not None:
            self._pictures.finish()

    def close(self) -> None:
        """Close the recording as it is. May be called twice."""
        if self._recorder is not None:
            self._recorder.close()

    def _records(self, plans: PlanLog) -> list[PlanRecord]:
        """Compute the plan records only once, because each takes about 40 ms."""
        if self._plan_records is None:
            self._plan_records = plans.records()
        return self._plan_records


def recorder_for(path: Path, scenario: Scenario, world: World) -> RerunRecorder:
    """Open a recording of a run. The caller closes it.

    Args:
        path: The recording's file.
        scenario: The scenario of the run.
        world: Its built world.

    Returns:
        The recorder. Its ``offer`` is a listener.

    Raises:
        OSError: The file cannot be opened.
    """
    from simloop.recording.recorder import RerunRecorder

    return RerunRecorder(path, scene_of(scenario, world))


def snapshots_for(directory: Path, scenario: Scenario, world: World) -> Snapshots:
    """Prepare the pictures of a run. ``finish`` draws them.

    Args:
        directory: Folder of the pictures.
        scenario: The scenario of the run.
        world: Its built world.

    Returns:
        The pictures. Their ``offer`` is a listener.
    """
    from simloop.recording.snapshots import Snapshots

    vehicle = scenario.config.vehicle
    return Snapshots(world.model, directory, scenario.goal, vehicle, title_of(scenario))
