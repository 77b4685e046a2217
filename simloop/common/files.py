"""The files of a run: checked before anything is done, written so that none is ever half there."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from simloop.common.errors import InputError


def check_file(path: Path, flag: str) -> None:
    """Raise InputError if a file could not be written there."""
    if path.is_dir():
        raise InputError(f"{flag} {path}: is a directory, not a file")
    if path.exists():
        if not os.access(path, os.W_OK):
            raise InputError(f"{flag} {path}: not writable")
        return
    _check_place(path.parent, f"{flag} {path}")


def check_directory(path: Path, flag: str) -> None:
    """Raise InputError if files could not be made there, or in the nearest parent that exists."""
    _check_place(path, f"{flag} {path}")


def _check_place(directory: Path, what: str) -> None:
    place = directory.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{what}: {place} is not a directory")
    try:
        # Asking for permission is not enough: file systems may be read-only, full or unreal.
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(f"{what}: not writable: {error.strerror}") from None


def write_text(path: Path, text: str) -> None:
    """Write a whole file or none: beside it first, then moved into place.

    Raises InputError, which names the file, where that fails (a full disk, say).
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """``write_text`` of bytes."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)  # a device or a pipe: nothing to move
            return
        partial.write_bytes(data)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
