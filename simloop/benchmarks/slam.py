"""Accuracy and speed of the graph mapper on simulated courses with known truth.

The absolute trajectory error (ATE) is computed after the best rigid alignment, and without
alignment from the common start. The relative pose error (RPE) is computed over one metre of path.
See `simloop.evaluation.trajectories`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from scipy.stats import chi2

from simloop.benchmarks.slam_courses import COURSES
from simloop.benchmarks.slam_drive import Drive, drive
from simloop.common.compile_listener import Report, silent
from simloop.common.errors import InputError, did_you_mean
from simloop.common.terminal import print_table
from simloop.evaluation.provenance import machine, versions
from simloop.evaluation.trajectories import absolute_errors, check_evo, relative_errors, rms
from simloop.geometry.se2 import between, compose, wrap_angle
from simloop.graph_slam.mapper import GraphMapper
from simloop.graph_slam.settings import MappingConfig
from simloop.graph_slam.warmup import warm_up
from simloop.mapping.grid_map import GridMap
from simloop.mapping.scan_match import deskew
from simloop.messages import FloatArray
from simloop.worlds.floor_plan import FloorPlan

_RPE_M = 1.0
_SUMMARY = ("course", "seeds", "ate_rmse_max_m", "ate_from_start_max_m", "nees_mean")
_COLUMNS = (
    "way_m",
    "ate_rmse_m",
    "ate_from_start_m",
    "rpe_rmse_m",
    "odometry_ate_rmse_m",
    "nees_mean",
    "map_iou",
    "surface_p95_m",
    "ms_per_scan_p50",
    "ms_per_scan_p99",
    "closures",
)


def run(
    names: Sequence[str] = (),
    seeds: Sequence[int] = (0,),
    progress: Callable[[str, int], None] = lambda text, done: None,
    report: Report = silent,
) -> dict[str, Any]:
    """Drive and map courses.

    Args:
        names: Courses, keys of `COURSES`; empty: all.
        seeds: Seeds of course and sensors; every course is driven with each seed.
        progress: Called before each drive with the course and the number of finished drives.
        report: Called with the name and the number of each kernel before it is compiled.

    Returns:
        What ``simloop bench slam --json`` writes.

    Raises:
        InputError: A course is unknown, or evo is not installed.
    """
    for name in names:
        if name not in COURSES:
            raise InputError(f"--course {name}: unknown{did_you_mean(name, COURSES)}")
    check_evo("bench slam")
    warm_up(report)
    rows: list[dict[str, Any]] = []
    for name in names or COURSES:
        for seed in seeds:
            progress(f"{name}, seed {seed}", len(rows))
            course = COURSES[name](np.random.default_rng([seed, 0x51]))
            driven = drive(course, seed)
            rows.append({"course": name, "seed": seed, **measure(driven)})
    return {
        "courses": rows,
        "summary": summarise(rows),
        "versions": versions(),
        "machine": machine(),
    }


def summarise(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Summarise each course over its seeds: worst errors, and consistency of the covariances.

    ``nees_mean`` is the mean of the runs' means. If the covariances are right, ``nees_band``
    contains with 95 % probability the mean of that many independent errors with three degrees of
    freedom (Bar-Shalom et al. 2001, Sec. 5.4).

    Args:
        rows: Figures of single drives, see `measure`, with ``course``.

    Returns:
        One row for each course.
    """
    summary = []
    for course in dict.fromkeys(row["course"] for row in rows):
        mine = [row for row in rows if row["course"] == course]
        band = [float(chi2.ppf(q, 3 * len(mine)) / len(mine)) for q in (0.025, 0.975)]
        mean = float(np.mean([row["nees_mean"] for row in mine]))
        summary.append(
            {
                "course": course,
                "seeds": len(mine),
                "ate_rmse_max_m": max(row["ate_rmse_m"] for row in mine),
                "ate_from_start_max_m": max(row["ate_from_start_m"] for row in mine),
                "nees_mean": mean,
                "nees_band": band,
                "consistent": band[0] <= mean <= band[1],
            }
        )
    return summary


