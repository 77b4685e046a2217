"""Run a replay: make trajectory, map and figures from a log."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from simloop.common.compile_listener import Report, silent
from simloop.common.errors import InputError
from simloop.common.profiler import Profiler, peak_memory_mb
from simloop.evaluation.provenance import versions
from simloop.evaluation.trajectories import check_evo, compare
from simloop.geometry.se2 import transform_points
from simloop.graph_slam.map_localiser import MapLocaliser
from simloop.graph_slam.mapper import GraphMapper
from simloop.graph_slam.scan_fit import LEAST_POINTS
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.warmup import warm_up
from simloop.mapping.grid_map import GridMap
from simloop.mapping.map_files import load_map
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog, ScanReader
from simloop.replay.read_log import read_log
from simloop.replay.reference import with_reference
from simloop.replay.relations import RelationErrors, measure_relations, read_relations
from simloop.replay.result import Replay

_FINEST_M, _COARSEST_M = 0.005, 1.0  # cells of a map that a scan is searched in
_MOST_FAILED = 0.5  # a result is worthless if more of the scans failed


def load(
    log: Path, relations: Path | None, reference: Path | None = None
) -> tuple[LaserLog, FloatArray | None]:
    """Read a log, and the relations and the reference that measure its trajectory.

    Args:
        log: the log's file.
        relations: a file of relations; None for the relations in the log's own file, if any.
        reference: a TUM file; None for the reference in the log's own file, if any.

    Returns:
        The log with the reference, and the relations (m, 5) or None.

    Raises:
        InputError: if a file cannot be read, if relations or reference do not belong to the log,
            or if evo is needed and not installed.
    """
    read = read_log(log)
    given = read_relations(relations) if relations is not None else read.relations
    # Tell what is wrong now, not after the replay.
    if given is not None:
        measure_relations(read, read.odom, given)
    if reference is not None:
        read = with_reference(read, reference)
    if read.reference is not None:
        check_evo("a reference")
    return read, given


def load_prior(path: Path, config: MappingConfig) -> GridMap:
    """Read a map to localise the robot in.

    Args:
        path: the map's YAML file.
        config: settings.

    Returns:
        The map.

    Raises:
        InputError: if it cannot be read, or if its cells are too small or too large to search in.
    """
    grid = load_map(path, config.grid)
    if not _FINEST_M <= grid.resolution_m <= _COARSEST_M:
        raise InputError(
            f"--map {path}: resolution {grid.resolution_m:g}: must be from {_FINEST_M:g} to "
            f"{_COARSEST_M:g} m"
        )
    return grid


def measure(
    log: LaserLog, poses: FloatArray, relations: FloatArray | None
) -> RelationErrors | None:
    """Measure a trajectory by relations.

    Args:
        log: the log.
        poses: (n, 3) base_link at the log's first n scans.
        relations: (m, 5) as from ``read_relations``; None if there are none.

    Returns:
        The errors; None without relations, or if none lies within these poses.
    """
    if relations is None:
        return None
    try:
        return measure_relations(log, poses, relations)
    except InputError:  # the replay was stopped early
        return None


def _judged(log: LaserLog, poses: FloatArray, relations: FloatArray | None) -> dict[str, Any]:
    """Return the errors of the trajectory and of the odometry, by relations and reference."""
    figures: dict[str, Any] = {}
    count = len(poses)
    for by_relations, by_reference, some in (
        ("relations", "reference", poses),
        ("odometry_only", "odometry_only_reference", log.odom[:count]),
    ):
        errors = measure(log, some, relations)
        figures[by_relations] = errors and errors.figures()
        compared = None if log.reference is None else compare(log.reference[:count], some)
        figures[by_reference] = compared and compared.figures()
    return figures


def run(
    log: LaserLog,
    relations: FloatArray | None,
    config: MappingConfig | None = None,
    prior: GridMap | None = None,
    go_on: Callable[[int], bool] = lambda done: True,
    report: Report = silent,
) -> Replay:
    """Map a log's scans in their order, or localise the robot in a given map.

    Args:
        log: the log.
        relations: (m, 5) relations that measure the trajectory; None if there are none.
        config: settings; None for the defaults.
        prior: a map to localise the robot in; None to make one.
        go_on: called after each scan with the number of scans done; False ends the replay.
        report: called for each kernel that is compiled. The figures do not include this time.

    Returns:
        The result for all replayed scans.
    """
    config = config if config is not None else MappingConfig()
    profiler, reader = Profiler(), ScanReader(log, config.range_max_m)
    task = _Mapping(config, profiler) if prior is None else _Tracking(prior, config, profiler)
    warm_up(report)  # before the clock starts
    each = []
    began = perf_counter()
    for scan in range(len(log.t_s)):
        start = perf_counter()
        task.step(scan, *reader.points(scan), log.odom[scan])
        each.append(perf_counter() - start)
        if not go_on(scan + 1):
            break
    poses = task.finish()
    wall_s = perf_counter() - began
    count = len(poses)
    log_s = float(log.t_s[count - 1] - log.t_s[0]) if log.measured else None
    result = task.figures()
    worthless = judge(count, result)
    figures = {
        "scans": count,
        "interrupted": count < len(log.t_s),
        "log_time_s": log_s,
        "wall_time_s": wall_s,
        "real_time_factor": None if log_s is None else log_s / wall_s,
        **_percentiles("ms_per_scan", 1e3 * np.array(each)),
        **_percentiles("match_ms", np.array(profiler.stage("match").milliseconds)),
        "lines_skipped": log.skipped,
        **result,
        **_judged(log, poses, relations),
        "peak_memory_mb": peak_memory_mb(),
        "worthless": worthless,
        "notes": [*log.notes, *reader.notes, *task.notes()],
        "stages": profiler.summary(wall_s),
        "versions": versions(),
    }
    return Replay(
        log, poses, task.keyframes, task.keyframe_points, task.closures, task.map, figures,
        relations, task.unfitted, 1e3 * np.array(each), config.range_max_m,
    )  # fmt: skip


def judge(scans: int, figures: dict[str, Any]) -> str | None:
    """Judge whether the result of a replay is of any use.

    Args:
        scans: number of replayed scans.
        figures: the task's figures.

    Returns:
        Why it is worthless; None if it is not.
    """
    if figures["occupied_cells"] == 0:
        blind = figures["scans_blind"]
        return f"the map is empty: {blind} of {scans} scans have fewer than {LEAST_POINTS} hits"
    for name, what in (("scans_unmatched", "fitted nowhere"), ("scans_lost", "were not localised")):
        if figures.get(name, 0) > _MOST_FAILED * scans:
            return f"{figures[name]} of {scans} scans {what}"
    return None


class _Mapping:
    """Task that gives the scans to the mapper."""

    def __init__(self, config: MappingConfig, profiler: Profiler) -> None:
        self._mapper = GraphMapper(config, profiler)
        self._blind = 0
        self.keyframes: list[int] = []
        self.unfitted: list[int] = []

    def step(self, scan: int, points: FloatArray, origins: FloatArray, odom: FloatArray) -> None:
        self._blind += len(points) < LEAST_POINTS
        before = self._mapper.unmatched
        if self._mapper.step(points, origins, odom):
            self.keyframes.append(scan)
        if self._mapper.unmatched > before:
            self.unfitted.append(scan)

    def finish(self) -> FloatArray:
        self._mapper.finish()
        return self._mapper.trajectory()

    def figures(self) -> dict[str, Any]:
        return {
            "scans_unmatched": self._mapper.unmatched,
            "scans_blind": self._blind,
            "keyframes": len(self.keyframes),
            "closures": len(self.closures),
            "occupied_cells": int(np.count_nonzero(self.map.occupied)),
        }

    def notes(self) -> list[str]:
        outside = self._hits_outside()
        return [f"{outside} hits lie outside the largest map, and are not in it"] if outside else []

    def _hits_outside(self) -> int:
        """Count the keyframes' hits that the map has no room for."""
        grid, outside = self.map, 0
        size = grid.resolution_m * np.array(grid.log_odds.shape[::-1])
        for points, pose in zip(self.keyframe_points, self._mapper.graph.poses, strict=True):
            off = transform_points(pose, points) - grid.origin_m
            outside += int(np.count_nonzero(((off < 0.0) | (off > size)).any(axis=1)))
        return outside

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

    @cached_property
    def map(self) -> GridMap:
        return self._mapper.map()


