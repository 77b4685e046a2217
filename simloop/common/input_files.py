"""Read files that others made: only regular files, and only up to a limit."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from simloop.common.errors import InputError
from simloop.common.limits import TEXT_BYTES


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading.

    Args:
        path: The file.

    Returns:
        The open file, in binary mode. The caller closes it.

    Raises:
        InputError: If it is missing, no regular file (a folder, FIFO or device), or not readable.
    """
    try:
        # Without O_NONBLOCK, opening a FIFO waits for a writer that may never come.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read: {reason}") from None
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        kind = "is a folder, not a file" if stat.S_ISDIR(mode) else "not a regular file"
        raise InputError(f"{path}: {kind}")
    return os.fdopen(handle, "rb")


def read_bytes(path: Path, most_bytes: int = TEXT_BYTES) -> bytes:
    """Read a file.

    Args:
        path: The file.
        most_bytes: Largest size allowed.

    Returns:
        The content.

    Raises:
        InputError: If it is missing, no regular file (a folder, FIFO or device), not readable, or
            larger than allowed.
    """
    with open_regular(path) as file:
        try:
            data = file.read(most_bytes + 1)  # a file in /proc says that it has no bytes
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > most_bytes:
        raise InputError(f"{path}: larger than {most_bytes // 2**20} MiB, the most that is read")
    return data


def read_text(path: Path, most_bytes: int = TEXT_BYTES) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Args:
        path: The file.
        most_bytes: Largest size allowed.

    Returns:
        The text.

    Raises:
        InputError: As `read_bytes`, or if the file is not text in UTF-8.
    """
    try:
        return read_bytes(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not text in UTF-8 (byte {error.start})") from None


def is_special(path: Path) -> bool:
    """Tell whether a path is a device, a FIFO or a socket, which cannot be replaced.

    Args:
        path: The path.

    Returns:
        Whether it is, also through a link. False if there is no such file.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)
