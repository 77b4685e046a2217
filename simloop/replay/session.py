"""``simloop replay``: a log in, figures, map, trajectory and recording out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from simloop.errors import InputError
from simloop.messages import FloatArray
from simloop.outputs import check_directory, check_file
from simloop.replay.laser_log import LaserLog, read_log
from simloop.replay.relations import on_the_relations_clock, read_relations, relation_errors
from simloop.report import print_table


@dataclass(frozen=True, slots=True)
class ReplayFiles:
    """What a replay writes; None where nobody asked."""

    directory: Path | None
    figures: Path | None

    def check(self, log: Path, relations: Path | None) -> None:
        """Raise InputError for what cannot be written, or would take the place of an input."""
        if self.directory is not None:
            check_directory(self.directory, "--out")
        if self.figures is not None:
            check_file(self.figures, "--json")
            for source in (log, relations):
                if source is not None and self.figures.resolve() == source.resolve():
                    raise InputError(f"--json {self.figures}: would overwrite what is read")


def load(log: Path, relations: Path | None) -> tuple[LaserLog, FloatArray | None]:
    """The log, and the relations to measure it by: the file's, or else the log's own."""
    read = read_log(log)
    return read, read_relations(relations) if relations is not None else read.relations


def measured(
    log: LaserLog, poses: FloatArray, relations: FloatArray | None
) -> dict[str, float | int] | None:
    """A trajectory's errors against the relations, or None where there are none."""
    if relations is None:
        return None
    return relation_errors(on_the_relations_clock(log, relations), poses, relations).figures()


def to_tum(t_s: FloatArray, poses: FloatArray) -> str:
    """Lines 't x y z qx qy qz qw' as the TUM tools and evo read them."""
    return "".join(
        f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(0.5 * yaw):.9f} {math.cos(0.5 * yaw):.9f}\n"
        for t, (x, y, yaw) in zip(t_s, poses, strict=True)
    )


def run(log: LaserLog, relations: FloatArray | None, files: ReplayFiles) -> dict[str, Any]:
    """Replay the log; the figures as they stand in the JSON."""
    return {
        "scans": len(log.t_s),
        "lines_skipped": log.skipped,
        "log_time_s": float(log.t_s[-1] - log.t_s[0]),
        "odometry_only": measured(log, log.odom, relations),
    }


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """The figures as a table."""
    rows = [[key, str(value)] for key, value in figures.items()]
    print_table(console, "replay", ["figure", "value"], rows)
