"""Choose a folder for numba's compiled kernels where the usual ones cannot be written.

numba keeps them beside the package, or else below the user's HOME, and refuses to start without
either, as in a container with a read-only file system or for a user without a home. It also fails
whenever it meets a file that a full disk or a crash cut short, so such files are removed.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from simloop.common.errors import InputError

_VARIABLE = "NUMBA_CACHE_DIR"
_KINDS = (".nbi", ".nbc")  # numba's index files and compiled kernels
_LAST = b"."  # both are pickles, whose last byte is this one
_PACKAGE = Path(__file__).resolve().parent.parent


def prepare_kernel_cache() -> str | None:
    """Set NUMBA_CACHE_DIR to a temporary folder if numba could not write its cache otherwise.

    Files of the cache that were cut short are removed, so that their kernels are compiled again.
    Call it before numba is imported. Processes that are started later get the same folder.

    Returns:
        A note for the user if the folder was set or files were removed; otherwise None.

    Raises:
        InputError: If NUMBA_CACHE_DIR is set to a folder that cannot be written, or if there is no
            temporary folder either.
    """
    note = _choose_folder()
    cut_short = [path for path in _files(_present_folder()) if _is_cut_short(path)]
    for path in cut_short:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(
                f"{path}: a damaged file of compiled kernels, which cannot be removed: "
                f"{error.strerror}"
            ) from None
    if not cut_short:
        return note
    damaged = (
        f"{len(cut_short)} damaged file(s) of compiled kernels in {_present_folder()} were removed"
    )
    return f"{note}; {damaged}" if note else damaged


def in_kernel_cache(error: BaseException) -> Path | None:
    """Find out whether an error arose while numba read its cache.

    Args:
        error: The error with its traceback.

    Returns:
        The folder of the cache; None if the error arose elsewhere.
    """
    trace = error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if code.co_name in ("_load_index", "_load_data") and "numba" in code.co_filename:
            return _present_folder()
        trace = trace.tb_next
    return None


def _choose_folder() -> str | None:
    """Set NUMBA_CACHE_DIR if need be; return a note for the user if it was set."""
    named = os.environ.get(_VARIABLE)
    if named:
        if _can_write(Path(named)):
            return None
        raise InputError(f"{_VARIABLE}={named}: cannot be written; name another folder")
    if _can_write(_PACKAGE / "common" / "__pycache__") or _can_write(_users_cache()):
        return None
    folder = _temporary_folder()
    os.environ[_VARIABLE] = str(folder)
    return (
        f"neither {_PACKAGE} nor {_users_cache()} can be written, so compiled kernels are kept in "
        f"{folder} (to choose another folder, set {_VARIABLE})"
    )


def _present_folder() -> Path:
    """Find the folder that numba uses."""
    named = os.environ.get(_VARIABLE)
    if named:
        return Path(named)
    return _PACKAGE if _can_write(_PACKAGE / "common" / "__pycache__") else _users_cache()


def _files(folder: Path) -> Iterator[Path]:
    for at, _, names in os.walk(folder):
        yield from (Path(at, name) for name in names if name.endswith(_KINDS))


def _is_cut_short(path: Path) -> bool:
    """Return whether a file does not end as a pickle does, e.g. because it is empty."""
    try:
        with path.open("rb") as file:
            if not file.seek(0, os.SEEK_END):
                return True
            file.seek(-1, os.SEEK_END)
            return file.read() != _LAST
    except OSError:
        return False  # removed by another process, or numba will say why it cannot be read


def _users_cache() -> Path:
    """Find the folder below HOME that numba uses."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "numba"


def _temporary_folder() -> Path:
    """Make a folder that only this user can write, because kernels in it are executed."""
    user = os.getuid()
    try:
        shared = Path(tempfile.gettempdir()) / f"simloop-kernels-{user}"
        shared.mkdir(mode=0o700, exist_ok=True)
        status = shared.lstat()
        private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
        if private and status.st_uid == user and _can_write(shared):
            return shared
        return Path(tempfile.mkdtemp(prefix="simloop-kernels-"))
    except OSError as error:
        raise InputError(
            f"compiled kernels cannot be kept anywhere ({error.strerror}): set {_VARIABLE} to a "
            "folder that can be written"
        ) from None


def _can_write(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
