"""Read CARMEN's text logs (.log, .clf): FLASER, ROBOTLASER1 and PARAM lines. Skip all others.

    FLASER n r_1 .. r_n  laser_x laser_y laser_yaw  odom_x odom_y odom_yaw  t host logger_t
    ROBOTLASER1 type start fov resolution max accuracy remission n r_1 .. r_n  m s_1 .. s_m
        laser_x laser_y laser_yaw  robot_x robot_y robot_yaw  (5 more)  t host logger_t

Odometry is raw. The laser's pose on the robot is computed from the laser's and the robot's poses in
a line. In some logs the laser's poses were corrected afterwards and do not belong to the robot's
poses. Then the offset of the PARAM line is used.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from simloop.common.errors import InputError
from simloop.geometry.se2 import between
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog, beam_angles, clean_log

_OFFSET_PARAMETERS = ("robot_front_laser_offset", "robot_frontlaser_offset")
_STEADY = 0.01  # a laser that seems to move by less is fixed, m and rad: the log is rounded
_MOST_OFFSET_M = 1.5  # largest possible distance of a laser from the robot's centre
_MOST_BEAMS = 100_000  # a line with more beams is not valid


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    """Data of one laser line: poses x, y, yaw; times by the sensor's and the logger's clock, s."""

    ranges: list[float]
    laser: list[float]
    odom: list[float]
    clocks: tuple[float, float]
    sweep: tuple[float, float] | None = None  # start angle and step, rad, if the line has them


def parse_carmen(lines: Iterable[str], name: str = "log") -> LaserLog:
    """Read the front laser's scans from a log.

    Args:
        lines: the log's lines.
        name: name of the log in error messages.

    Returns:
        The usable scans.

    Raises:
        InputError: if there is no scan.
    """
    scans, skipped, offset, bad_line = [], 0, 0.0, 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0] not in ("FLASER", "ROBOTLASER1", "PARAM"):
            continue
        try:
            if words[0] == "PARAM":
                if len(words) > 2 and words[1] in _OFFSET_PARAMETERS:
                    offset = float(words[2])
                continue
            scans.append(_flaser(words) if words[0] == "FLASER" else _robotlaser(words))
        except (ValueError, IndexError):
            skipped += 1
            bad_line = bad_line or number
    if not scans:
        if skipped:
            raise InputError(
                f"{name}, line {bad_line}: not a valid laser line; the log has no valid one"
            )
        raise InputError(f"{name}: has no FLASER or ROBOTLASER1 line; is it a CARMEN log?")
    # A log may hold two lasers, or truncated lines. Use the most frequent number of beams.
    beams = Counter(len(scan.ranges) for scan in scans).most_common(1)[0][0]
    chosen = [scan for scan in scans if len(scan.ranges) == beams]
    skipped += len(scans) - len(chosen)
    angles = beam_angles(beams)
    if chosen[0].sweep is not None:
        start, step = chosen[0].sweep
        angles = np.asarray(start + step * np.arange(beams), np.float64)
    odom = np.array([scan.odom for scan in chosen])
    laser = _laser_offset(np.array([scan.laser for scan in chosen]), odom, offset)
    clocks = np.array([scan.clocks for scan in chosen])
    ranges = np.array([scan.ranges for scan in chosen])
    return clean_log(
        clocks[:, 0].copy(), ranges, angles, odom, laser, name, None, skipped, (clocks[:, 1],)
    )


def _flaser(words: list[str]) -> _Scan:
    """Parse the words of a FLASER line; raise ValueError or IndexError if it is not valid."""
    count = int(words[1])
    if not 1 <= count <= _MOST_BEAMS:
        raise ValueError(words[1])
    ranges = [float(word) for word in words[2 : 2 + count]]
    laser, odom, clocks = _tail(words[2 + count :], 6)
    return _Scan(ranges, laser, odom, clocks)


def _robotlaser(words: list[str]) -> _Scan:
    """Parse the words of a ROBOTLASER1 line; raise ValueError or IndexError if it is not valid."""
    start, _, step = (float(word) for word in words[2:5])
    count = int(words[8])
    if not (1 <= count <= _MOST_BEAMS and math.isfinite(start) and math.isfinite(step)):
        raise ValueError(words[8])
    ranges = [float(word) for word in words[9 : 9 + count]]
    remissions = int(words[9 + count])
    if remissions < 0:
        raise ValueError(words[9 + count])
    laser, odom, clocks = _tail(words[10 + count + remissions :], 11)
    return _Scan(ranges, laser, odom, clocks, (start, step))


def _tail(words: list[str], t_at: int) -> tuple[list[float], list[float], tuple[float, float]]:
    """Parse the words after the ranges: laser pose, robot pose, and two clocks from ``t_at``.

    If the line has only one clock, it is returned twice.
    """
    numbers = [float(word) for word in words[:6]]
    if len(numbers) < 6 or not all(map(math.isfinite, numbers)):
        raise ValueError("cut off")
    t_s = float(words[t_at])
    logger_t_s = float(words[t_at + 2]) if len(words) > t_at + 2 else t_s
    if not (math.isfinite(t_s) and math.isfinite(logger_t_s)):
        raise ValueError("no time")
    return numbers[:3], numbers[3:], (t_s, logger_t_s)


def _laser_offset(laser: FloatArray, odom: FloatArray, parameter_m: float) -> FloatArray:
    """Return base_from_laser (3,), by the poses if constant there, else by the parameter."""
    seen = np.array([between(o, p) for o, p in zip(odom, laser, strict=True)])
    middle = np.median(seen, axis=0)
    off = np.abs(seen - middle)
    off[:, 2] = np.minimum(off[:, 2], 2.0 * math.pi - off[:, 2])
    steady = np.quantile(off, 0.9, axis=0).max() < _STEADY
    if steady and math.hypot(middle[0], middle[1]) <= _MOST_OFFSET_M and middle.any():
        return middle
    return np.array([parameter_m, 0.0, 0.0])
