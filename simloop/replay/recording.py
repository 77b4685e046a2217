"""Record a replay for the rerun viewer: map, scans, and the paths by mapper and by odometry."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simloop.messages import FloatArray
from simloop.recording.columns import lifted
from simloop.recording.images import occupancy
from simloop.replay.result import Replay

_TIMELINE = "log_time"
_BASE = "map/base_link"
_COLOURS = {"mapper": [30, 106, 201], "odometry": [200, 170, 60], "closures": [160, 60, 168]}


def record(path: Path, replay: Replay) -> None:
    """Write a recording of the whole replay.

    Args:
        path: the file, ``.rrd``.
        replay: the replay to record.

    Raises:
        OSError: if the file cannot be written.
    """
    import rerun as rr

    # Open the file here first: the library's own error is not an OSError and gives no reason.
    with open(path, "ab"):
        pass
    stream = rr.RecordingStream("simloop_replay")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    try:
        stream.save(path)
    except RuntimeError as error:
        raise OSError(f"cannot record to {path}: {error}") from None
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("map/occupancy", occupancy(replay.map, 0.0), static=True)
    known = np.isfinite(replay.trajectory[:, 0])
    poses, log = replay.trajectory[known], replay.log
    times = log.t_s[: len(known)][known]
    _log_path(stream, "mapper", poses[:, :2])
    _log_path(stream, "odometry", log.odom[: len(known), :2])
    if replay.closures:
        _log_strips(stream, "map/closures", replay.closures, "closures", 0.01)
    if len(poses):
        _send_poses(stream, times, poses)
    _send_scans(stream, replay)
    stream.flush()
    stream.disconnect()


def _log_path(stream: Any, name: str, xy: FloatArray) -> None:
    _log_strips(stream, f"map/trails/{name}", [xy], name, 0.02)


def _log_strips(
    stream: Any, entity: str, strips: Sequence[FloatArray], name: str, r: float
) -> None:
    import rerun as rr

    lines = [lifted(strip, 0.01) for strip in strips]
    stream.log(entity, rr.LineStrips3D(lines, colors=_COLOURS[name], radii=r), static=True)


def _send_poses(stream: Any, t_s: FloatArray, poses: FloatArray) -> None:
    import rerun as rr

    half, zero = 0.5 * poses[:, 2], np.zeros(len(poses))
    turns = np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1)
    columns = rr.Transform3D.columns(translation=lifted(poses[:, :2], 0.0), quaternion=turns)
    stream.send_columns(_BASE, indexes=[_times(t_s)], columns=columns)


def _send_scans(stream: Any, replay: Replay) -> None:
    """Log the keyframes' scans, in base_link."""
    import rerun as rr

    rows = replay.keyframe_points
    if not rows:
        return
    columns = rr.Points3D.columns(positions=lifted(np.concatenate(rows), 0.02))
    stream.log(
        f"{_BASE}/scan", rr.Points3D.from_fields(colors=[214, 48, 48], radii=0.02), static=True
    )
    times = replay.log.t_s[list(replay.keyframes)]
    stream.send_columns(
        f"{_BASE}/scan",
        indexes=[_times(times)],
        columns=columns.partition([len(row) for row in rows]),
    )


def _times(t_s: FloatArray) -> Any:
    import rerun as rr

    return rr.TimeColumn(_TIMELINE, duration=t_s - t_s[0])
