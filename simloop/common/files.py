"""Write output files: never over what is read, and each one as a whole or not at all.

A command names all files that it reads and writes in a `FilePlan`, and checks them before it does
anything. Files that belong together are written with `written_together`: all of them under
temporary names first, which are then renamed. `folder_lock` keeps a second process out of a folder.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import secrets
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from simloop.common.data_files import own_files
from simloop.common.errors import InputError
from simloop.common.input_files import is_special

_log = logging.getLogger(__name__)

_NAME_KEPT = 40  # characters of a file's name that its temporary name keeps; names are limited
_OWN = "a file of simloop itself"


class FilePlan:
    """Every file that a command reads and writes. simloop's own models and scenarios always count
    as read. Example:

    plan = FilePlan()
    plan.reads(scenario_file, "the scenario itself")
    plan.writes(json_file, "--json")
    plan.check()
    """

    def __init__(self) -> None:
        self._read: list[tuple[Path, str]] = []
        self._written: list[tuple[Path, str]] = []
        self._folders: list[tuple[Path, str]] = []

    def reads(self, path: Path | None, what: str) -> None:
        """Add a file that is read. No output may replace it.

        Args:
            path: The file; None is ignored. It need not exist.
            what: What it is, for the error message, e.g. ``the log``.
        """
        if path is not None:
            self._read.append((path, what))

    def reads_all(self, files: Mapping[Path, str]) -> None:
        """Add several files that are read.

        Args:
            files: What each file is.
        """
        self._read += files.items()

    def writes(self, path: Path | None, flag: str) -> None:
        """Add a file that will be written.

        Args:
            path: The file; None is ignored.
            flag: The option that names it.
        """
        if path is not None:
            self._written.append((path, flag))

    def writes_into(self, folder: Path | None, flag: str, names: Iterable[str] = ()) -> None:
        """Add a folder in which files will be written.

        Args:
            folder: The folder; None is ignored.
            flag: The option that names it.
            names: Names of the files, relative to the folder.
        """
        if folder is not None:
            self._folders.append((folder, flag))
            self._written += [(folder / name, flag) for name in names]

    def check(self) -> None:
        """Check that everything can be written, and that nothing takes the place of another file.

        Nothing is left on the disk.

        Raises:
            InputError: An output cannot be written, or it is the same file as an input or as
                another output, also by another name or link, or it lies below one of them.
        """
        for folder, flag in self._folders:
            check_directory(folder, flag)
        taken: dict[object, str] = {}
        for path, what in (*self._read, *((path, _OWN) for path in own_files())):
            taken |= dict.fromkeys(_identities(path), what)
        files: dict[str, str] = {}
        for path, flag in self._written:
            check_file(path, flag)
            if is_special(path):  # several outputs may go to a device such as /dev/null
                continue
            names = _identities(path)
            for name in names:
                if name in taken:
                    raise InputError(f"{flag} {path}: would overwrite {taken[name]}")
            taken |= dict.fromkeys(names, f"the output of {flag}")
            files[os.path.realpath(path)] = flag
        for folder, flag in self._folders:
            if os.path.realpath(folder) in files:
                other = files[os.path.realpath(folder)]
                raise InputError(f"{flag} {folder}: is the file of {other}, so it is no folder")
        for path, flag in (*self._written, *self._folders):
            for above in Path(os.path.realpath(path)).parents:
                if str(above) in files:
                    raise InputError(f"{flag} {path}: lies below the file of {files[str(above)]}")


def _identities(path: Path) -> list[object]:
    """List what tells two names of one file apart from two files: its path, its inode."""
    found: list[object] = []
    with suppress(OSError, ValueError):  # a file that does not exist has a path only
        found.append(os.path.realpath(path))
        status = os.stat(path)
        found.append((status.st_dev, status.st_ino))
    return found


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
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        target = Path(os.path.realpath(path))
        if path.is_symlink() and not target.parent.is_dir():
            raise InputError(f"{flag} {path}: leads to {target.parent}, which is missing") from None
        _check_place(target.parent if path.is_symlink() else path.parent, f"{flag} {path}")
        return
    except (OSError, ValueError) as error:
        raise InputError(f"{flag} {path}: cannot be written: {_reason(error)}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"{flag} {path}: this is a directory; give a file")
    if not os.access(path, os.W_OK):
        raise InputError(f"{flag} {path}: not writable")
    if stat.S_ISREG(mode):  # it is replaced, so its folder must be writable, too
        _check_place(Path(os.path.realpath(path)).parent, f"{flag} {path}")


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
    place = Path(os.path.abspath(directory))
    try:
        # A link that leads nowhere is there, although it does not exist.
        while not os.path.lexists(place) and place != place.parent:
            place = place.parent
        mode = os.stat(place).st_mode
        if not stat.S_ISDIR(mode):
            raise InputError(f"{what}: {place} is not a directory")
        for name in Path(os.path.abspath(directory)).relative_to(place).parts:
            if len(os.fsencode(name)) > 255:
                raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        # Permissions are not enough: the file system may be read-only, full or virtual.
        with tempfile.TemporaryFile(dir=place):
            pass
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{what}: not writable: {_reason(error)}") from None


def make_directory(path: Path) -> None:
    """Create a directory, and its parents, unless it exists.

    Args:
        path: The directory.

    Raises:
        InputError: If it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be created: {_reason(error)}") from None


