"""Read a log file of any supported format."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from simloop.common.errors import InputError
from simloop.common.input_files import open_regular
from simloop.common.limits import (
    LOG_BYTES,
    LOG_LINE_BYTES,
    LOG_LINES,
    LOG_UNPACKED_TIMES,
    check_limit,
)
from simloop.replay.carmen import parse_carmen
from simloop.replay.laser_log import LaserLog
from simloop.replay.npz_log import read_npz

_CARMEN_SUFFIXES = (".log", ".clf", ".carmen", ".txt")
_GZIP, _MAGIC = ".gz", b"\x1f\x8b"

LOG_SUFFIXES = (".npz", *_CARMEN_SUFFIXES, *(suffix + _GZIP for suffix in _CARMEN_SUFFIXES))
"""Endings of the names of logs."""

_FREE_BYTES = 2**22  # a packed log may unpack to so much whatever its file's size


def read_log(path: Path) -> LaserLog:
    """Read a CARMEN log, plain or packed by gzip, or an ``.npz``.

    Args:
        path: the file; its suffix gives the format.

    Returns:
        The log.

    Raises:
        InputError: if the file is missing, too large, or not a valid log.
    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes[-1:] == [".npz"]:
        return read_npz(path)
    if suffixes[-1:] == [_GZIP]:
        suffixes.pop()
    if (not suffixes or suffixes[-1] not in _CARMEN_SUFFIXES) and path.exists():
        known = ", ".join(LOG_SUFFIXES)
        raise InputError(f"{path}: not a log; its suffix must be one of {known}")
    with open_regular(path) as file:
        lines = _Lines(file, str(path))
        try:
            log = parse_carmen(lines, str(path))
        except InputError as error:
            raise InputError("; ".join((str(error), *lines.notes))) from None
    return replace(log, notes=(*log.notes, *lines.notes))


class _Unpacked(io.RawIOBase):
    """A packed file's bytes, up to where it is cut off. A buffer around it reads lines quickly."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = gzip.GzipFile(fileobj=file)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        # `read` would lose what it has unpacked when it meets the end.
        some = self._file.read1(len(buffer))
        buffer[: len(some)] = some
        return len(some)


class _Lines:
    """Lines of a text, which may be packed. The whole text is never in memory.

    Attributes:
        notes: what was left out, one sentence each.
    """

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._name, self.notes = name, list[str]()
        self._size = file.seek(0, 2)
        check_limit(self._size, LOG_BYTES, f"{name}: size", "bytes")
        file.seek(0)
        self._packed = file.read(2) == _MAGIC
        file.seek(0)
        self._text = io.BufferedReader(_Unpacked(file)) if self._packed else file

    def __iter__(self) -> Iterator[str]:
        most = LOG_BYTES
        if self._packed:
            most = min(most, _FREE_BYTES + LOG_UNPACKED_TIMES * self._size)
        total, number = 0, 0
        while line := self._line():
            number += 1
            total += len(line)
            if total > most or number > LOG_LINES or len(line) > LOG_LINE_BYTES:
                where = f"{self._name}, line {number}"
                check_limit(len(line), LOG_LINE_BYTES, f"{where}: length", "bytes")
                check_limit(number, LOG_LINES, f"{self._name}: lines")
                check_limit(total, most, f"{where}: size up to here", "bytes")
            yield line.decode("latin-1")

    def _line(self) -> bytes:
        """Return the next line, empty at the end."""
        try:
            return self._text.readline(LOG_LINE_BYTES + 1)
        except EOFError:
            self.notes.append("the packed file is cut off: only what comes before is read")
            return b""
        except (zlib.error, gzip.BadGzipFile) as error:
            raise InputError(f"{self._name}: not readable by gzip: {error}") from None
        except OSError as error:
            raise InputError(f"{self._name}: cannot be read: {error.strerror}") from None
