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
from simloop.common.input_files import read_text
from simloop.common.limits import RELATIONS, check_limit
from simloop.geometry.se2 import wrap_angles
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog

MOST_GAP_S = 1.0
"""Poses are interpolated only between scans that are at most this far apart in time, s."""


IMPLAUSIBLE = (
    "numbers must be finite, times within 1e12 s, places within 1e8 m, turns within 1e6 rad"
)
"""What is wrong with the row of ``first_implausible``."""

_MOST = np.array([1e12, 1e12, 1e8, 1e8, 1e6])  # of t1, t2, dx, dy, dyaw


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
    name = f"--relations {path}"
    rows: list[list[float]] = []
    try:
        text = read_text(path)
    except InputError as error:
        raise InputError(f"--relations {error}") from None
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) not in (5, 8) or "_" in line:  # Python would read 1_0 as 10
            raise InputError(
                f"{name}, line {number}: must be t1 t2 x y z roll pitch yaw, "
                "or t1 t2 dx dy dyaw, all numbers"
            )
        check_limit(len(rows) + 1, RELATIONS, f"{name}: relations")
        rows.append([number, *row[:4], row[-1]])
    if not rows:
        raise InputError(f"{name}: the file has no relation")
    table = np.array(rows)
    wrong = first_implausible(table[:, 1:])
    if wrong is not None:
        raise InputError(f"{name}, line {table[wrong, 0]:.0f}: {IMPLAUSIBLE}")
    return table[:, 1:]


def first_implausible(relations: FloatArray) -> int | None:
    """Find a relation with a number that is not finite, or too large to be computed with.

    Args:
        relations: (m, 5) t1, t2, dx, dy, dyaw.

    Returns:
        The first such row; None if there is none.
    """
    good = (np.abs(relations) <= _MOST).all(axis=1)  # False for NaN
    return None if good.all() else int(np.argmin(good))


def times_on_relations_clock(log: LaserLog, relations: FloatArray) -> FloatArray:
    """Choose the clock of the log by which the relations were recorded.

    Args:
        log: a log with one or more clocks.
        relations: (m, 5) as from ``read_relations``.

    Returns:
        (n,) the scans' times, s, by the clock whose span contains most of the relations' times;
        NaN where this clock does not rise.
    """

    def count_within(clock: FloatArray) -> int:
        known, times = clock[np.isfinite(clock)], relations[:, :2]
        if not len(known):
            return -1
        return int(np.count_nonzero((times >= known[0]) & (times <= known[-1])))

    return max(log.clocks_s or (log.t_s,), key=count_within)


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
        t_s: (n,) times, rising, on the relations' clock; NaN where unknown.
        poses: (n, 3) base_link at these times, in any fixed frame; NaN where unknown.
        relations: (m, 5) as from ``read_relations``.

    Returns:
        The errors.

    Raises:
        InputError: if no relation lies within the trajectory.
    """
    known = np.isfinite(t_s)
    if not known.any():
        raise InputError("the log has no clock that rises, so relations cannot be placed in it")
    t_s, poses = t_s[known], poses[known]
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
