"""Read CARMEN's text logs: the front laser's scans, with the pose by odometry of each.

Odometry is raw. The laser's pose on the robot is computed from the laser's and the robot's poses in
a line. In some logs the laser's poses were corrected afterwards and do not belong to the robot's
poses. Then the offset of the PARAM line is used.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable

import numpy as np

from simloop.common.errors import InputError
from simloop.common.limits import LOG_READINGS, LOG_SCANS, check_limit
from simloop.geometry.se2 import wrap_angles
from simloop.messages import FloatArray
from simloop.replay.beams import flaser_angles, robotlaser_angles
from simloop.replay.carmen_lines import Parameters, ScanLine, flaser, odometry, robotlaser
from simloop.replay.laser_log import LaserLog, RawScans, clean_log
from simloop.replay.odometry import Odometry
from simloop.replay.unused import Unused

_SCANS = {"FLASER": flaser, "ROBOTLASER1": robotlaser, "RAWLASER1": robotlaser}
_OTHER_LASERS = (
    *("RLASER", "LASER3", "LASER4", "LASER5"),
    *(f"{kind}{k}" for kind in ("ROBOTLASER", "RAWLASER") for k in (2, 3, 4, 5)),
)
_MOST_ODOMETRY = 10_000_000  # ODOM lines
_STEADY = 0.01  # a laser that seems to move by less is fixed, m and rad: the log is rounded
_MOST_OFFSET_M = 1.5  # a larger offset by the poses in the lines is an error of these poses


class _Lines:
    """The lines of a log that matter, by kind."""

    def __init__(self, lines: Iterable[str], name: str) -> None:
        self.scans: dict[str, list[ScanLine]] = {kind: [] for kind in _SCANS}
        self.bad: dict[str, list[int]] = {kind: [] for kind in _SCANS}
        self.odom = array("d")  # line, x, y, yaw and two stamps of each ODOM line
        self.bad_odom, self.first_bad_odom = 0, 0  # number, and line of the first
        self.others: Counter[str] = Counter()
        self.parameters = Parameters()
        self._name, readings = name, 0
        for number, line in enumerate(lines, 1):
            head = line[:64].split(maxsplit=1)
            kind = head[0] if head else ""
            if kind == "PARAM":
                self.parameters.read(line.split(), f"{name}, line {number}")
            elif kind == "ODOM":
                self._add_odometry(line.split(), number)
            elif kind in _OTHER_LASERS:
                self.others[kind] += 1
            elif kind in _SCANS:
                readings += self._add_scan(kind, line.split(), number)
                check_limit(readings, LOG_READINGS, f"{name}: ranges of all scans")
                check_limit(len(self.scans[kind]), LOG_SCANS, f"{name}: scans")

    def _add_scan(self, kind: str, words: list[str], number: int) -> int:
        try:
            scan = _SCANS[kind](words, number)
        except (ValueError, IndexError):
            self.bad[kind].append(number)
            check_limit(len(self.bad[kind]), LOG_SCANS, f"{self._name}: invalid laser lines")
            return 0
        self.scans[kind].append(scan)
        return len(scan.ranges)

    def _add_odometry(self, words: list[str], number: int) -> None:
        try:
            self.odom.extend((number, *odometry(words)))
        except (ValueError, IndexError):
            self.bad_odom += 1
            self.first_bad_odom = self.first_bad_odom or number
        check_limit(len(self.odom) // 6, _MOST_ODOMETRY, f"{self._name}: ODOM lines")

    def odometry(self) -> FloatArray:
        """Return (m, 6) line, x, y, yaw and two stamps of each ODOM line."""
        return np.frombuffer(self.odom).reshape(-1, 6)

    def wrong_odometry(self) -> str:
        """Describe the ODOM lines that are not valid."""
        total = self.bad_odom + len(self.odom) // 6
        return (
            f"{self.bad_odom} of {total} ODOM lines are not valid, and not used "
            f"(first at line {self.first_bad_odom})"
        )

    def front_laser(self, name: str) -> str:
        """Choose the kind of the lines: that of most scans; lines with poses are preferred."""
        kinds = [k for k in ("ROBOTLASER1", "FLASER") if self.scans[k]] or ["RAWLASER1"]
        kind = max(kinds, key=lambda k: len(self.scans[k]))
        if self.scans[kind]:
            return kind
        bad = min((number for numbers in self.bad.values() for number in numbers), default=0)
        if bad:
            raise InputError(
                f"{name}, line {bad}: not a valid laser line; the log has no valid one"
            )
        raise InputError(
            f"{name}: has no FLASER, ROBOTLASER1 or RAWLASER1 line; is it a CARMEN log?"
        )

    def left_out(self, kind: str) -> list[str]:
        """Describe the lines that are not used: of other kinds, not valid, of other settings."""
        others = dict(self.others)
        if kind != "RAWLASER1":  # otherwise these are the same scans, without poses
            others |= {k: len(s) for k, s in self.scans.items() if k not in (kind, "RAWLASER1")}
        said = [f"{count} {k} lines are not used" for k, count in others.items() if count]
        said += [
            f"{len(bad)} {k} lines are not valid, and not used (first at line {bad[0]})"
            for k, bad in self.bad.items()
            if bad and k != kind
        ]
        said += [self.wrong_odometry()] if self.bad_odom else []
        said += [f"PARAM {name} is not used" for name in self.parameters.ignored]
        return said


def parse_carmen(lines: Iterable[str], name: str = "log") -> LaserLog:
    """Read the front laser's scans from a log.

    Args:
        lines: the log's lines.
        name: name of the log in error messages.

    Returns:
        The usable scans, in the order of their lines.

    Raises:
        InputError: if there is no scan, if most scans cannot be used, if a number that is needed
            is not plausible, or if the log is too large.
    """
    read = _Lines(lines, name)
    kind = read.front_laser(name)
    unused = Unused()
    if read.bad[kind]:
        count = len(read.bad[kind])
        unused.add("not a valid line", f"line {read.bad[kind][0]}", count)
    scans = _of_one_laser(read.scans[kind], unused)
    notes = read.left_out(kind)
    angles, note = _angles(scans[0], read.parameters)
    notes += [note] if note else []
    odom, laser = _poses(scans, read, name, notes)
    ranges = np.array([scan.ranges for scan in scans])
    clocks = np.array([scan.clocks for scan in scans]).T.copy()
    places = [scan.number for scan in scans]
    lines = read.odometry()
    every = Odometry((lines[:, 4], lines[:, 5]), lines[:, 1:4]) if len(lines) else None
    raw = RawScans(ranges, odom, (clocks[0], clocks[1]), places, "line", None, every)
    stated = Counter(scan.range_max_m for scan in scans).most_common(1)[0][0]
    return clean_log(raw, angles, laser, name, unused, None, stated, notes)


def _of_one_laser(scans: list[ScanLine], unused: Unused) -> list[ScanLine]:
    """Return the scans with the most frequent beams: a log may hold two lasers, or cut lines."""

    def form(scan: ScanLine) -> tuple[object, ...]:
        return len(scan.ranges), repr(scan.sweep)  # repr, because NaN is not equal to itself

    common = Counter(map(form, scans)).most_common(1)[0][0]
    chosen = [scan for scan in scans if form(scan) == common]
    other = next((scan for scan in scans if form(scan) != common), None)
    if other is not None:
        reason = f"not the {common[0]} beams of most scans"
        unused.add(reason, f"line {other.number}", len(scans) - len(chosen))
    return chosen


def _angles(scan: ScanLine, parameters: Parameters) -> tuple[FloatArray, str]:
    """Return the directions of the beams and what was assumed for them."""
    beams = len(scan.ranges)
    if scan.sweep is not None:
        start, step, fov = scan.sweep
        found = robotlaser_angles(beams, start, step, fov)
        if found is not None:
            return found
    return flaser_angles(beams, parameters.resolution_deg, parameters.fov_deg)


def _poses(
    scans: list[ScanLine], read: _Lines, name: str, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the robot's pose (n, 3) at each scan, and base_from_laser (3,)."""
    by_parameter = np.array([read.parameters.offset_m, 0.0, 0.0])
    poses = [scan.poses for scan in scans if scan.poses is not None]
    if poses:
        both = np.array(poses)
        return both[:, 3:], _laser_offset(both[:, :3], both[:, 3:], by_parameter)
    if read.bad_odom > len(read.odom) // 6:
        raise InputError(
            f"{name}: most of the log's odometry cannot be used: {read.wrong_odometry()}"
        )
    if not read.odom:
        notes.append("the log has no odometry: the robot is taken to stand still")
        return np.zeros((len(scans), 3)), by_parameter
    odom = read.odometry()
    return _odometry_at(scans, odom), by_parameter


