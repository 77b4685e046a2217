"""Charts of a replay's page: the map beside the same scans at other poses, and errors over time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from simloop.common.html_images import drawn
from simloop.evaluation.trajectories import absolute_errors, aligned, in_both
from simloop.geometry.se2 import transform_points
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray
from simloop.replay.laser_log import ScanReader
from simloop.replay.relations import clock_of
from simloop.replay.result import Replay
from simloop.replay.session import measure

_PATH, _CLOSURE, _UNFITTED, _OTHER = "#1e6ac9", "#a03ca8", "#d63030", "#d97706"
_MOST_SCANS = 3000  # drawn at the poses of the reference
_MOST_PIXELS = 1500  # along a side of the picture of these scans
_LEAST_M = 1e-3  # smaller errors are drawn as this, because the scale is logarithmic
_DPI = 110
_TRAJECTORIES = (("odometry alone", _OTHER), ("mapper", _PATH))


class _Panel(NamedTuple):
    """Errors over time: what they are, the style, and (times, errors) of each trajectory."""

    what: str
    style: str
    lines: list[tuple[FloatArray, FloatArray]]


def beside(replay: Replay) -> tuple[str, FloatArray]:
    """Choose the poses whose scans are drawn beside the map.

    Args:
        replay: the result.

    Returns:
        What they are: the reference, or the odometry if there is none; and (n, 3) poses in the
        frame of the map, m, m, rad, NaN where there is none.
    """
    found, compared = replay.trajectory, replay.compared()
    name, poses = "odometry alone", replay.log.odom[: len(found)]
    if compared is not None:
        name, poses = "the reference", compared[0]
    both, moved = in_both(poses, found), np.full(poses.shape, np.nan)
    if both.any():
        moved[both] = aligned(poses[both], found[both])
    return name, moved


def drawn_scans(replay: Replay) -> int | None:
    """Return how many scans are drawn beside the map.

    Args:
        replay: the result.

    Returns:
        Their number; None if all are.
    """
    chosen = len(_chosen(len(replay.trajectory)))
    return chosen if chosen < len(replay.trajectory) else None


def maps(replay: Replay) -> str:
    """Draw the map with trajectory and closures, and beside it the same scans at other poses.

    Args:
        replay: the result.

    Returns:
        HTML image.
    """
    name, poses = beside(replay)
    hits = _hits(replay, poses)
    low, high = _bounds(replay, hits)
    height, width = (high - low)[::-1]
    figure = Figure(
        figsize=(15.0, 7.2 * float(np.clip(height / width, 0.25, 1.6)) + 0.7),
        layout="constrained",
        dpi=_DPI,
    )
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw_map(left, replay.map)
    left.add_collection(LineCollection(list(replay.closures), colors=_CLOSURE, lw=0.7, alpha=0.7))
    left.plot(replay.trajectory[:, 0], replay.trajectory[:, 1], color=_PATH, lw=0.9)
    marked = replay.trajectory[list(replay.unfitted)]
    left.plot(marked[:, 0], marked[:, 1], "x", color=_UNFITTED, ms=4)
    left.set_title(f"map, {len(replay.closures)} closures", fontsize=9)
    _draw_hits(right, hits, low, high)
    right.plot(poses[:, 0], poses[:, 1], color=_OTHER, lw=0.9)
    right.set_title(f"the same scans at the poses of {name}", fontsize=9)
    for axis in (left, right):
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axis.tick_params(labelsize=7)
        axis.set_xlabel("x, m", fontsize=8)
    return drawn(figure, f"the map, and the same scans at the poses of {name}")


def errors(replay: Replay) -> str:
    """Draw the errors by reference and by relations, and the time of each scan, over time.

    Args:
        replay: the result.

    Returns:
        HTML image.
    """
    panels = [panel for panel in (_by_reference(replay), _by_relations(replay)) if panel]
    figure = Figure(figsize=(15.0, 2.4 * len(panels) + 2.4), layout="constrained", dpi=_DPI)
    axes = figure.subplots(len(panels) + 1, 1, sharex=True, squeeze=False)[:, 0]
    for axis, panel in zip(axes, panels, strict=False):
        for (name, colour), (at_s, off_m) in zip(_TRAJECTORIES, panel.lines, strict=True):
            off_m = np.maximum(off_m, _LEAST_M)
            axis.plot(at_s, off_m, panel.style, color=colour, lw=0.9, ms=3, label=name)
        axis.set_ylabel(panel.what, fontsize=8)
        axis.legend(fontsize=7, loc="upper right")
    t_s = _since_start(replay)
    axes[-1].plot(t_s, np.maximum(replay.scan_ms, 1e-3), ".", color=_PATH, ms=2)
    axes[-1].set_ylabel("time of a scan, ms", fontsize=8)
    for axis in axes:
        axis.set_yscale("log")
        axis.grid(alpha=0.25)
        axis.tick_params(labelsize=7)
        for t in t_s[list(replay.unfitted)]:
            axis.axvline(t, 0.0, 0.06, color=_UNFITTED, lw=0.8)
    axes[-1].set_xlabel("time, s" if replay.log.measured else "scan", fontsize=8)
    return drawn(figure, "errors over time")


def _by_reference(replay: Replay) -> _Panel | None:
    """Compute the position errors against the reference."""
    compared = replay.compared()
    if compared is None:
        return None
    reference, both = compared
    lines = []
    for poses in (replay.log.odom[: len(both)], replay.trajectory):
        known = in_both(reference, poses)
        off = absolute_errors(reference[known], poses[known])
        lines.append((_since_start(replay)[known], off))
    return _Panel("error to the reference, m", "-", lines)


def _by_relations(replay: Replay) -> _Panel | None:
    """Compute the translation errors by relations."""
    log, relations = replay.log, replay.relations
    odometry, mapper = (
        measure(log, poses, relations)
        for poses in (log.odom[: len(replay.trajectory)], replay.trajectory)
    )
    if relations is None or odometry is None or mapper is None or not mapper.count:
        return None
    clock = log.clocks_s[clock_of(log, relations[:, :2])]
    start = clock[np.isfinite(clock)][0]
    lines = [(one.t_s - start, one.off_m) for one in (odometry, mapper)]
    return _Panel("error by relations, m", ".", lines)


def _since_start(replay: Replay) -> FloatArray:
    return replay.log.t_s[: len(replay.trajectory)] - replay.log.t_s[0]


def _chosen(count: int) -> list[int]:
    """Choose the scans that are drawn, evenly."""
    return np.unique(
        np.linspace(0, count - 1, min(count, _MOST_SCANS)).round().astype(int)
    ).tolist()


def _hits(replay: Replay, poses: FloatArray) -> FloatArray:
    """Return (k, 2) the hits of the drawn scans, put at poses (n, 3), in the frame of the map."""
    reader, known = ScanReader(replay.log, replay.range_max_m), np.isfinite(poses[:, 0])
    some = [
        transform_points(poses[scan], reader.points(scan)[0])
        for scan in _chosen(len(poses))
        if known[scan]
    ]
    return np.concatenate([np.zeros((0, 2)), *some])


def _bounds(replay: Replay, hits: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of what is drawn, in map, m."""
    path = replay.trajectory[np.isfinite(replay.trajectory[:, 0]), :2]
    inside = np.concatenate([replay.map.surfaces(), path, np.zeros((0, 2))])
    if not len(inside):
        inside = np.zeros((1, 2))
    low, high = inside.min(axis=0), inside.max(axis=0)
    if len(hits):  # a wrong map may be smaller than the building: show most of the other, too
        low = np.minimum(low, np.quantile(hits, 0.005, axis=0))
        high = np.maximum(high, np.quantile(hits, 0.995, axis=0))
    return low - 1.0, high + 1.0


