"""Read reference trajectories, and match them to the scans of a log.

A reference comes from another SLAM or from a tracking system. It is not the truth.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.common.limits import LOG_SCANS
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog
from simloop.replay.relations import clock_of, read_rows

_MOST_APART_S = 0.1  # between a pose and its scan, if half the usual scan step is not less
_MOST = np.array([1e12, 1e8, 1e8, 1e8, 1e6, 1e6, 1e6, 1e6])  # t x y z qx qy qz qw
_LEVEL_M, _LEVEL_RAD = 0.05, 0.02  # smaller heights and tilts are not worth a note


def read_tum(path: Path) -> tuple[FloatArray, list[str]]:
    """Read a trajectory in the format of the TUM tools and evo.

    Args:
        path: a text file with lines 't x y z qx qy qz qw', s, m.

    Returns:
        (n, 4) t, x, y, yaw in the order of the times, s, m, rad; and what was left out, one
        sentence each.

    Raises:
        InputError: if the file or one of its lines cannot be read.
    """
    name = f"--reference {path}"
    rows = read_rows("--reference", path, (8,), "t x y z qx qy qz qw", 10 * LOG_SCANS, "pose")
    table = np.array([[number, *row] for number, row in rows])
    good = (np.abs(table[:, 1:]) <= _MOST).all(axis=1)  # False for NaN
    norm = np.hypot.reduce(np.where(good[:, None], table[:, 5:], 1.0), axis=1)
    good &= np.abs(norm - 1.0) < 0.1
    if not good.all():
        raise InputError(
            f"{name}, line {table[np.argmin(good), 0]:.0f}: times must lie within 1e12 s and "
            "places within 1e8 m, and qx qy qz qw must have the length 1"
        )
    return _in_plane(table[:, 1:], name)


def _in_plane(table: FloatArray, name: str) -> tuple[FloatArray, list[str]]:
    """Convert rows (n, 8) to (n, 4) t, x, y, yaw in the order of the times."""
    notes = []
    if (np.diff(table[:, 0]) < 0.0).any():
        notes.append(f"{name}: the times do not rise; its poses are put in their order")
        table = table[np.argsort(table[:, 0], kind="stable")]
    qx, qy, qz, qw = (table[:, 4:] / np.linalg.norm(table[:, 4:], axis=1)[:, None]).T
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    # The angle between the body's z axis and the vertical.
    tilt = float(np.arccos(np.clip(1.0 - 2.0 * (qx * qx + qy * qy), -1.0, 1.0)).max())
    high = float(np.ptp(table[:, 3]))
    if high > _LEVEL_M or tilt > _LEVEL_RAD:
        notes.append(
            f"{name}: only x, y and yaw are compared; z differs by up to {high:.2g} m, and the "
            f"poses tilt by up to {np.degrees(tilt):.2g} deg"
        )
    return np.column_stack([table[:, :3], yaw]), notes


def with_reference(log: LaserLog, path: Path) -> LaserLog:
    """Give the poses of a file to the scans of a log.

    Each pose goes to the nearest scan, if it is not farther away in time than 0.1 s or half the
    usual time between two scans, whichever is less. Of several poses a scan gets the nearest.

    Args:
        log: the log.
        path: a file as in ``read_tum``, with times by a clock of the log.

    Returns:
        The log with this reference, and with a note on how many poses were matched.

    Raises:
        InputError: if the file cannot be read, or if no pose belongs to a scan.
    """
    poses, notes = read_tum(path)
    t_s = (log.clocks_s or (log.t_s,))[clock_of(log, poses[:, 0])]
    scans = np.flatnonzero(np.isfinite(t_s))
    if not len(scans):
        raise InputError("the log has no clock that rises, so no reference can be placed in it")
    most_s = _MOST_APART_S
    if len(scans) > 1:
        most_s = min(most_s, 0.5 * float(np.median(np.diff(t_s[scans]))))
    nearest, apart_s = _nearest(t_s[scans], poses[:, 0])
    found = np.full((len(t_s), 3), np.nan)
    # The nearest pose of a scan is written last. The margin is for times that were rounded.
    used = np.flatnonzero(apart_s <= most_s + 1e-6)
    used = used[np.argsort(-apart_s[used], kind="stable")]
    found[scans[nearest[used]]] = poses[used, 1:]
    count = int(np.count_nonzero(np.isfinite(found[:, 0])))
    matched = (
        f"{count} of {len(t_s)} scans have one of its {len(poses)} poses within {most_s:.2g} s"
    )
    if not count:
        raise InputError(f"--reference {path}: {matched}; does it belong to another log?")
    notes = [*log.notes, *notes, f"--reference {path}: {matched}"]
    return replace(log, reference=found, notes=tuple(notes))


def _nearest(t_s: FloatArray, when_s: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Return (k,) the index of the time nearest to each instant, and how far away it is, s."""
    after = np.clip(np.searchsorted(t_s, when_s), 0, len(t_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(when_s - t_s[before]) <= np.abs(t_s[after] - when_s), before, after)
    return nearest, np.abs(t_s[nearest] - when_s)