def _odometry_at(scans: list[ScanLine], odom: FloatArray) -> FloatArray:
    """Interpolate the poses (n, 3) of the ODOM lines before and after each scan's line.

    The stamps tell where between the two. If they do not, the pose before the scan counts.
    """
    numbers, poses, t_s = odom[:, 0], odom[:, 1:4], odom[:, 4]
    after = np.searchsorted(numbers, [scan.number for scan in scans])
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, len(odom) - 1)
    when = np.array([scan.clocks[0] for scan in scans])
    with np.errstate(all="ignore"):
        share = (when - t_s[before]) / (t_s[after] - t_s[before])
        share = np.where((share >= 0.0) & (share <= 1.0), share, 0.0)[:, None]  # NaN becomes 0
        step = poses[after] - poses[before]
        step[:, 2] = wrap_angles(step[:, 2])
        return np.asarray(poses[before] + share * step)


def _laser_offset(laser: FloatArray, odom: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return base_from_laser (3,), by the poses if constant there."""
    with np.errstate(all="ignore"):
        off, cos, sin = laser - odom, np.cos(odom[:, 2]), np.sin(odom[:, 2])
        seen = np.column_stack(
            [
                cos * off[:, 0] + sin * off[:, 1],
                cos * off[:, 1] - sin * off[:, 0],
                wrap_angles(off[:, 2]),
            ]
        )
    seen = seen[np.isfinite(seen).all(axis=1)]
    if not len(seen):
        return otherwise
    middle = np.median(seen, axis=0)
    apart = np.abs(seen - middle)
    apart[:, 2] = np.minimum(apart[:, 2], 2.0 * math.pi - apart[:, 2])
    steady = np.quantile(apart, 0.9, axis=0).max() < _STEADY
    if steady and math.hypot(middle[0], middle[1]) <= _MOST_OFFSET_M and middle.any():
        return middle
    return otherwise
