"""Write the results of a replay: map, trajectory, recording and the table of figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from simloop.common.files import (
    FilePlan,
    folder_lock,
    make_directory,
    temporary_name,
    written_together,
)
from simloop.common.terminal import print_lines, print_table
from simloop.mapping.map_files import save_map
from simloop.messages import FloatArray
from simloop.replay.recording import record
from simloop.replay.report import page
from simloop.replay.result import MEASURES, Replay, measure_lines
from simloop.scenario.inputs import files_behind

STDOUT = Path("-")
"""Path that means the standard output."""


@dataclass(frozen=True, slots=True)
class ReplayFiles:
    """Output paths of a replay.

    Attributes:
        directory: directory of map, trajectory and recording; None to write none of them.
        figures: JSON file of the figures; ``STDOUT`` for the standard output; None to write none.
        report: directory of the page; None to write none.
    """

    directory: Path | None
    figures: Path | None
    report: Path | None = None

    def check(self, *read: Path | None) -> None:
        """Check before the replay that all files can be written.

        Args:
            read: the input files; None is ignored.

        Raises:
            InputError: if a file cannot be written, or would overwrite an input file, or if a
                library for the page is missing.
        """
        plan = FilePlan()
        for path in read:
            if path is not None:
                plan.reads_all(files_behind(path, f"an input file ({path})"))
        names = ("map.yaml", "map.pgm", "trajectory.tum", "replay.rrd")
        plan.writes_into(self.directory, "--out", names)
        plan.writes_into(self.report, "--report", (page.PAGE,))
        plan.writes(None if self.figures == STDOUT else self.figures, "--json")
        plan.check()
        if self.report is not None:
            page.check()

    @property
    def map_file(self) -> Path:
        """The map's YAML file; its image is beside it."""
        return self._in("map.yaml")

    @property
    def trajectory(self) -> Path:
        """The file of the trajectory in TUM format."""
        return self._in("trajectory.tum")

    @property
    def recording(self) -> Path:
        """The recording for the rerun viewer."""
        return self._in("replay.rrd")

    def _in(self, name: str) -> Path:
        assert self.directory is not None
        return self.directory / name


def to_tum(t_s: FloatArray, poses: FloatArray) -> str:
    """Format a trajectory for the TUM tools and evo.

    Args:
        t_s: (n,) times, s.
        poses: (n, 3) x, y, yaw, m, m, rad.

    Returns:
        Lines 't x y z qx qy qz qw'.
    """
    return "".join(
        f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(0.5 * yaw):.9f} {math.cos(0.5 * yaw):.9f}\n"
        for t, (x, y, yaw) in zip(t_s, poses, strict=True)
    )


def write(replay: Replay, files: ReplayFiles, name: str) -> None:
    """Write the page, if its directory is given; and map, trajectory and recording: all, or none.

    Args:
        replay: the result.
        files: the output paths.
        name: name of the log, for the page.

    Raises:
        InputError: if the directory cannot be created, another process writes there, or a file
            cannot be written.
        OSError: if the recording cannot be written.
    """
    if files.report is not None:
        page.write(files.report / page.PAGE, name, replay)
    if files.directory is None:
        return
    make_directory(files.directory)
    known = np.isfinite(replay.trajectory[:, 0])
    times = replay.log.t_s[: len(replay.trajectory)]
    with folder_lock(files.directory):
        recording = temporary_name(files.recording)
        try:
            record(recording, replay)
            with written_together() as batch:
                save_map(replay.map, files.map_file, batch)
                batch.write_text(files.trajectory, to_tum(times[known], replay.trajectory[known]))
            recording.replace(files.recording)
        finally:
            recording.unlink(missing_ok=True)


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """Print the figures as a table, and below it what relations and reference measured.

    Args:
        console: the console to print to.
        figures: as in ``Replay.figures``.
    """
    rows = []
    for key, value in figures.items():
        if key in ("versions", "stages", "notes", "worthless", *MEASURES):
            continue
        rows.append([key, f"{value:.4g}" if isinstance(value, float) else str(value)])
    print_table(console, "replay", ["figure", "value"], rows)
    print_lines(console, measure_lines(figures))
