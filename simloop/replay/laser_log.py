"""A recorded log of a planar laser on a wheeled robot, whatever file it came from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray

_RANGE_MIN_M = 0.1  # what is nearer is the robot's own, or dust


@dataclass(frozen=True, slots=True, eq=False)
class LaserLog:
    """Scans in the order of their times, each with the wheels' own belief of the pose.

    t_s: (n,) rising; ranges_m: (n, beams), inf where nothing came back; angles_rad: (beams,) in the
    laser frame; odom: (n, 3) odom_from_base; base_from_laser: (3,). relations: (m, 5) t1, t2, and
    the pose (dx, dy, dyaw) at t2 in the frame of that at t1, or None. skipped: how many lines or
    scans of the file could not be used. clocks_s: other clocks (n,) that the file keeps.
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
    """(beams,) of a sweep symmetric about ahead: 181 or 361 beams reach both ends of the field.

    An even number fills it in equal steps and stops one step short of its end, as CARMEN has it.
    """
    steps = beams - 1 if beams % 2 else beams
    return -0.5 * fov_rad + np.arange(beams) * fov_rad / max(1, steps)


def sound_log(
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
    """The log without scans whose numbers are no numbers or whose time does not advance.

    Raises InputError, which names the file, where nothing is left.
    """
    finite = np.isfinite(t_s) & np.isfinite(odom).all(axis=1)
    keep, latest = np.zeros(len(t_s), np.bool_), -math.inf
    for i in np.flatnonzero(finite):
        if t_s[i] > latest:
            keep[i], latest = True, t_s[i]
    if not keep.any():
        raise InputError(f"{name}: holds no scan with a time and an odometry pose")
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
    """The greatest range that means a surface: what stands for 'nothing came back' is above it.

    A laser says so with one number, its greatest (81.91 m, or 8.19, 31.9, 50 m by its settings),
    which therefore comes again and again, and with nothing close below it.
    """
    ranges = log.ranges_m[np.isfinite(log.ranges_m)]
    if ranges.size == 0:
        raise InputError("the log's scans hold no range at all")
    top = float(ranges.max())
    at_top = np.count_nonzero(ranges >= top - 1e-3 * max(1.0, top))
    repeated = at_top > max(3, 1e-5 * ranges.size)
    return (top - 1e-3 * max(1.0, top)) if repeated else top


class ScanReader:
    """A log's scans as points: each beam that met something, in base_link.

    range_max_m: beyond it a hit is taken for none, however far the laser sees.
    """

    def __init__(self, log: LaserLog, range_max_m: float) -> None:
        self._ranges = log.ranges_m
        self._most = min(usable_range_m(log), range_max_m)
        heading = log.angles_rad + log.base_from_laser[2]
        self._direction = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        self._origin = log.base_from_laser[:2]

    def points(self, scan: int) -> tuple[FloatArray, FloatArray]:
        """Hits and the beams' origins, both (n, 2) m."""
        ranges = self._ranges[scan]
        heard = (ranges >= _RANGE_MIN_M) & (ranges <= self._most)
        points = self._origin + ranges[heard, None] * self._direction[heard]
        return points, np.tile(self._origin, (len(points), 1))