class _Tracking:
    """Task that localises each scan in a given map. While the robot is lost, the pose is NaN."""

    closures: tuple[FloatArray, ...] = ()

    def __init__(self, grid: GridMap, config: MappingConfig, profiler: Profiler) -> None:
        self.map, self._localiser = grid, MapLocaliser(grid, config)
        self._time = profiler.stage("match")
        self._poses: list[FloatArray] = []
        self._blind = 0
        self.keyframes: list[int] = []
        self.keyframe_points: list[FloatArray] = []
        self.unfitted: list[int] = []

    def step(self, scan: int, points: FloatArray, origins: FloatArray, odom: FloatArray) -> None:
        self._blind += len(points) < LEAST_POINTS
        with self._time:
            found = self._localiser.step(points, odom)
        self._poses.append(self._localiser.pose if found else np.full(3, np.nan))
        if found:
            self.keyframes.append(scan)
            self.keyframe_points.append(points)
        else:
            self.unfitted.append(scan)

    def finish(self) -> FloatArray:
        return np.array(self._poses)

    def figures(self) -> dict[str, Any]:
        return {
            "scans_lost": len(self._poses) - len(self.keyframes),
            "scans_blind": self._blind,
            "relocalised": self._localiser.relocalised,
            "occupied_cells": int(np.count_nonzero(self.map.occupied)),
        }

    def notes(self) -> list[str]:
        return []


def _percentiles(name: str, milliseconds: FloatArray) -> dict[str, float | None]:
    """Compute the median and the 99th percentile; None if nothing was timed."""
    some = milliseconds.size > 0
    return {
        f"{name}_p{p}": float(np.percentile(milliseconds, p)) if some else None for p in (50, 99)
    }