def measure(driven: Drive) -> dict[str, Any]:
    """Map the scans of a drive and compare the result with the truth.

    Args:
        driven: Scans, odometry and truth of a drive.

    Returns:
        Figures by name; lengths in m, times in ms.
    """
    config = MappingConfig()
    mapper = GraphMapper(config, start=driven.truth[0])
    limits = np.array([driven.scans[0].range_min_m, driven.scans[0].range_max_m])
    each, keyframes = [], []
    for number, (scan, (times, poses)) in enumerate(zip(driven.scans, driven.trails, strict=True)):
        began = perf_counter()
        # Points and beam origins in the base frame at the end of the sweep.
        points, origins = deskew(
            scan.angles_rad,
            scan.ranges_m,
            scan.t_ns - scan.age_ns,
            limits,
            times,
            poses,
            driven.laser,
        )
        if mapper.step(points, origins, poses[-1]):
            keyframes.append(number)
        each.append(1e3 * (perf_counter() - began))
    mapper.finish()
    found, truth = mapper.trajectory(), driven.truth
    odometry = _from_start(truth[0], np.array([poses[-1] for _, poses in driven.trails]))
    iou, surface = map_quality(mapper.map(), driven.floor)
    return {
        "finished": driven.done,
        "scans": len(each),
        "way_m": float(np.hypot(*np.diff(truth[:, :2], axis=0).T).sum()),
        "ate_rmse_m": rms(absolute_errors(truth, found)),
        "ate_from_start_m": float(np.sqrt(np.mean(np.sum((found - truth)[:, :2] ** 2, axis=1)))),
        "rpe_rmse_m": rms(relative_errors(truth, found, _RPE_M, along_reference=False)),
        "odometry_ate_rmse_m": rms(absolute_errors(truth, odometry)),
        "nees_mean": nees(mapper, truth[keyframes]),
        "map_iou": iou,
        "surface_p95_m": surface,
        "ms_per_scan_p50": float(np.percentile(each, 50)),
        "ms_per_scan_p99": float(np.percentile(each, 99)),
        "keyframes": len(keyframes),
        "closures": sum(edge.closure for edge in mapper.graph.edges),
        "scans_unmatched": mapper.unmatched,
    }


def nees(mapper: GraphMapper, truth: FloatArray) -> float:
    """Compute the normalised estimation error squared: mean over the keyframes of e' P^-1 e.

    P is the graph's own covariance; the mean is 3 if P is right. The first keyframe is fixed and
    therefore left out.

    Args:
        mapper: The mapper after the drive.
        truth: (k, 3) true x, y, yaw of the keyframes, m and rad, map frame.

    Returns:
        Mean NEES, without unit.
    """
    poses, covariances = np.array(mapper.graph.poses), mapper.graph.covariances()
    values = []
    for pose, true, covariance in zip(poses[1:], truth[1:], covariances[1:], strict=True):
        error = pose - true
        error[2] = wrap_angle(error[2])
        values.append(float(error @ np.linalg.solve(covariance, error)))
    return float(np.mean(values))


def map_quality(grid: GridMap, floor: FloorPlan) -> tuple[float, float]:
    """Compare a map with the true floor plan.

    A cell is truly free if its centre lies within the arena's bounds and in no obstacle.

    Args:
        grid: The map.
        floor: The true floor plan.

    Returns:
        Intersection over union of the free space; 95th percentile of the distance from the map's
        surfaces to the true ones, m.
    """
    rows, cols = grid.log_odds.shape
    x = grid.origin_m[0] + (np.arange(cols) + 0.5) * grid.resolution_m
    y = grid.origin_m[1] + (np.arange(rows) + 0.5) * grid.resolution_m
    cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    x_min, y_min, x_max, y_max = floor.bounds_m
    inside = (cells > [x_min, y_min]).all(axis=1) & (cells < [x_max, y_max]).all(axis=1)
    free = (inside & (floor.clearance_m(cells) > 0.0)).reshape(rows, cols)
    seen = grid.log_odds < 0.0
    surfaces = grid.surfaces()
    off = np.abs(floor.clearance_m(surfaces))
    return float((free & seen).sum() / (free | seen).sum()), float(np.percentile(off, 95))


def _from_start(start: FloatArray, odometry: FloatArray) -> FloatArray:
    """Compute odometry poses (n, 3) in the map frame, with the first one at ``start`` (3,)."""
    return np.array([compose(start, between(odometry[0], pose)) for pose in odometry])


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """Print a table with one row for each drive, then one with a row for each course.

    Args:
        console: Console to print to.
        figures: The figures from `run`.
    """
    rows = [
        [row["course"], str(row["seed"]), *(f"{row[key]:.4g}" for key in _COLUMNS)]
        for row in figures["courses"]
    ]
    print_table(console, "slam", ["course", "seed", *_COLUMNS], rows)
    rows = [
        [*(f"{one[key]}" for key in _SUMMARY[:2]), *(f"{one[key]:.3g}" for key in _SUMMARY[2:]),
         "{:.3g} to {:.3g}".format(*one["nees_band"])]
        for one in figures["summary"]
    ]  # fmt: skip
    print_table(console, "over all seeds", [*_SUMMARY, "nees_band (95 %)"], rows)
