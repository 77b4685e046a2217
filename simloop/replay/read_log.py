"""Reads a log, whatever its format."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.replay.laser_log import LaserLog, beam_angles, sound_log

_NPZ_NEEDS = ("scan_t_s", "scan_ranges_m", "scan_odom_xyyaw", "fov_deg")
_CARMEN_ENDS = (".log", ".clf", ".carmen", ".txt")


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
