"""Parse the lines of CARMEN's text logs.

FLASER n r_1 .. r_n  laser_x laser_y laser_yaw  odom_x odom_y odom_yaw  t host logger_t
ROBOTLASER1 type start fov resolution max accuracy remission n r_1 .. r_n  m s_1 .. s_m
    laser_x laser_y laser_yaw  robot_x robot_y robot_yaw  (5 more)  t host logger_t
RAWLASER1 (as ROBOTLASER1, up to s_m)  t host logger_t
ODOM x y yaw tv rv accel  t host logger_t
PARAM name value  t host logger_t
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from simloop.common.errors import InputError
from simloop.replay.laser_log import MOST_OFFSET_M
from simloop.replay.no_return import Ranges

_MOST_BEAMS = 100_000  # a line with more beams is not valid
_OFFSETS = ("robot_front_laser_offset", "robot_frontlaser_offset")
_OTHER_OFFSETS = tuple(
    f"{laser}_{kind}_offset"
    for laser in ("robot_front_laser", "robot_frontlaser")
    for kind in ("side", "angular")
)
_RESOLUTION, _FOV = "laser_front_laser_resolution", "laser_front_laser_fov"
_MOST_FOV_DEG = 360.0


@dataclass(frozen=True, slots=True, eq=False)
class ScanLine:
    """Data of one laser line.

    Attributes:
        number: the line's number.
        ranges: (n,) m.
        poses: laser's x, y, yaw, then the robot's, m and rad; None in a RAWLASER1 line.
        clocks: times by the laser's and the logger's clock, s; NaN without.
        sweep: start, step and field of view, rad; None in a FLASER line.
        range_max_m: the laser's maximum range; inf if not stated.
    """

    number: int
    ranges: Ranges
    poses: tuple[float, ...] | None
    clocks: tuple[float, float]
    sweep: tuple[float, float, float] | None = None
    range_max_m: float = math.inf


@dataclass(slots=True)
class Parameters:
    """The PARAM lines that matter.

    Attributes:
        offset_m: the laser's x in base_link.
        resolution_deg: angle between two beams; None if there is no such line.
        fov_deg: field of view; None if there is no such line.
        ignored: names of parameters with a value that is not used.
    """

    offset_m: float = 0.0
    resolution_deg: float | None = None
    fov_deg: float | None = None
    ignored: list[str] = field(default_factory=list)

    def read(self, words: list[str], place: str) -> None:
        """Read a PARAM line.

        Args:
            words: the line's words.
            place: log and line, for error messages.

        Raises:
            InputError: if the value of one of these parameters is not plausible.
        """
        name = words[1] if len(words) > 2 else ""
        if name in _OFFSETS:
            self.offset_m = _number(words, place, -MOST_OFFSET_M, MOST_OFFSET_M, "m")
        elif name == _RESOLUTION:
            self.resolution_deg = _number(words, place, 1e-3, _MOST_FOV_DEG, "degrees")
        elif name == _FOV:
            self.fov_deg = _number(words, place, 1e-3, _MOST_FOV_DEG, "degrees")
        elif name in _OTHER_OFFSETS and words[2].strip("0.+-") and name not in self.ignored:
            self.ignored.append(name)


def _number(words: list[str], place: str, least: float, most: float, unit: str) -> float:
    """Return the value of a PARAM line."""
    try:
        value = float(words[2])
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise InputError(
            f"{place}: PARAM {words[1]} {words[2]}: must be a number from {least:g} to {most:g} "
            f"{unit}"
        )
    return value


def flaser(words: list[str], number: int) -> ScanLine:
    """Parse a FLASER line.

    Args:
        words: the line's words.
        number: the line's number.

    Returns:
        Its data.

    Raises:
        ValueError: if the line is not valid.
        IndexError: if the line is too short.
    """
    end = 2 + _count(words[1])
    poses, clocks = _tail(words[end : end + 9], 6)
    return ScanLine(number, _ranges(words[2:end]), poses, clocks)


def robotlaser(words: list[str], number: int) -> ScanLine:
    """Parse a ROBOTLASER1 or a RAWLASER1 line.

    Args:
        words: the line's words.
        number: the line's number.

    Returns:
        Its data; without poses for a RAWLASER1 line.

    Raises:
        ValueError: if the line is not valid.
        IndexError: if the line is too short.
    """
    start, fov, step, most = (float(word) for word in words[2:6])
    end = 9 + _count(words[8])
    remissions = int(words[end])
    if remissions < 0:
        raise ValueError(words[end])
    ranges, tail = _ranges(words[9:end]), words[end + 1 + remissions :]
    poses: tuple[float, ...] | None = None
    if words[0] == "RAWLASER1":
        clocks = _clocks(tail, 0)
    else:
        poses, clocks = _tail(tail, 11)
    # CARMEN writes 0 if it does not know the maximum range.
    stated = most if math.isfinite(most) and most > 0.0 else math.inf
    return ScanLine(number, ranges, poses, clocks, (start, step, fov), stated)


def odometry(words: list[str]) -> tuple[float, float, float, float, float]:
    """Parse an ODOM line.

    Args:
        words: the line's words.

    Returns:
        The robot's pose x, y, yaw, m and rad, and its time by the robot's and the logger's clock,
        s; NaN without the latter.

    Raises:
        ValueError: if the line is not valid.
        IndexError: if the line is too short.
    """
    x, y, yaw, t_s = (float(words[k]) for k in (1, 2, 3, 7))
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
        raise ValueError("no pose")
    logger_t_s = math.nan
    with suppress(ValueError, IndexError):
        logger_t_s = float(words[9])
    return x, y, yaw, t_s, logger_t_s


def _count(word: str) -> int:
    count = int(word)
    if not 1 <= count <= _MOST_BEAMS:
        raise ValueError(word)
    return count


def _ranges(words: list[str]) -> Ranges:
    """Parse ranges; a number beyond single precision becomes inf, which means no echo."""
    with np.errstate(over="ignore"):
        return np.fromiter(map(float, words), np.float64, len(words)).astype(np.float32)


def _tail(words: list[str], t_at: int) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Parse the words after the ranges: laser pose, robot pose, and two clocks from ``t_at``."""
    poses = tuple(float(word) for word in words[:6])
    if len(poses) < 6:
        raise ValueError("cut off")
    return poses, _clocks(words, t_at)


def _clocks(words: list[str], t_at: int) -> tuple[float, float]:
    """Parse the stamps of the laser's and of the logger's clock; the second may be missing."""
    t_s = float(words[t_at])
    return t_s, float(words[t_at + 2]) if len(words) > t_at + 2 else math.nan
