"""Check that output files can be written, and write each file as a whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from simloop.common.errors import InputError


def check_file(path: Path, flag: str) -> None:
    """Check that a file can be written, without creating it.

    Args:
        path: The file. Its directory need not exist yet.
        flag: The option that names the file, for the error message.

    Raises:
        InputError: If the file cannot be written.
    """
    if str(path) == "-":
        raise InputError(f"{flag} -: standard output is not supported here; give a file")
    if path.is_dir():
        raise InputError(f"{flag} {path}: this is a directory; give a file")
    if path.exists():
        if not os.access(path, os.W_OK):
            raise InputError(f"{flag} {path}: not writable")
        return
    _check_place(path.parent, f"{flag} {path}")


def check_directory(path: Path, flag: str) -> None:
    """Check that files can be created in a directory, or in its nearest existing parent.

    Args:
        path: The directory.
        flag: The option that names the directory, for the error message.

    Raises:
        InputError: If no file can be created there.
    """
    _check_place(path, f"{flag} {path}")


def _check_place(directory: Path, what: str) -> None:
    place = directory.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{what}: {place} is not a directory")
    try:
        # Permissions are not enough: the file system may be read-only, full or virtual.
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(f"{what}: not writable: {error.strerror}") from None


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all.

    Args:
        path: The file. It is replaced if it exists.
        text: Its new content, written as UTF-8.

    Raises:
        InputError: If the file cannot be written, e.g. because the disk is full.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a binary file as a whole or not at all.

    Args:
        path: The file. It is replaced if it exists.
        data: Its new content.

    Raises:
        InputError: If the file cannot be written, e.g. because the disk is full.
    """
    # Write a partial file beside the target and rename it, so that a reader never sees half a file.
    partial = path.with_name(f".{path.name}.partial")
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)  # a device or a pipe cannot be replaced
            return
        partial.write_bytes(data)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
