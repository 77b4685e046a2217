"""``simloop replay``: a log in, figures, map, trajectory and recording out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console

from simloop.compile_listener import Report, silent
from simloop.errors import InputError
from simloop.mapping.map_file import save_map
from simloop.mapping.mapper import GraphMapper
from simloop.mapping.settings import MappingConfig
from simloop.mapping.warmup import warm_up
from simloop.messages import FloatArray
from simloop.metrics import versions
from simloop.outputs import check_directory, check_file, write_text
from simloop.profiler import Profiler
from simloop.replay.laser_log import LaserLog, ScanReader, read_log
from simloop.replay.relations import on_the_relations_clock, read_relations, relation_errors
from simloop.report import print_table

STDOUT = Path("-")


@dataclass(frozen=True, slots=True)
class ReplayFiles:
    """What a replay writes; None where nobody asked. figures: ``-`` is the standard output."""

    directory: Path | None
    figures: Path | None

    def check(self, log: Path, relations: Path | None) -> None:
        """Raise InputError for what cannot be written, or would take the place of an input."""
        sources = {path.resolve() for path in (log, relations) if path is not None}
        if self.directory is not None:
            check_directory(self.directory, "--out")
            for file in (self.map_file, self.trajectory, self.recording):
                if file.resolve() in sources:
                    raise InputError(f"--out {self.directory}: would overwrite {file}")
        if self.figures is not None and self.figures != STDOUT:
            check_file(self.figures, "--json")
            if self.figures.resolve() in sources:
                raise InputError(f"--json {self.figures}: would overwrite what is read")

    @property
    def map_file(self) -> Path:
        return self._in("map.yaml")

    @property
    def trajectory(self) -> Path:
        return self._in("trajectory.tum")

    @property
    def recording(self) -> Path:
        return self._in("replay.rrd")

    def _in(self, name: str) -> Path:
        assert self.directory is not None
        return self.directory / name


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A log's scans mapped, as far as they were: ``figures`` of it, and what made them."""

    log: LaserLog
    mapper: GraphMapper
    trajectory: FloatArray
    keyframes: list[int]
    figures: dict[str, Any]


def load(log: Path, relations: Path | None) -> tuple[LaserLog, FloatArray | None]:
    """The log, and the relations to measure it by: the file's, or else the log's own."""
    read = read_log(log)
    return read, read_relations(relations) if relations is not None else read.relations


def measured(
    log: LaserLog, poses: FloatArray, relations: FloatArray | None
) -> dict[str, float | int] | None:
    """A trajectory's errors against the relations, or None where there are none.

    poses: (n, 3) of the log's first n scans.
    """
    if relations is None:
        return None
    clock = on_the_relations_clock(log, relations)[: len(poses)]
    return relation_errors(clock, poses, relations).figures()


def to_tum(t_s: FloatArray, poses: FloatArray) -> str:
    """Lines 't x y z qx qy qz qw' as the TUM tools and evo read them."""
    return "".join(
        f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(0.5 * yaw):.9f} {math.cos(0.5 * yaw):.9f}\n"
        for t, (x, y, yaw) in zip(t_s, poses, strict=True)
    )


def run(
    log: LaserLog,
    relations: FloatArray | None,
    config: MappingConfig | None = None,
    go_on: Callable[[int], bool] = lambda done: True,
    report: Report = silent,
) -> Replay:
    """Map the log's scans in their order.

    go_on: asked after each scan, with their number; False ends the replay there. report: hears of
    each kernel that is compiled, which no figure counts.
    """
    config = config if config is not None else MappingConfig()
    profiler = Profiler()
    mapper, reader = GraphMapper(config, profiler), ScanReader(log, config.range_max_m)
    warm_up(report)
    keyframes, each = [], []
    began = perf_counter()
    for scan in range(len(log.t_s)):
        start = perf_counter()
        points, origins = reader.points(scan)
        if mapper.step(points, origins, log.odom[scan]):
            keyframes.append(scan)
        each.append(perf_counter() - start)
        if not go_on(scan + 1):
            break
    mapper.finish()
    wall_s = perf_counter() - began
    poses = mapper.trajectory()
    count = len(poses)
    log_s = float(log.t_s[count - 1] - log.t_s[0])
    figures = {
        "scans": count,
        "interrupted": count < len(log.t_s),
        "log_time_s": log_s,
        "wall_time_s": wall_s,
        "real_time_factor": log_s / wall_s,
        **_percentiles("ms_per_scan", 1e3 * np.array(each)),
        **_percentiles("match_ms", np.array(profiler.stage("match").milliseconds)),
        "scans_unmatched": mapper.unmatched,
        "lines_skipped": log.skipped,
        "keyframes": len(keyframes),
        "closures": sum(edge.closure for edge in mapper.graph.edges),
        "relations": measured(log, poses, relations),
        "odometry_only": measured(log, log.odom[:count], relations),
        "stages": profiler.summary(wall_s),
        "versions": versions(),
    }
    return Replay(log, mapper, poses, keyframes, figures)


def write(replay: Replay, files: ReplayFiles) -> None:
    """Map, trajectory and recording, where they were asked for."""
    if files.directory is None:
        return
    from simloop.replay.recording import record

    try:
        files.directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {files.directory}: cannot be made: {error.strerror}") from None
    grid = replay.mapper.map()
    save_map(grid, files.map_file)
    times = replay.log.t_s[: len(replay.trajectory)]
    write_text(files.trajectory, to_tum(times, replay.trajectory))
    record(files.recording, replay, grid)


def _percentiles(name: str, milliseconds: FloatArray) -> dict[str, float | None]:
    """p50 and p99, or None where nothing was timed."""
    some = milliseconds.size > 0
    return {
        f"{name}_p{p}": float(np.percentile(milliseconds, p)) if some else None for p in (50, 99)
    }


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """The figures as a table."""
    rows = []
    for key, value in figures.items():
        if key in ("versions", "stages"):
            continue
        parts = value.items() if isinstance(value, dict) else [("", value)]
        for name, part in parts:
            text = f"{part:.4g}" if isinstance(part, float) else str(part)
            rows.append([f"{key}.{name}".rstrip("."), text])
    print_table(console, "replay", ["figure", "value"], rows)
