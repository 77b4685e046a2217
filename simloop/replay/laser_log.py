"""Hold the log of a planar laser on a wheeled robot, independent of the file's format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.replay.clocks import choose_times, unit_of
from simloop.replay.no_return import Ranges, longest_hit_m
from simloop.replay.odometry import Odometry, are_plausible
from simloop.replay.unused import Unused

MOST_OFFSET_M = 10.0
"""Largest distance of a laser from the robot's centre, m."""

_MOST_RANGE_M = 1000.0  # larger values are codes: no laser of a robot measures farther
_RANGE_MIN_M = 0.1  # nearer hits are ignored: they are the robot itself, or dust
_ROUND, _ROUND_M = 0.005, 0.01  # ranges that differ by less are one: share, at least these metres
_ROUND_HITS, _ROUND_SHARE = 10, 0.5  # hits of a scan that are all around: least number and share
_CHUNK = 4096  # scans that are looked at at once
_MOST_WAY_M = 1e5  # a pose farther from the middle of all poses is an error


@dataclass(frozen=True, slots=True, eq=False)
class LaserLog:
    """Scans in the order of the file, each with the pose by wheel odometry.

    Attributes:
        t_s: (n,) times, rising, s.
        ranges_m: (n, beams), inf where nothing came back.
        angles_rad: (beams,) directions of the beams in the laser's frame.
        odom: (n, 3) odom_from_base, m, m, rad.
        base_from_laser: (3,) the laser's pose in base_link.
        relations: (m, 5) t1, t2, and the pose dx, dy, dyaw at t2 in the frame of the pose at t1;
            None if the file has none.
        skipped: number of scans of the file that could not be used.
        clocks_s: the scans' times (n,) by each clock in the file; NaN where it does not rise.
        measured: whether ``t_s`` comes from a clock of the log.
        stated_range_m: the laser's maximum range by the log; inf if it states none.
        notes: what was left out or assumed, one sentence each.
        reference: (n, 3) base_link by another SLAM, m, m, rad, NaN where it has no pose; None if
            there is none. It is not the truth.
        odometry: all odometry lines; None if the log has the scans' poses only.
    """

    t_s: FloatArray
    ranges_m: Ranges
    angles_rad: FloatArray
    odom: FloatArray
    base_from_laser: FloatArray
    relations: FloatArray | None = None
    skipped: int = 0
    clocks_s: tuple[FloatArray, ...] = ()
    measured: bool = True
    stated_range_m: float = math.inf
    notes: tuple[str, ...] = ()
    reference: FloatArray | None = None
    odometry: Odometry | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RawScans:
    """Scans as a file has them.

    Attributes:
        ranges_m: (n, beams); not finite or not positive where nothing came back. It is changed.
        odom: (n, 3) odom_from_base, m, m, rad; it may be wrong.
        clocks_s: one or more clocks (n,), the preferred one first; they may be wrong.
        places: (n,) the scans' numbers or lines in the file.
        place: what ``places`` counts, e.g. ``line``.
        reference: (n, 3) poses by another SLAM; not finite where it has none. None if there is no
            reference.
        odometry: all odometry lines; None if there are none.
    """

    ranges_m: Ranges
    odom: FloatArray
    clocks_s: tuple[FloatArray, ...]
    places: Sequence[int]
    place: str
    reference: FloatArray | None = None
    odometry: Odometry | None = None


def clean_log(
    raw: RawScans,
    angles_rad: FloatArray,
    base_from_laser: FloatArray,
    name: str,
    unused: Unused,
    relations: FloatArray | None = None,
    stated_range_m: float = math.inf,
    notes: Sequence[str] = (),
) -> LaserLog:
    """Make a log of the scans with a plausible pose, and find their times.

    Args:
        raw: the scans.
        angles_rad: (beams,) directions in the laser's frame.
        base_from_laser: (3,) the laser's pose in base_link, m, m, rad.
        name: name of the log in error messages.
        unused: the scans that were left out before.
        relations: (m, 5) as in ``LaserLog``.
        stated_range_m: as in ``LaserLog``.
        notes: what the reader assumed.

    Returns:
        The log.

    Raises:
        InputError: if most scans cannot be used.
    """
    total = len(raw.odom) + unused.count
    keep = _plausible(raw.odom)
    lost = np.flatnonzero(~keep)
    if lost.size:
        reason = f"the odometry is not finite, or more than {_MOST_WAY_M / 1000:g} km away"
        unused.add(reason, f"{raw.place} {raw.places[lost[0]]}", lost.size)
    unused.refuse_most(name, total)
    ranges, odom, clocks = raw.ranges_m, raw.odom, raw.clocks_s
    if lost.size:
        ranges, odom = ranges[keep], odom[keep]
        clocks = tuple(clock[keep] for clock in clocks)
    ranges[~((ranges > 0.0) & (ranges <= _MOST_RANGE_M))] = np.inf  # also NaN
    said = [*unused.notes(total), *notes]
    clocks, odometry = _in_seconds(clocks, raw.odometry, said)
    times = choose_times(clocks)
    said += [times.note] if times.note else []
    reference = None if raw.reference is None else _known_poses(raw.reference[keep], said)
    return LaserLog(
        times.t_s,
        ranges,
        angles_rad,
        odom,
        base_from_laser,
        relations,
        unused.count,
        times.clocks_s,
        times.measured,
        stated_range_m,
        tuple(said),
        reference,
        odometry,
    )