class Batch:
    """Files that appear under their names together. See `written_together`."""

    def __init__(self) -> None:
        self._moves: list[tuple[Path, Path]] = []  # temporary file, target

    def write_text(self, path: Path, text: str) -> None:
        """Write a text file.

        Args:
            path: The file. It is replaced if it exists; a link to it stays a link.
            text: Its new content, written as UTF-8. A part that is no text in Unicode, such as an
                undecodable byte of a file's name, is written as an escape.

        Raises:
            InputError: If the file cannot be written, e.g. because the disk is full.
        """
        self.write_bytes(path, text.encode("utf-8", "backslashreplace"))

    def write_bytes(self, path: Path, data: bytes) -> None:
        """Write a binary file.

        Args:
            path: The file. It is replaced if it exists; a link to it stays a link.
            data: Its new content.

        Raises:
            InputError: If the file cannot be written, e.g. because the disk is full.
        """
        try:
            if is_special(path):  # a device or a pipe cannot be replaced
                path.write_bytes(data)
                return
            handle, partial = _open_new(path)
            self._moves.append((partial, Path(os.path.realpath(path))))
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # some file systems notice only here that they are full
        except (OSError, ValueError) as error:
            raise _not_written(path, error) from None

    def commit(self) -> None:
        """Give all files their names.

        Raises:
            InputError: If a file cannot be renamed.
        """
        while self._moves:
            partial, target = self._moves[0]
            try:
                partial.replace(target)
            except OSError as error:
                raise _not_written(target, error) from None
            self._moves.pop(0)

    def discard(self) -> None:
        """Remove all files that do not have their names yet."""
        for partial, _ in self._moves:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
        self._moves.clear()


@contextmanager
def written_together() -> Iterator[Batch]:
    """Write several files that belong together: all of them appear, or none does. Example:

        with written_together() as files:
            files.write_bytes(folder / "map.pgm", picture)
            files.write_text(folder / "map.yaml", facts)

    Yields:
        The batch. Its files get their names when the context is left without an error.

    Raises:
        InputError: If a file cannot be written. None of the files is changed then.
    """
    batch = Batch()
    try:
        yield batch
        batch.commit()
    finally:
        batch.discard()


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all.

    Args:
        path: The file. It is replaced if it exists.
        text: Its new content, written as UTF-8.

    Raises:
        InputError: If the file cannot be written, e.g. because the disk is full.
    """
    with written_together() as files:
        files.write_text(path, text)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a binary file as a whole or not at all.

    Args:
        path: The file. It is replaced if it exists.
        data: Its new content.

    Raises:
        InputError: If the file cannot be written, e.g. because the disk is full.
    """
    with written_together() as files:
        files.write_bytes(path, data)


def temporary_name(path: Path) -> Path:
    """Create an empty file beside another one, for a library that writes its files by itself.

    Args:
        path: The file that is to be written in the end.

    Returns:
        The new file. Its name has a random part, so that nobody can have put a link there, and the
        suffix of ``path``, so that what is left of it after a crash can be opened.

    Raises:
        InputError: If it cannot be created.
    """
    try:
        handle, partial = _open_new(path, f"{path.stem[:_NAME_KEPT]}.partial-", path.suffix)
        os.close(handle)
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None
    return partial


def _open_new(path: Path, prefix: str | None = None, suffix: str = ".partial") -> tuple[int, Path]:
    """Create a file of a random name in the folder of another one's target, and open it."""
    target = Path(os.path.realpath(path))
    prefix = f".{target.name[:_NAME_KEPT]}." if prefix is None else prefix
    partial = target.with_name(f"{prefix}{secrets.token_hex(6)}{suffix}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    handle = os.open(partial, flags, 0o666)
    with suppress(OSError):  # keep the permissions of a file that is replaced
        os.fchmod(handle, stat.S_IMODE(os.stat(target).st_mode))
    return handle, partial


@contextmanager
def folder_lock(*folders: Path | None) -> Iterator[None]:
    """Keep other processes from writing into folders at the same time.

    The lock is on the folder itself, so nothing is left behind, and it ends with the process.

    Args:
        folders: The folders, which exist; None is ignored.

    Yields:
        Nothing. The locks end with the context.

    Raises:
        InputError: If another process holds a lock on a folder.
    """
    with ExitStack() as locks:
        for folder in dict.fromkeys(os.path.realpath(one) for one in folders if one is not None):
            try:
                handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
                locks.callback(os.close, handle)
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(f"{folder}: another process is writing there") from None
            except OSError as error:  # a file system without locks, e.g. some network drives
                _log.warning("%s: not locked against a second process: %s", folder, error.strerror)
        yield


def _not_written(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: cannot be written: {_reason(error)}")


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
