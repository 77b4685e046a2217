"""CARMEN's text logs (.log, .clf): FLASER, ROBOTLASER1 and PARAM lines; all others are passed over.

    FLASER n r_1 .. r_n  laser_x laser_y laser_yaw  odom_x odom_y odom_yaw  t host logger_t
    ROBOTLASER1 type start fov resolution max accuracy remission n r_1 .. r_n  m s_1 .. s_m
        laser_x laser_y laser_yaw  robot_x robot_y robot_yaw  (5 more)  t host logger_t

Odometry is raw. The laser's place on the robot is where its pose stands from the robot's; in logs
whose laser poses were corrected afterwards the two are unrelated, and the PARAM line counts.
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
from simloop.replay.laser_log import LaserLog, beam_angles, sound_log

_OFFSET_PARAMETERS = ("robot_front_laser_offset", "robot_frontlaser_offset")
_STEADY = 0.01  # m, rad, by which a laser that is bolted on may seem to move: the log's rounding
_MOST_OFFSET_M = 1.5
_MOST_BEAMS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    ranges: list[float]
    laser: list[float]
    odom: list[float]
    clocks: tuple[float, float]
    sweep: tuple[float, float] | None = None  # start angle and step, rad, where the line has them


def parse_carmen(lines: Iterable[str], name: str = "log") -> LaserLog:
    """The log's front laser. Raises InputError, which names the log, if it holds no scan."""
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
            raise InputError(f"{name}, line {bad_line}: a laser line that cannot be read, like all")
        raise InputError(f"{name}: holds no FLASER or ROBOTLASER1 line; not a CARMEN log?")
    # A log may be of two lasers, or have cut lines: the most usual number of beams is taken.
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
    return sound_log(
        clocks[:, 0].copy(), ranges, angles, odom, laser, name, None, skipped, (clocks[:, 1],)
    )


def _flaser(words: list[str]) -> _Scan:
    count = int(words[1])
    if not 1 <= count <= _MOST_BEAMS:
        raise ValueError(words[1])
    ranges = [float(word) for word in words[2 : 2 + count]]
    laser, odom, clocks = _tail(words[2 + count :], 6)
    return _Scan(ranges, laser, odom, clocks)


def _robotlaser(words: list[str]) -> _Scan:
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
    """Laser and robot pose, and the two clocks; the second is the first where it is not there."""
    numbers = [float(word) for word in words[:6]]
    if len(numbers) < 6 or not all(map(math.isfinite, numbers)):
        raise ValueError("cut off")
    t_s = float(words[t_at])
    logger_t_s = float(words[t_at + 2]) if len(words) > t_at + 2 else t_s
    if not (math.isfinite(t_s) and math.isfinite(logger_t_s)):
        raise ValueError("no time")
    return numbers[:3], numbers[3:], (t_s, logger_t_s)


def _laser_offset(laser: FloatArray, odom: FloatArray, parameter_m: float) -> FloatArray:
    """base_from_laser (3,), from the poses where they tell it and the log's parameter if not."""
    seen = np.array([between(o, p) for o, p in zip(odom, laser, strict=True)])
    middle = np.median(seen, axis=0)
    off = np.abs(seen - middle)
    off[:, 2] = np.minimum(off[:, 2], 2.0 * math.pi - off[:, 2])
    steady = np.quantile(off, 0.9, axis=0).max() < _STEADY
    if steady and math.hypot(middle[0], middle[1]) <= _MOST_OFFSET_M and middle.any():
        return middle
    return np.array([parameter_m, 0.0, 0.0])
