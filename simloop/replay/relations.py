"""Measure trajectories by true relative poses (Kuemmerle et al. 2009).

The paper is "On measuring the accuracy of SLAM algorithms". A relation is the true pose at time t2
in the frame of the pose at t1. Its error is the motion from the true pose to the estimated one, in
the frame of the true one. The lengths of the errors' translations, and the sizes of their
rotations, are averaged over all relations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.geometry.se2 import wrap_angles
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog

MOST_GAP_S = 1.0
"""Poses are interpolated only between scans that are at most this far apart in time, s."""


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Errors of a trajectory, measured by relations.

    Attributes:
        translation_mean_m: mean length of the errors' translations.
        translation_std_m: standard deviation of these lengths.
        rotation_mean_deg: mean size of the errors' rotations, degrees.
        count: number of relations used.
        left_out: number of relations in a gap of the log, or outside its time.
    """

    translation_mean_m: float
    translation_std_m: float
    rotation_mean_deg: float
    count: int
    left_out: int

    def figures(self) -> dict[str, float | int]:
        """Return the values by name, for the JSON.

        Returns:
            Name to value.
        """
        return {name: getattr(self, name) for name in self.__slots__}


def read_relations(path: Path) -> FloatArray:
    """Read a file of relations.

    Args:
        path: a text file with lines 't1 t2 x y z roll pitch yaw' or 't1 t2 dx dy dyaw', s, m, rad.

    Returns:
        (m, 5) t1, t2, dx, dy, dyaw.

    Raises:
        InputError: if the file or one of its lines cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise InputError(f"--relations {path}: {reason}") from None
    rows = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) not in (5, 8) or not all(map(math.isfinite, row)):
            raise InputError(
                f"--relations {path}, line {number}: must be t1 t2 x y z roll pitch yaw, "
                "or t1 t2 dx dy dyaw, all numbers"
            )
        rows.append([*row[:4], row[-1]])
    if not rows:
        raise InputError(f"--relations {path}: the file has no relation")
    return np.array(rows)


def times_on_relations_clock(log: LaserLog, relations: FloatArray) -> FloatArray:
    """Choose the clock of the log by which the relations were recorded.

    Args:
        log: a log with one or more clocks.
        relations: (m, 5) as from ``read_relations``.

    Returns:
        (n,) the scans' times, s, by the clock whose span contains most of the relations' times.
    """

    def count_within(clock: FloatArray) -> int:
        times = relations[:, :2]
        return int(np.count_nonzero((times >= clock.min()) & (times <= clock.max())))

    rising = [clock for clock in (log.t_s, *log.clocks_s) if np.all(np.diff(clock) > 0.0)]
    return max(rising, key=count_within)


def interpolate_poses(t_s: FloatArray, poses: FloatArray, when_s: FloatArray) -> FloatArray:
    """Interpolate a trajectory, linearly in x and y and over the shorter turn in yaw.

    Args:
        t_s: (n,) times of the poses, rising, s.
        poses: (n, 3) poses x, y, yaw, m, m, rad.
        when_s: (m,) times to interpolate at, s.

    Returns:
        (m, 3) poses; NaN in a gap longer than ``MOST_GAP_S`` and outside the trajectory. At the
        exact time of a pose the result is that pose, even beside a gap.
    """
    after = np.clip(np.searchsorted(t_s, when_s, side="left"), 0, len(t_s) - 1)
    exact = t_s[after] == when_s
    before = np.where(exact, after, after - 1)
    inside = exact | ((when_s > t_s[0]) & (when_s < t_s[-1]))
    before = np.maximum(before, 0)
    span = t_s[after] - t_s[before]
    known = inside & (span <= MOST_GAP_S)
    share = np.where(span > 0.0, (when_s - t_s[before]) / np.where(span > 0.0, span, 1.0), 0.0)
    step = poses[after] - poses[before]
    step[:, 2] = wrap_angles(step[:, 2])
    out = poses[before] + share[:, None] * step
    out[:, 2] = wrap_angles(out[:, 2])
    out[~known] = np.nan
    return out


def relation_errors(t_s: FloatArray, poses: FloatArray, relations: FloatArray) -> RelationErrors:
    """Measure a trajectory by relations.

    Args:
        t_s: (n,) times, rising, on the relations' clock.
        poses: (n, 3) base_link at these times, in any fixed frame.
        relations: (m, 5) as from ``read_relations``.

    Returns:
        The errors.

    Raises:
        InputError: if no relation lies within the trajectory.
    """
    first, second = (interpolate_poses(t_s, poses, relations[:, k]) for k in (0, 1))
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = (second - first)[:, :2].T
    # The estimated translation in the frame of the first pose, minus the true one.
    off = np.hypot(cos * dx + sin * dy - relations[:, 2], cos * dy - sin * dx - relations[:, 3])
    known = np.isfinite(off)
    count = int(np.count_nonzero(known))
    if count == 0:
        raise InputError("no relation lies within the log's times; do they belong to another log?")
    turned = wrap_angles(second[known, 2] - first[known, 2] - relations[known, 4])
    return RelationErrors(
        float(off[known].mean()),
        float(off[known].std()),
        math.degrees(float(np.abs(turned).mean())),
        count,
        len(relations) - count,
    )
