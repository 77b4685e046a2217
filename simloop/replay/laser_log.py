"""A recorded log of a planar laser on a wheeled robot, whatever file it came from."""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray

_RANGE_MIN_M = 0.1  # what is nearer is the robot's own, or dust
_NPZ_NEEDS = ("scan_t_s", "scan_ranges_m", "scan_odom_xyyaw", "fov_deg")
_CARMEN_ENDS = (".log", ".clf", ".carmen", ".txt")


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


def read_log(path: Path) -> LaserLog:
    """Read a CARMEN log or an ``.npz``. Raises InputError, one line, for what is neither."""
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a directory, not a log")
    if path.suffix.lower() == ".npz":
        return _read_npz(path)
    if path.suffix.lower() in _CARMEN_ENDS:
        from simloop.replay.carmen import parse_carmen

        return parse_carmen(path.read_text(encoding="latin-1").splitlines(), str(path))
    raise InputError(f"{path}: not a log; choices: .npz, {', '.join(_CARMEN_ENDS)}")


def _read_npz(path: Path) -> LaserLog:
    try:
        with np.load(path, allow_pickle=False) as data:
            table = {key: np.asarray(data[key], np.float64) for key in data.files}
    except (ValueError, TypeError, EOFError, OSError, zipfile.BadZipFile, KeyError) as error:
        raise InputError(f"{path}: not a readable .npz: {error}") from None
    for key in _NPZ_NEEDS:
        if key not in table:
            raise InputError(f"{path}: has no {key}; needs {', '.join(_NPZ_NEEDS)}")
    t_s, ranges, odom = (table[key] for key in _NPZ_NEEDS[:3])
    scans = len(t_s) if t_s.ndim == 1 else 0
    if scans == 0 or ranges.ndim != 2 or len(ranges) != scans or odom.shape != (scans, 3):
        raise InputError(
            f"{path}: scan_t_s {t_s.shape}, scan_ranges_m {ranges.shape} and scan_odom_xyyaw "
            f"{odom.shape} do not belong together"
        )
    if table["fov_deg"].size != 1 or not 0.0 < float(table["fov_deg"].ravel()[0]) <= 360.0:
        raise InputError(f"{path}: fov_deg must be one number in (0, 360]")
    relations = table.get("relations_t1_t2_dx_dy_dyaw")
    if relations is not None and (relations.ndim != 2 or relations.shape[1] != 5):
        raise InputError(f"{path}: relations_t1_t2_dx_dy_dyaw must be (m, 5)")
    fov = math.radians(float(table["fov_deg"].ravel()[0]))
    offset = table.get("laser_offset_x_m", np.zeros(1)).ravel()
    if offset.size != 1 or not np.isfinite(offset).all():
        raise InputError(f"{path}: laser_offset_x_m must be one number")
    # The offset leads from the laser to the poses that relations and odometry are of.
    laser = np.array([-offset[0], 0.0, 0.0])
    angles = beam_angles(ranges.shape[1], fov)
    return sound_log(t_s, ranges, angles, odom, laser, str(path), relations)


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
