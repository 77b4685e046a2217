"""Read a log stored as numpy arrays (.npz).

An array's header tells its shape. It is checked before memory is taken for the array, because a
small file may unpack to any size, and a header may lie.
"""

from __future__ import annotations

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.common.input_files import open_regular
from simloop.common.limits import (
    LOG_BYTES,
    LOG_ODOMETRY,
    LOG_READINGS,
    LOG_SCANS,
    RELATIONS,
    check_limit,
)
from simloop.replay.beams import beam_angles
from simloop.replay.laser_log import MOST_OFFSET_M, LaserLog, RawScans, clean_log
from simloop.replay.odometry import Odometry
from simloop.replay.relations import IMPLAUSIBLE, first_implausible
from simloop.replay.unused import Unused

_Numbers = NDArray[Any]
_REQUIRED = ("scan_t_s", "scan_ranges_m", "scan_odom_xyyaw", "fov_deg")
_RELATIONS = "relations_t1_t2_dx_dy_dyaw"
_OFFSET = "laser_offset_x_m"
_REFERENCE = "ref_gmapping_xyyaw"
_ODOM_T, _ODOM = "odom_t_s", "odom_xyyaw"
_MOST_NUMBERS = {
    "scan_t_s": LOG_SCANS,
    "scan_ranges_m": LOG_READINGS,
    "scan_odom_xyyaw": 3 * LOG_SCANS,
    "fov_deg": 1,
    _RELATIONS: 5 * RELATIONS,
    _OFFSET: 1,
    _REFERENCE: 3 * LOG_SCANS,
    _ODOM_T: LOG_ODOMETRY,
    _ODOM: 3 * LOG_ODOMETRY,
}
_CHUNK = 1 << 20  # numbers that are read at once
_END, _END_BYTES = b"PK\x05\x06", 22  # a zip file's last record
_MOST_DIRECTORY = 2**20  # bytes of a zip file's list of contents
# What zipfile, zlib and numpy's parser of headers raise for a broken file.
_BROKEN = (
    *(ValueError, SyntaxError, TypeError, KeyError, OverflowError, RuntimeError, MemoryError),
    *(OSError, EOFError, zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError),
)


def read_npz(path: Path) -> LaserLog:
    """Read a log from an ``.npz``.

    Args:
        path: the file.

    Returns:
        The log.

    Raises:
        InputError: if the file is missing, too large, or not a valid log.
    """
    name = str(path)
    with open_regular(path) as file:
        table = _arrays(file, name)
    for key in _REQUIRED:
        if key not in table:
            raise InputError(f"{name}: {key} is missing; required: {', '.join(_REQUIRED)}")
    t_s, ranges, odom = (table[key] for key in _REQUIRED[:3])
    scans = len(t_s) if t_s.ndim == 1 else 0
    if scans == 0 or ranges.ndim != 2 or len(ranges) != scans or odom.shape != (scans, 3):
        raise InputError(
            f"{name}: scan_t_s {t_s.shape}, scan_ranges_m {ranges.shape} and scan_odom_xyyaw "
            f"{odom.shape} do not match; required: (n,), (n, beams) and (n, 3)"
        )
    if ranges.shape[1] == 0:
        raise InputError(f"{name}: scan_ranges_m {ranges.shape} has no beam")
    fov_deg = _number(table, "fov_deg", name)
    if not 0.0 < fov_deg <= 360.0:
        raise InputError(f"{name}: fov_deg {fov_deg:g} must be one number in (0, 360]")
    offset_m = _number(table, _OFFSET, name) if _OFFSET in table else 0.0
    if not abs(offset_m) <= MOST_OFFSET_M:
        raise InputError(
            f"{name}: {_OFFSET} {offset_m:g} must be a number from {-MOST_OFFSET_M:g} to "
            f"{MOST_OFFSET_M:g} m"
        )
    relations = _relations(table, name)
    # The file's offset goes from the laser to base_link. Odometry and relations are of base_link.
    laser = np.array([-offset_m, 0.0, 0.0])
    angles = beam_angles(ranges.shape[1], math.radians(fov_deg))
    ranges, notes = ranges.astype(np.float32, copy=False), list[str]()
    reference, odometry = _reference(table, name, scans), _odometry(table, name, notes)
    raw = RawScans(ranges, odom, (t_s,), range(scans), "scan", reference, odometry)
    return clean_log(raw, angles, laser, name, Unused(), relations, notes=notes)


def _relations(table: dict[str, _Numbers], name: str) -> _Numbers | None:
    relations = table.get(_RELATIONS)
    if relations is not None:
        if relations.ndim != 2 or relations.shape[1] != 5:
            raise InputError(f"{name}: {_RELATIONS} {relations.shape} must be (m, 5)")
        wrong = first_implausible(relations)
        if wrong is not None:
            raise InputError(f"{name}: {_RELATIONS}, row {wrong}: {IMPLAUSIBLE}")
    return relations


