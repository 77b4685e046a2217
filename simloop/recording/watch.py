"""Connect recording, pictures and plan log to a run, and finish them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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


def _never() -> bool:
    return False


def _hidden(done: int) -> None:
    """Show no progress."""


@contextmanager
def watch(scenario: Scenario, world: World, outputs: Outputs) -> Iterator[Watch]:
    """Watch one run: its ``listeners`` go to the simulation. Leaving the context closes the files.

    If the body raises, the recording is closed as it is and keeps its temporary name, which a note
    on the error tells, and no picture is drawn. Example:

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
    except BaseException as error:
        kept = watched.give_up()
        if kept is not None:
            error.add_note(f"what was recorded until then is kept in {kept}")
        raise
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

    def plan_figures(
        self, stop: Callable[[], bool] = _never, show: Callable[[int], None] = _hidden
    ) -> dict[str, Any]:
        """Compare each plan with the exact optimum, for the result file.

        Args:
            stop: Called before each optimum; True ends the work, the rest has no optimum.
            show: Called with the number of optima that are done.

        Returns:
            ``plans``: one table for each plan; empty if there is no plan log.
        """
        if self._plans is None:
            return {}
        return {"plans": [asdict(record) for record in self._records(self._plans, stop, show)]}

    @property
    def plan_count(self) -> tuple[int, int]:
        """Number of plans so far, and of those whose optimum is computed."""
        return (0, 0) if self._plans is None else (self._plans.plans, self._plans.optima)

    @property
    def recording(self) -> Path | None:
        """The recording as it is named now; None if there is none."""
        return None if self._recorder is None else self._recorder.path

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
        """Close the recording, which is then complete. May be called twice."""
        if self._recorder is not None:
            self._recorder.close()

    def give_up(self) -> Path | None:
        """Close the recording of a run that was cut. It keeps its temporary name.

        Returns:
            The recording that is kept; None if there is none, or if it is complete already.
        """
        if self._recorder is None or not self._recorder.is_open:
            return None
        with suppress(Exception):  # there is a first error already, which is the one to tell
            self._recorder.close(whole=False)
        return self._recorder.path

    def _records(
        self,
        plans: PlanLog,
        stop: Callable[[], bool] = _never,
        show: Callable[[int], None] = _hidden,
    ) -> list[PlanRecord]:
        """Compute the plan records only once, because each takes about 40 ms."""
        if self._plan_records is None:
            self._plan_records = plans.records(stop, show)
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
