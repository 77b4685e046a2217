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

from simloop.common.compile_listener import Report, silent
from simloop.common.errors import InputError
from simloop.common.files import check_directory, check_file, write_text
from simloop.common.profiler import Profiler
from simloop.common.terminal import print_table
from simloop.evaluation.provenance import versions
from simloop.graph_slam.map_localiser import MapLocaliser
from simloop.graph_slam.mapper import GraphMapper
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.warmup import warm_up
from simloop.mapping.grid_map import GridMap
from simloop.mapping.map_files import save_map
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog, ScanReader
from simloop.replay.read_log import read_log
from simloop.replay.relations import on_the_relations_clock, read_relations, relation_errors
from simloop.replay.result import Replay

STDOUT = Path("-")


@dataclass(frozen=True, slots=True)
class ReplayFiles:
    """What a replay writes; None where nobody asked. figures: ``-`` is the standard output."""

    directory: Path | None
    figures: Path | None

    def check(self, *read: Path | None) -> None:
        """Raise InputError for what cannot be written, or would take the place of an input."""
        sources = {path.resolve() for path in read if path is not None}
        if self.directory is not None:
            check_directory(self.directory, "--out")
            for file in (self.map_file, self.map_file.with_suffix(".pgm"), self.trajectory):
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
    prior: GridMap | None = None,
    go_on: Callable[[int], bool] = lambda done: True,
    report: Report = silent,
) -> Replay:
    """Map the log's scans in their order, or find the robot in a ``prior`` map.

    go_on: asked after each scan, with their number; False ends the replay there. report: hears of
    each kernel that is compiled, which no figure counts.
    """
    config = config if config is not None else MappingConfig()
    profiler, reader = Profiler(), ScanReader(log, config.range_max_m)
    course = _Mapping(config, profiler) if prior is None else _Tracking(prior, config, profiler)
    warm_up(report)
    each = []
    began = perf_counter()
    for scan in range(len(log.t_s)):
        start = perf_counter()
        course.take(scan, *reader.points(scan), log.odom[scan])
        each.append(perf_counter() - start)
        if not go_on(scan + 1):
            break
    poses = course.finish()
    wall_s = perf_counter() - began
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
        "lines_skipped": log.skipped,
        **course.figures(),
        "relations": measured(log, poses, relations),
        "odometry_only": measured(log, log.odom[:count], relations),
        "stages": profiler.summary(wall_s),
        "versions": versions(),
    }
    return Replay(log, poses, course.keyframes, course.keyframe_points, course.closures,
                  course.map, figures)  # fmt: skip


class _Mapping:
    """Scans into the mapper."""

    def __init__(self, config: MappingConfig, profiler: Profiler) -> None:
        self._mapper = GraphMapper(config, profiler)
        self.keyframes: list[int] = []

    def take(self, scan: int, points: FloatArray, origins: FloatArray, odom: FloatArray) -> None:
        if self._mapper.step(points, origins, odom):
            self.keyframes.append(scan)

    def finish(self) -> FloatArray:
        self._mapper.finish()
        return self._mapper.trajectory()

    def figures(self) -> dict[str, Any]:
        return {
            "scans_unmatched": self._mapper.unmatched,
            "keyframes": len(self.keyframes),
            "closures": len(self.closures),
        }

    @property
    def keyframe_points(self) -> list[FloatArray]:
        return self._mapper.keyframe_points

    @property
    def closures(self) -> list[FloatArray]:
        graph = self._mapper.graph
        return [
            np.array([graph.poses[edge.first][:2], graph.poses[edge.second][:2]])
            for edge in graph.edges
            if edge.closure
        ]

    @property
    def map(self) -> GridMap:
        return self._mapper.map()


class _Tracking:
    """Scans into a map that is given; where the robot is lost, no pose."""

    closures: tuple[FloatArray, ...] = ()

    def __init__(self, grid: GridMap, config: MappingConfig, profiler: Profiler) -> None:
        self.map, self._localiser = grid, MapLocaliser(grid, config)
        self._time = profiler.stage("match")
        self._poses: list[FloatArray] = []
        self.keyframes: list[int] = []
        self.keyframe_points: list[FloatArray] = []

    def take(self, scan: int, points: FloatArray, origins: FloatArray, odom: FloatArray) -> None:
        with self._time:
            found = self._localiser.step(points, odom)
        self._poses.append(self._localiser.pose if found else np.full(3, np.nan))
        if found:
            self.keyframes.append(scan)
            self.keyframe_points.append(points)

    def finish(self) -> FloatArray:
        return np.array(self._poses)

    def figures(self) -> dict[str, Any]:
        return {
            "scans_lost": len(self._poses) - len(self.keyframes),
            "relocalised": self._localiser.relocalised,
        }


def write(replay: Replay, files: ReplayFiles) -> None:
    """Map, trajectory and recording, where they were asked for."""
    if files.directory is None:
        return
    from simloop.replay.recording import record

    try:
        files.directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {files.directory}: cannot be made: {error.strerror}") from None
    save_map(replay.map, files.map_file)
    known = np.isfinite(replay.trajectory[:, 0])
    times = replay.log.t_s[: len(replay.trajectory)]
    write_text(files.trajectory, to_tum(times[known], replay.trajectory[known]))
    record(files.recording, replay)


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