def _in_seconds(
    clocks: tuple[FloatArray, ...], odometry: Odometry | None, said: list[str]
) -> tuple[tuple[FloatArray, ...], Odometry | None]:
    """Convert the scans' and the odometry's stamps to seconds, and add a note if they are not."""
    units = [unit_of(clock) for clock in clocks]
    for unit in dict.fromkeys(unit for unit in units if unit[1] != 1.0):
        said.append(f"the stamps are too large for seconds since 1970: taken for {unit[0]}")
    if odometry is not None:  # its lines have the same clocks
        scales = [unit_of(clock)[1] for clock in odometry.clocks_s]
        by_clock = tuple(t / s for t, s in zip(odometry.clocks_s, scales, strict=True))
        odometry = replace(odometry, clocks_s=by_clock)
    return tuple(t / unit[1] for t, unit in zip(clocks, units, strict=True)), odometry


def _plausible(odom: FloatArray) -> NDArray[np.bool_]:
    """Return (n,) whether a pose is finite and not far away from the others."""
    good = are_plausible(odom)
    if good.any():
        middle = np.median(odom[good, :2], axis=0)
        good[good] = np.abs(odom[good, :2] - middle).max(axis=1) <= _MOST_WAY_M
    return good


def _known_poses(reference: FloatArray, said: list[str]) -> FloatArray | None:
    """Return the poses, NaN where they are not plausible, and add a note on these."""
    good = are_plausible(reference)
    if not good.all():
        lost = int(np.count_nonzero(~good))
        said.append(f"{lost} of {len(good)} poses of the reference are not finite, or too large")
    return np.where(good[:, None], reference, np.nan) if good.any() else None


def usable_range_m(log: LaserLog) -> float:
    """Find the greatest range that is a hit.

    Args:
        log: the log.

    Returns:
        The limit, m: larger ranges mean that nothing came back. 0 if no reading is a hit.
    """
    return longest_hit_m(log.ranges_m, log.stated_range_m)[0]


class ScanReader:
    """Converter of a log's scans to points, one for each beam that hit something.

    Attributes:
        notes: what was left out, one sentence each.
    """

    def __init__(self, log: LaserLog, range_max_m: float) -> None:
        """Prepare to read a log.

        Args:
            log: the log.
            range_max_m: longer ranges are ignored, even if the laser measures farther.
        """
        self._ranges = log.ranges_m
        longest, wrong = longest_hit_m(log.ranges_m, log.stated_range_m)
        self._most = min(longest, range_max_m)
        self.notes: list[str] = []
        if wrong:
            self.notes.append(
                f"{wrong} ranges are left out: they are more than the laser measures, which is "
                f"{longest:.4g} m in this log, and not its value for no echo"
            )
        alike = _alike(log.ranges_m, self._most)
        if alike:
            self.notes.append(
                f"{alike} of {len(log.t_s)} scans have one range in all directions: how the robot "
                "turns cannot be told from them"
            )
        heading = log.angles_rad + log.base_from_laser[2]
        self._direction = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        self._origin = log.base_from_laser[:2]

    def points(self, scan: int) -> tuple[FloatArray, FloatArray]:
        """Compute the points of one scan.

        Args:
            scan: index of the scan in the log.

        Returns:
            Hits (n, 2) and beam origins (n, 2), in base_link, m.
        """
        ranges = self._ranges[scan].astype(np.float64)
        valid = (ranges >= _RANGE_MIN_M) & (ranges <= self._most)
        points = self._origin + ranges[valid, None] * self._direction[valid]
        return points, np.tile(self._origin, (len(points), 1))


def _alike(ranges_m: Ranges, longest_m: float) -> int:
    """Count the scans of which most beams hit something, all at one range."""
    count = 0
    for at in range(0, len(ranges_m), _CHUNK):
        some = ranges_m[at : at + _CHUNK]
        valid = (some >= _RANGE_MIN_M) & (some <= longest_m)
        least = np.where(valid, some, np.inf).min(axis=1)
        most = np.where(valid, some, -np.inf).max(axis=1)
        alike = most - least <= np.maximum(_ROUND_M, _ROUND * most)
        hits = valid.sum(axis=1)
        alike &= hits >= max(_ROUND_HITS, _ROUND_SHARE * some.shape[1])
        count += int(np.count_nonzero(alike))
    return count
