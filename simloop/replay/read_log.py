"""Read a log file of any supported format."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.replay.carmen import parse_carmen
from simloop.replay.laser_log import LaserLog, beam_angles, clean_log

_NPZ_KEYS = ("scan_t_s", "scan_ranges_m", "scan_odom_xyyaw", "fov_deg")
_CARMEN_SUFFIXES = (".log", ".clf", ".carmen", ".txt")


def read_log(path: Path) -> LaserLog:
    """Read a CARMEN log or an ``.npz``.

    Args:
        path: the file; its suffix gives the format.

    Returns:
        The log.

    Raises:
        InputError: if the file is missing or is not a valid log.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a directory, not a log")
    if path.suffix.lower() == ".npz":
        return _read_npz(path)
    if path.suffix.lower() in _CARMEN_SUFFIXES:
        return parse_carmen(path.read_text(encoding="latin-1").splitlines(), str(path))
    known = ", ".join((".npz", *_CARMEN_SUFFIXES))
    raise InputError(f"{path}: not a log; its suffix must be one of {known}")


def _read_npz(path: Path) -> LaserLog:
    """Read a log stored as numpy arrays, and check the arrays' shapes."""
    try:
        with np.load(path, allow_pickle=False) as data:
            table = {key: np.asarray(data[key], np.float64) for key in data.files}
    except (ValueError, TypeError, EOFError, OSError, zipfile.BadZipFile, KeyError) as error:
        raise InputError(f"{path}: not a readable .npz: {error}") from None
    for key in _NPZ_KEYS:
        if key not in table:
            raise InputError(f"{path}: {key} is missing; required: {', '.join(_NPZ_KEYS)}")
    t_s, ranges, odom = (table[key] for key in _NPZ_KEYS[:3])
    scans = len(t_s) if t_s.ndim == 1 else 0
    if scans == 0 or ranges.ndim != 2 or len(ranges) != scans or odom.shape != (scans, 3):
        raise InputError(
            f"{path}: scan_t_s {t_s.shape}, scan_ranges_m {ranges.shape} and scan_odom_xyyaw "
            f"{odom.shape} do not match; required: (n,), (n, beams) and (n, 3)"
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
    # The file's offset goes from the laser to base_link. Odometry and relations are of base_link.
    laser = np.array([-offset[0], 0.0, 0.0])
    angles = beam_angles(ranges.shape[1], fov)
    return clean_log(t_s, ranges, angles, odom, laser, str(path), relations)