def _draw_map(axis: Any, grid: GridMap) -> None:
    """Draw a map in the grey values of ROS."""
    grey = np.where(grid.occupied, 0.0, np.where(grid.log_odds < 0.0, 1.0, 0.8))
    x, y = grid.origin_m
    rows, columns = grey.shape
    extent = (x, x + columns * grid.resolution_m, y, y + rows * grid.resolution_m)
    axis.set_facecolor("0.8")  # as unknown cells
    axis.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)


def _draw_hits(axis: Any, hits: FloatArray, low: FloatArray, high: FloatArray) -> None:
    """Draw how many hits lie in each cell, darker for more."""
    cell_m = max(0.05, float((high - low).max()) / _MOST_PIXELS)
    shape = np.maximum(np.ceil((high - low) / cell_m), 1).astype(int)
    edges = [low[k] + cell_m * np.arange(shape[k] + 1) for k in (0, 1)]
    count = np.histogram2d(hits[:, 0], hits[:, 1], bins=edges)[0].T
    extent = (edges[0][0], edges[0][-1], edges[1][0], edges[1][-1])
    dark = np.minimum(np.sqrt(count) / 3.0, 1.0)
    axis.imshow(dark, cmap="gray_r", vmin=0.0, vmax=1.0, origin="lower", extent=extent)