def _reference(table: dict[str, _Numbers], name: str, scans: int) -> _Numbers | None:
    reference = table.get(_REFERENCE)
    if reference is not None and reference.shape != (scans, 3):
        raise InputError(f"{name}: {_REFERENCE} {reference.shape} must be ({scans}, 3)")
    return reference


def _odometry(table: dict[str, _Numbers], name: str, notes: list[str]) -> Odometry | None:
    """Return the odometry lines, and add a note on those that cannot be used."""
    t_s, poses = table.get(_ODOM_T), table.get(_ODOM)
    if t_s is None or poses is None:
        if t_s is not None or poses is not None:
            notes.append(f"of {_ODOM_T} and {_ODOM} only one is there; it is not used")
        return None
    if t_s.ndim != 1 or poses.shape != (len(t_s), 3):
        raise InputError(
            f"{name}: {_ODOM_T} {t_s.shape} and {_ODOM} {poses.shape} do not match; required: (m,) "
            "and (m, 3)"
        )
    odometry = Odometry((t_s,), poses)
    lost = len(t_s) - len(odometry.usable(0).t_s)
    if lost:
        notes.append(
            f"{lost} of {len(t_s)} odometry lines are not used: the stamp does not rise, or the "
            "pose is not finite"
        )
    return odometry


def _number(table: dict[str, _Numbers], key: str, name: str) -> float:
    if table[key].size != 1:
        raise InputError(f"{name}: {key} {table[key].shape} must be one number")
    return float(table[key].ravel()[0])


def _arrays(file: BinaryIO, name: str) -> dict[str, _Numbers]:
    """Read the arrays that a log needs; the ranges in single, the others in double precision."""
    table = {}
    try:
        _check_directory(file, name)
        with zipfile.ZipFile(file) as archive:
            for key in _MOST_NUMBERS:
                if f"{key}.npy" in archive.NameToInfo:
                    table[key] = _array(archive, key, f"{name}: {key}")
    except InputError:
        raise
    except _BROKEN as error:
        raise InputError(f"{name}: not a readable .npz: {error}") from None
    return table


def _check_directory(file: BinaryIO, name: str) -> None:
    """Check the size of a zip file and of its list of contents, which zipfile reads as a whole."""
    size = file.seek(0, 2)
    check_limit(size, LOG_BYTES, f"{name}: size", "bytes")
    file.seek(max(0, size - _END_BYTES - 2**16))
    tail = file.read()
    at = tail.rfind(_END)
    if at < 0 or len(tail) < at + _END_BYTES:
        raise zipfile.BadZipFile("it is not a zip file, or it is cut off")
    (directory,) = struct.unpack_from("<I", tail, at + 12)
    check_limit(directory, _MOST_DIRECTORY, f"{name}: list of contents", "bytes")
    file.seek(0)


def _array(archive: zipfile.ZipFile, key: str, what: str) -> _Numbers:
    """Read one array, and check what its header says before."""
    info = archive.getinfo(f"{key}.npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{what}: packed by a method that numpy does not write")
    with archive.open(info) as member:
        shape, fortran, dtype = _header(member)
        if dtype.kind not in "fiu":
            raise InputError(f"{what}: has the type {dtype}; required: real numbers")
        if not all(isinstance(side, int) and side >= 0 for side in shape) or len(shape) > 2:
            raise InputError(f"{what}: has the shape {shape}")
        count = math.prod(shape)
        check_limit(count, _MOST_NUMBERS[key], f"{what}: numbers")
        if member.tell() + count * dtype.itemsize != info.file_size:
            raise InputError(f"{what}: has another size than its shape {shape} says")
        numbers: _Numbers = np.empty(count, np.float32 if key == "scan_ranges_m" else np.float64)
        _numbers(member, dtype, numbers)
    return numbers.reshape(shape, order="F" if fortran else "C")


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Read the header of an array: shape, whether columns come first, and type."""
    version = np.lib.format.read_magic(member)
    readers = {(1, 0): np.lib.format.read_array_header_1_0,
               (2, 0): np.lib.format.read_array_header_2_0}  # fmt: skip
    if version not in readers:
        raise ValueError(f"an array in version {version} of numpy's format")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shape, fortran, dtype = readers[version](member)
    return shape, fortran, dtype


def _numbers(member: IO[bytes], dtype: np.dtype, out: _Numbers) -> None:
    """Fill ``out`` piece by piece, so that the numbers are never in memory twice."""
    with np.errstate(over="ignore"):  # a range beyond single precision becomes inf: no echo
        for start in range(0, len(out), _CHUNK):
            some = out[start : start + _CHUNK]
            some[:] = np.frombuffer(member.read(len(some) * dtype.itemsize), dtype, len(some))
    member.read(1)  # at the end of the member, zipfile checks its sum
