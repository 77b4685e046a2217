"""Hold the log of a planar laser on a wheeled robot, independent of the file's format."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray

_RANGE_MIN_M = 0.1  # nearer hits are ignored: they are the robot itself, or dust


@dataclass(frozen=True, slots=True, eq=False)
class LaserLog:
    """Scans in the order of their times, each with the pose by wheel odometry.

    Attributes:
        t_s: (n,) times, rising, s.
        ranges_m: (n, beams), inf where nothing came back.
        angles_rad: (beams,) directions of the beams in the laser's frame.
        odom: (n, 3) odom_from_base, m, m, rad.
        base_from_laser: (3,) the laser's pose in base_link.
        relations: (m, 5) t1, t2, and the pose dx, dy, dyaw at t2 in the frame of the pose at t1;
            None if the file has none.
        skipped: number of lines or scans of the file that could not be used.
        clocks_s: the scans' times (n,) by each further clock in the file.
    """

    t_s: FloatArray
    ranges_m: FloatArray
    angles_rad: FloatArray
    odom: FloatArray
    base_from_laser: FloatArray
    relations: FloatArray | None = None
    skipped: int = 0
    clocks_s: tuple[FloatArray, ...] = ()


def beam_angles(beams: int, fov_rad: float = math.pi) -> FloatArray:
    """Compute the beams' directions in a sweep that is symmetric about the laser's x axis.

    An odd number of beams, such as 181 or 361, covers both ends of the field of view. An even
    number ends one step before the end, as in CARMEN.

    Args:
        beams: number of beams.
        fov_rad: field of view.

    Returns:
        (beams,) angles in the laser's frame, rad, from right to left.
    """
    steps = beams - 1 if beams % 2 else beams
    return -0.5 * fov_rad + np.arange(beams) * fov_rad / max(1, steps)


def clean_log(
    t_s: FloatArray,
    ranges_m: FloatArray,
    angles_rad: FloatArray,
    odom: FloatArray,
    base_from_laser: FloatArray,
    name: str,
    relations: FloatArray | None = None,
    skipped: int = 0,
    clocks_s: tuple[FloatArray, ...] = (),
) -> LaserLog:
    """Make a log of the scans with a finite pose and a later time than the scan before.

    Args:
        t_s: (n,) times, s.
        ranges_m: (n, beams); not finite or not positive where nothing came back.
        angles_rad: (beams,) directions in the laser's frame.
        odom: (n, 3) odom_from_base, m, m, rad.
        base_from_laser: (3,) the laser's pose in base_link, m, m, rad.
        name: name of the log in error messages.
        relations: (m, 5) as in ``LaserLog``.
        skipped: number of lines or scans that were skipped before.
        clocks_s: further clocks (n,), s.

    Returns:
        The log.

    Raises:
        InputError: if no scan is left.
    """
    finite = np.isfinite(t_s) & np.isfinite(odom).all(axis=1)
    keep, latest = np.zeros(len(t_s), np.bool_), -math.inf
    for i in np.flatnonzero(finite):
        if t_s[i] > latest:
            keep[i], latest = True, t_s[i]
    if not keep.any():
        raise InputError(f"{name}: has no scan with a finite time and odometry pose")
    ranges = ranges_m[keep]
    ranges = np.where(np.isfinite(ranges) & (ranges > 0.0), ranges, np.inf)
    return LaserLog(
        t_s[keep],
        ranges,
        angles_rad,
        odom[keep],
        base_from_laser,
        relations,
        skipped + int(np.count_nonzero(~keep)),
        tuple(clock[keep] for clock in clocks_s),
    )


def usable_range_m(log: LaserLog) -> float:
    """Find the greatest range that is a hit.

    If no echo comes back, a laser reports its largest value: 81.91 m, or 8.19, 31.9 or 50 m,
    depending on its settings. So the log contains this value very often.

    Args:
        log: the log.

    Returns:
        The limit, m: larger ranges mean that nothing came back.

    Raises:
        InputError: if no range of the log is finite.
    """
    ranges = log.ranges_m[np.isfinite(log.ranges_m)]
    if ranges.size == 0:
        raise InputError("the log has no finite range in any scan")
    top = float(ranges.max())
    at_top = np.count_nonzero(ranges >= top - 1e-3 * max(1.0, top))
    repeated = at_top > max(3, 1e-5 * ranges.size)
    return (top - 1e-3 * max(1.0, top)) if repeated else top


class ScanReader:
    """Converter of a log's scans to points, one for each beam that hit something."""

    def __init__(self, log: LaserLog, range_max_m: float) -> None:
        """Prepare to read a log.

        Args:
            log: the log.
            range_max_m: longer ranges are ignored, even if the laser measures farther.
        """
        self._ranges = log.ranges_m
        self._most = min(usable_range_m(log), range_max_m)
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
        ranges = self._ranges[scan]
        valid = (ranges >= _RANGE_MIN_M) & (ranges <= self._most)
        points = self._origin + ranges[valid, None] * self._direction[valid]
        return points, np.tile(self._origin, (len(points), 1))
