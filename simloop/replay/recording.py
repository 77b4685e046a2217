"""Record a replay for the rerun viewer: map, scans, paths, and the errors over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simloop.evaluation.trajectories import absolute_errors, aligned
from simloop.messages import FloatArray
from simloop.recording.blueprint import arrange, make_plot, make_scene
from simloop.recording.columns import lifted
from simloop.recording.images import occupancy
from simloop.recording.stream import TIMELINE, RecordingFile
from simloop.replay.result import Replay

if TYPE_CHECKING:
    import rerun.blueprint as rrb

_BASE = "map/base_link"
_COLOURS = {
    "mapper": [30, 106, 201],
    "odometry": [200, 170, 60],
    "reference": [217, 119, 6],
    "closures": [160, 60, 168],
    "unfitted": [214, 48, 48],
}


def record(path: Path, replay: Replay) -> None:
    """Write a recording of the whole replay. Its time begins at the first scan.

    Args:
        path: the file, ``.rrd``.
        replay: the replay to record.

    Raises:
        OSError: if the file cannot be written.
    """
    file = RecordingFile(path, _blueprint(replay), "replay")
    try:
        _log_static(file, replay)
        known = np.isfinite(replay.trajectory[:, 0])
        if known.any():
            _send_poses(file, _times_ns(replay)[known], replay.trajectory[known])
        _send_scans(file, replay)
        _send_plots(file, replay)
        file.flush()
        if not file.is_open:
            raise OSError(f"cannot record to {path}: it is cut off")
    except BaseException:
        file.close(whole=False)
        file.path.unlink(missing_ok=True)
        raise
    file.close()


def _blueprint(replay: Replay) -> rrb.Blueprint:
    """Arrange the map on the left, and the plots on the right."""
    import rerun.blueprint as rrb

    grid = replay.map
    size = grid.resolution_m * np.array(grid.log_odds.shape[::-1])
    bounds = np.concatenate([grid.origin_m, grid.origin_m + size])
    plots = [make_plot("Time of a scan, ms", "scan_ms"), make_plot("Fits nowhere", "unfitted")]
    if replay.compared() is not None:
        plots.insert(0, make_plot("Error to the reference, m", "error_reference"))
    scene = make_scene(bounds, "Map, trajectory and scans")
    return arrange(scene, rrb.Vertical(*plots), TIMELINE)


def _log_static(file: RecordingFile, replay: Replay) -> None:
    """Log what holds for the whole replay: the map, and the paths in it."""
    rr = file.rr
    file.log_static("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    file.log_static("map/occupancy", occupancy(replay.map, 0.0))
    found, compared = replay.trajectory, replay.compared()
    paths = {"mapper": found[np.isfinite(found[:, 0])], "odometry": replay.log.odom[: len(found)]}
    if compared is not None:
        reference, both = compared
        paths["reference"] = aligned(reference[both], found[both])
    for name, poses in paths.items():
        _log_strips(file, f"map/trails/{name}", [poses[:, :2]], name, 0.02)
    if replay.closures:
        _log_strips(file, "map/closures", replay.closures, "closures", 0.01)
    marked = found[list(replay.unfitted), :2]
    marked = marked[np.isfinite(marked[:, 0])]
    if len(marked):
        points = rr.Points3D(lifted(marked, 0.03), colors=_COLOURS["unfitted"], radii=0.08)
        file.log_static("map/unfitted", points)


def _log_strips(
    file: RecordingFile, entity: str, strips: Sequence[FloatArray], name: str, r: float
) -> None:
    lines = [lifted(strip, 0.01) for strip in strips]
    file.log_static(entity, file.rr.LineStrips3D(lines, colors=_COLOURS[name], radii=r))


def _send_poses(file: RecordingFile, t_ns: Any, poses: FloatArray) -> None:
    half, zero = 0.5 * poses[:, 2], np.zeros(len(poses))
    wxyz = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)
    file.send_transforms(_BASE, t_ns, lifted(poses[:, :2], 0.0), wxyz)


def _send_scans(file: RecordingFile, replay: Replay) -> None:
    """Log the keyframes' scans, in base_link."""
    if not replay.keyframe_points:
        return
    look = file.rr.Points3D.from_fields(colors=[214, 48, 48], radii=0.02)
    file.log_static(f"{_BASE}/scan", look)
    t_ns = _times_ns(replay)[list(replay.keyframes)]
    file.send_points(f"{_BASE}/scan", t_ns, replay.keyframe_points, 0.02)


def _send_plots(file: RecordingFile, replay: Replay) -> None:
    """Log what changes from scan to scan."""
    t_ns, compared = _times_ns(replay), replay.compared()
    if compared is not None:
        reference, both = compared
        for name, poses in (("mapper", replay.trajectory), ("odometry", replay.log.odom)):
            errors = absolute_errors(reference[both], poses[: len(both)][both])
            entity = f"error_reference/{name}"
            look = file.rr.SeriesLines(names=name, colors=_COLOURS[name])
            file.log_static(f"plots/{entity}", look)
            file.send_scalars(entity, t_ns[both], errors)
    unfitted = np.zeros(len(t_ns))
    unfitted[list(replay.unfitted)] = 1.0
    file.send_scalars("unfitted", t_ns, unfitted)
    file.send_scalars("scan_ms", t_ns, replay.scan_ms)


def _times_ns(replay: Replay) -> Any:
    """Return (n,) the time since the first scan, ns."""
    t_s = replay.log.t_s[: len(replay.trajectory)]
    return np.round(1e9 * (t_s - t_s[0])).astype(np.int64)
