"""Choose a folder for numba's compiled kernels where the usual ones cannot be written.

numba keeps them beside the package, or else below the user's HOME, and refuses to start without
either, as in a container with a read-only file system or for a user without a home.
"""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from simloop.common.errors import InputError

_VARIABLE = "NUMBA_CACHE_DIR"
_PACKAGE = Path(__file__).resolve().parent.parent


def prepare_kernel_cache() -> str | None:
    """Set NUMBA_CACHE_DIR to a temporary folder if numba could not write its cache otherwise.

    Call it before numba is imported. Processes that are started later get the same folder.

    Returns:
        A note for the user if the folder was set; otherwise None.

    Raises:
        InputError: If NUMBA_CACHE_DIR is set to a folder that cannot be written, or if there is no
            temporary folder either.
    """
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
