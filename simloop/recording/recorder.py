"""Record a run for the rerun viewer.

Messages are kept and written about once per simulated second, in columns, because a call of the
recording library costs the same for one row as for a hundred rows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simloop.evaluation.plan_gap import PlanRecord
from simloop.messages import (
    DepthImage,
    Estimate,
    Event,
    Frames,
    GoalReading,
    LidarScan,
    LowObstacles,
    MapUpdate,
    MoverTracks,
    Plan,
    SmoothPath,
    TrackCommand,
    WorldView,
)
from simloop.recording.blueprint import make_blueprint
from simloop.recording.columns import DERIVED, plotted_series
from simloop.recording.message_writers import (
    EventWriter,
    write_discs,
    write_goals,
    write_images,
    write_low_obstacles,
    write_map,
    write_movers,
    write_paths,
    write_plan,
    write_scans,
)
from simloop.recording.motion_writers import (
    PoseWriter,
    write_errors,
    write_loose_bodies,
    write_track_speeds,
)
from simloop.recording.scene_log import CAMERA, log_scene
from simloop.recording.shapes import Scene
from simloop.recording.stream import TIMELINE, RecordingFile
from simloop.truth import LooseTruth, Published, Truth

_FLUSH_NS = 1_000_000_000


class RerunRecorder:
    """Writes a run into an ``.rrd`` file. In any failure it is readable up to its last second.

    A failure to write is reported once, and the run continues without recording. A recording that
    was cut keeps a temporary name, see `RecordingFile`.
    """

    def __init__(self, path: str | Path, scene: Scene) -> None:
        """Open the file and write the static parts.

        Args:
            path: The file.
            scene: The scene to show.

        Raises:
            OSError: The file cannot be opened.
        """
        camera = None if scene.camera_m is None else CAMERA
        blueprint = make_blueprint(scene.bounds_m, TIMELINE, camera)
        self._file = file = RecordingFile(Path(path), blueprint, scene.title)
        self._kept: defaultdict[type, list[Any]] = defaultdict(list)
        self._due_ns = _FLUSH_NS
        self._sprocket_radius_m = scene.sprocket_radius_m
        self._series = plotted_series(scene.road_wheels)
        self._poses, self._events = PoseWriter(file, scene.start), EventWriter(file)
        log_scene(file, scene)
        names = {entity: lines for entity, (_, lines, _) in self._series.items()} | DERIVED
        for entity, lines in names.items():
            file.log_static(f"plots/{entity}", file.rr.SeriesLines(names=lines))

    def offer(self, message: Published) -> None:
        """Take one message. About once per simulated second, write all kept messages.

        Args:
            message: Any message of the run.
        """
        if self._file.is_open:
            # The truth starts a control period, so all kept messages belong to whole periods.
            if type(message) is Truth and message.t_ns >= self._due_ns:
                self._write()
                self._due_ns = message.t_ns + _FLUSH_NS
            self._kept[type(message)].append(message)

    def add_plan_records(self, records: Sequence[PlanRecord]) -> None:
        """Plot each plan's cost beside the exact optimum. Call it once, after the run.

        Args:
            records: One record for each plan.
        """
        known = [r for r in records if r.exact_cost is not None]
        if self._file.is_open and known:
            times = [round(r.t_s * 1e9) for r in known]
            self._file.send_scalars("plan_cost_exact", times, [r.exact_cost for r in known])
            gaps = [np.nan if r.gap_percent is None else r.gap_percent for r in known]
            self._file.send_scalars("plan_gap_percent", times, gaps)

    @property
    def path(self) -> Path:
        """The file as it is named now."""
        return self._file.path

    @property
    def is_open(self) -> bool:
        """Whether the file still takes messages."""
        return self._file.is_open

    def close(self, whole: bool = True) -> None:
        """Write the remaining messages and the file's footer. May be called twice.

        Args:
            whole: Whether the run went to its end, so that the file gets its own name.

        Raises:
            OSError: The file cannot be renamed.
        """
        if self._file.is_open:
            try:
                self._write()
            finally:
                self._file.close(whole)

    def _write(self) -> None:
        """Write all kept messages and flush the file."""
        file = self._file
        kept, self._kept = self._kept, defaultdict(list)
        truths, estimates, commands = kept[Truth], kept[Estimate], kept[TrackCommand]
        for entity, (kind, _, column) in self._series.items():
            if kept[kind]:
                file.send_scalars(entity, [m.t_ns for m in kept[kind]], column(kept[kind]))
        write_track_speeds(file, truths, commands, self._sprocket_radius_m)
        write_errors(file, truths, estimates)
        self._poses.write_truths(truths)
        self._poses.write_frames(kept[Frames])
        self._poses.write_estimates(estimates)
        write_scans(file, kept[LidarScan])
        write_images(file, kept[DepthImage])
        write_low_obstacles(file, kept[LowObstacles])
        write_loose_bodies(file, kept[LooseTruth])
        write_movers(file, kept[MoverTracks])
        write_goals(file, kept[GoalReading])
        for plan in kept[Plan]:
            write_plan(file, plan)
        for view in kept[WorldView]:
            write_discs(file, view)
        for grid in kept[MapUpdate]:
            write_map(file, grid)
        write_paths(file, kept[SmoothPath])
        self._events.write(kept[Event], kept[Plan], commands)
        file.flush()
