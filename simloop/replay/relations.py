"""Measure trajectories by true relative poses (Kuemmerle et al. 2009).

The paper is "On measuring the accuracy of SLAM algorithms". A relation is the true pose at time t2
in the frame of the pose at t1. Its error is the motion from the true pose to the estimated one, in
the frame of the true one. The lengths of the errors' translations, and the sizes of their
rotations, are averaged over all relations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.common.input_files import read_text
from simloop.common.limits import RELATIONS, check_limit
from simloop.geometry.se2 import between_all, wrap_angles
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog
from simloop.replay.odometry import IN_GAP, LOST, MEASURED, OUTSIDE, OdometryTrack, carry

IMPLAUSIBLE = (
    "numbers must be finite, times within 1e12 s, places within 1e8 m, turns within 1e6 rad"
)
"""What is wrong with the row of ``first_implausible``."""

_MOST = np.array([1e12, 1e12, 1e8, 1e8, 1e6])  # of t1, t2, dx, dy, dyaw


@dataclass(frozen=True, slots=True, eq=False)
class RelationErrors:
    """Errors of a trajectory, measured by relations.

    Attributes:
        translation_mean_m: mean length of the errors' translations; None if no relation is used.
        translation_std_m: standard deviation of these lengths.
        rotation_mean_deg: mean size of the errors' rotations, degrees.
        count: number of relations used.
        in_gaps: number of relations left out because the odometry has a gap there.
        outside: number of relations left out because they lie outside the times.
        lost: number of relations left out because the robot was lost there.
        t_s: (count,) first time of each relation used, s.
        off_m: (count,) length of the translation of its error, m.
    """

    translation_mean_m: float | None
    translation_std_m: float | None
    rotation_mean_deg: float | None
    count: int
    in_gaps: int
    outside: int
    lost: int
    t_s: FloatArray
    off_m: FloatArray

    def figures(self) -> dict[str, float | int | None]:
        """Return the values by name, for the JSON; ``left_out`` is the number of all left out.

        Returns:
            Name to value.
        """
        named = {
            name: getattr(self, name) for name in self.__slots__ if name not in ("t_s", "off_m")
        }
        return {**named, "left_out": self.in_gaps + self.outside + self.lost}


def read_rows(
    option: str, path: Path, widths: tuple[int, ...], must: str, most: int, what: str
) -> list[tuple[int, list[float]]]:
    """Read a text file with numbers in each line, and comments after ``#``.

    Args:
        option: the option that names the file, for error messages.
        path: the file.
        widths: how many numbers a line may have.
        must: what these are, for error messages.
        most: the largest number of rows.
        what: what a row is, for error messages.

    Returns:
        Number of the line, from 1, and its numbers; at least one row.

    Raises:
        InputError: if the file or one of its lines cannot be read, or if there are no rows, or too
            many.
    """
    name = f"{option} {path}"
    rows: list[tuple[int, list[float]]] = []
    try:
        text = read_text(path)
    except InputError as error:
        raise InputError(f"{option} {error}") from None
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) not in widths or "_" in line:  # Python would read 1_0 as 10
            raise InputError(f"{name}, line {number}: must be {must}, all numbers")
        check_limit(len(rows) + 1, most, f"{name}: {what}s")
        rows.append((number, row))
    if not rows:
        raise InputError(f"{name}: the file has no {what}")
    return rows


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
    must = "t1 t2 x y z roll pitch yaw, or t1 t2 dx dy dyaw"
    rows = read_rows("--relations", path, (5, 8), must, RELATIONS, "relation")
    table = np.array([[number, *row[:4], row[-1]] for number, row in rows])
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


def clock_of(log: LaserLog, times_s: FloatArray) -> int:
    """Choose the clock of the log by which other data were recorded.

    Args:
        log: a log with one or more clocks.
        times_s: times of the data, any shape, s.

    Returns:
        Index of the clock whose span contains most of the times.
    """

    def count_within(clock: FloatArray) -> int:
        known = clock[np.isfinite(clock)]
        if not len(known):
            return -1
        return int(np.count_nonzero((times_s >= known[0]) & (times_s <= known[-1])))

    counts = [count_within(clock) for clock in log.clocks_s]
    return counts.index(max(counts)) if counts else 0


def measure_relations(log: LaserLog, poses: FloatArray, relations: FloatArray) -> RelationErrors:
    """Measure a trajectory by relations. Poses between two scans are carried by odometry.

    Args:
        log: the log.
        poses: (n, 3) base_link at the log's first n scans, in any fixed frame; NaN where unknown.
        relations: (m, 5) as from ``read_relations``.

    Returns:
        The errors.

    Raises:
        InputError: if the log has no clock, or if all relations lie outside the log's times.
    """
    clock = clock_of(log, relations[:, :2])
    t_s = (log.clocks_s or (log.t_s,))[clock]
    known = np.isfinite(t_s)
    tracks = [OdometryTrack(t_s[known], log.odom[known])]
    if log.odometry is not None:
        tracks.insert(0, log.odometry.usable(clock))
    return relation_errors(t_s[: len(poses)], poses, relations, tracks)


def relation_errors(
    t_s: FloatArray,
    poses: FloatArray,
    relations: FloatArray,
    tracks: Sequence[OdometryTrack] = (),
) -> RelationErrors:
    """Measure a trajectory by relations.

    Args:
        t_s: (n,) times, rising, on the relations' clock; NaN where unknown.
        poses: (n, 3) base_link at these times, in any fixed frame; NaN where unknown.
        relations: (m, 5) as from ``read_relations``.
        tracks: odometry on the same clock, as in ``carry``; none: the poses are interpolated.

    Returns:
        The errors.

    Raises:
        InputError: if no time is known, or if all relations lie outside the times.
    """
    known = np.isfinite(t_s)
    if not known.any():
        raise InputError("the log has no clock that rises, so relations cannot be placed in it")
    t_s, poses = t_s[known], poses[known]
    tracks = tracks or (OdometryTrack(t_s, poses),)
    first, second = (carry(t_s, poses, tracks, relations[:, k]) for k in (0, 1))
    # MEASURED is the least: if one of the two poses is missing, its reason counts.
    why = np.where(first[1] == MEASURED, second[1], first[1])
    if (why == OUTSIDE).all():
        raise InputError("no relation lies within the log's times; do they belong to another log?")
    used = why == MEASURED
    motion, true = between_all(first[0][used], second[0][used]), relations[used, 2:]
    off = np.hypot(*(motion - true)[:, :2].T)
    turned = np.abs(wrap_angles(motion[:, 2] - true[:, 2]))
    some = bool(used.any())
    return RelationErrors(
        float(off.mean()) if some else None,
        float(off.std()) if some else None,
        math.degrees(float(turned.mean())) if some else None,
        count=int(np.count_nonzero(used)),
        in_gaps=int(np.count_nonzero(why == IN_GAP)),
        outside=int(np.count_nonzero(why == OUTSIDE)),
        lost=int(np.count_nonzero(why == LOST)),
        t_s=relations[used, 0],
        off_m=off,
    )
