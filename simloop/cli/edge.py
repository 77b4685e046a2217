"""The edge of the program: what surrounds it, and how whatever goes wrong is told.

Every command and every script that runs simloop is inside ``run_at_edge``. It makes the standard
streams safe to write to, and turns every error into one line and an exit code.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import platform
import shlex
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TextIO

from simloop import __version__
from simloop.cli.kernel_cache import in_kernel_cache, prepare_kernel_cache
from simloop.common.errors import InputError, printable

INPUT_WRONG = 2
"""The exit code for wrong input."""

BROKEN = 70
"""The exit code for a fault of the program itself (EX_SOFTWARE of sysexits.h)."""

INTERRUPTED = 130
"""The exit code of a command that was stopped by Ctrl-C or SIGTERM."""

_DEBUG = "SIMLOOP_DEBUG"
_ERRORS = "standard error"
_REPORT_TO = "the issues of the project"


def run_at_edge(commands: Callable[..., Any]) -> None:
    """Run commands of typer with the arguments of this process, and exit.

    Args:
        commands: The commands; called with ``standalone_mode=False``, they return an exit code.

    Raises:
        SystemExit: Always, with the exit code.
        Exception: A fault of the program itself, if the user asked for its traceback (``--debug``
            or SIMLOOP_DEBUG=1), or in a test.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    debug = _take_debug()
    with _safe_streams():
        code = BROKEN
        try:
            code = _run(commands)
        except KeyboardInterrupt as error:
            code = _say(f"interrupted{_notes(error)}", INTERRUPTED)
        except Exception as raised:
            told = _plain(raised)
            if debug and not _is_told(told):
                if told is raised:
                    raise
                raise told from raised
            code = _tell(told)
        finally:
            with contextlib.suppress(InputError, OSError):
                sys.stdout.flush()
        sys.exit(code)


def run_script(script: Callable[[], int | None]) -> None:
    """Run a script that reads its arguments itself, as `run_at_edge` runs commands, and exit.

    Args:
        script: Its main function, which returns an exit code; None counts as 0.

    Raises:
        SystemExit: Always, with the exit code.
    """
    run_at_edge(lambda standalone_mode: script())


def _run(commands: Callable[..., Any]) -> int:
    try:
        note = prepare_kernel_cache()
        if note:
            print(f"note: {note}", file=sys.stderr)
        _refuse_empty(sys.argv[1:])
        code = commands(standalone_mode=False) or 0
        sys.stdout.flush()
    except SystemExit as done:
        code = done.code if isinstance(done.code, int) else 0 if done.code is None else 1
        sys.stdout.flush()
        return code
    if code == INTERRUPTED:  # typer caught Ctrl-C, or a command reports that it was stopped
        raise KeyboardInterrupt
    return int(code)


def _refuse_empty(arguments: Sequence[str]) -> None:
    """Raise InputError for an empty value: as a path, it would be the current folder.

    It mostly comes from a variable of the shell that is not set. No option takes an empty value.
    """
    option = ""
    for text in arguments:
        name, equals, value = text.partition("=")
        if text.startswith("-") and text.strip("-"):
            option = name
        if not text or (equals and not value and name.startswith("-")):
            raise InputError(f"{option or 'command line'}: an empty value; give a name or a path")


def _plain(error: Exception) -> Exception:
    """Replace an error by what it stands for, if that is known."""
    # A prompt turns the end of its input into an Abort of its own. typer does so with any other
    # EOFError that a command lets through, e.g. that of a file which ends too soon.
    if _aborts(error) and isinstance(error.__cause__, EOFError):
        error = error.__cause__
    folder = in_kernel_cache(error)
    if folder is not None and not isinstance(error, OSError):
        told: Exception = DamagedCacheError(
            f"compiled kernels in {folder} cannot be read ({type(error).__name__}: {error}): "
            "delete its files *.nbi and *.nbc"
        )
        told.__cause__ = error  # with its notes
        return told
    name = os.environ.get("MUJOCO_GL")
    if name and _loads_mujoco(error):
        told = InputError(
            f"MUJOCO_GL={name}: cannot be loaded ({error}); choices: egl, osmesa, disable"
        )
        told.__cause__ = error
        return told
    return error


class DamagedCacheError(Exception):
    """Compiled kernels that numba cannot read; the message says where they are."""


def _loads_mujoco(error: BaseException) -> bool:
    """Return whether an error arose while MuJoCo was imported, which loads MUJOCO_GL's back end."""
    trace = error.__traceback__
    while trace is not None:
        frame = trace.tb_frame
        if frame.f_globals.get("__name__") == "mujoco" and frame.f_code.co_name == "<module>":
            return True
        trace = trace.tb_next
    return False


def _is_told(error: Exception) -> bool:
    """Return whether an error is no fault of the program: wrong input, a full disk, Ctrl-C."""
    plain = InputError | OSError | DamagedCacheError
    return isinstance(error, plain) or _usage(error) is not None or _aborts(error)


def _aborts(error: Exception) -> bool:
    return type(error).__name__ == "Abort"


def _usage(error: Exception) -> str | None:
    """Return the text of an error of the option parser, or None for any other error."""
    # In some versions of typer, these errors have no public base class.
    describe = getattr(error, "format_message", None)
    return None if describe is None else str(describe())


def _tell(error: Exception) -> int:
    """Print one line about an error, and return the exit code."""
    if _aborts(error):
        return _say(f"interrupted{_notes(error)}", INTERRUPTED)
    if isinstance(error, InputError):
        return _say(f"error: {error}{_notes(error)}", INPUT_WRONG)
    if isinstance(error, DamagedCacheError):
        return _say(f"error: {error}{_notes(error)}", BROKEN)
    if isinstance(error, BrokenPipeError):
        return _say(f"error: the reader of an output is gone{_notes(error)}", INPUT_WRONG)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return _say(f"error: {where}{error.strerror or error}{_notes(error)}", INPUT_WRONG)
    usage = _usage(error)
    if usage is None:
        return _say(_report(error), BROKEN)
    if usage.startswith("Usage:"):  # the whole help text, for a command without arguments
        print(usage, file=sys.stderr)
        return INPUT_WRONG
    return _say(f"error: {usage}", INPUT_WRONG)


def _say(line: str, code: int) -> int:
    print(printable(line), file=sys.stderr)
    return code


def _notes(error: BaseException) -> str:
    """Format what was added to an error on its way, e.g. which file was kept.

    The notes of the errors that led to it count, too.
    """
    notes: list[str] = []
    chain: BaseException | None = error
    while chain is not None and len(notes) < 10:
        notes += (f"; {note}" for note in getattr(chain, "__notes__", ()))
        chain = chain.__cause__ or chain.__context__
    return "".join(dict.fromkeys(notes))


def _report(error: Exception) -> str:
    """Write the traceback into a file, and make the line that says how to report it."""
    what = printable(f"{type(error).__name__}: {error}", 300)
    asked = f"{os.path.basename(sys.argv[0])} {shlex.join(sys.argv[1:])}"
    about = f"simloop {__version__}, Python {platform.python_version()}, {platform.platform()}"
    try:
        handle, path = tempfile.mkstemp(prefix="simloop-fault-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"{about}\nasked: {asked}\n\n")
            traceback.print_exception(error, file=file)
        how = f"report it with the file {path} to {_REPORT_TO}"
    except (OSError, MemoryError, RecursionError):
        how = f"run it again with --debug and report the traceback to {_REPORT_TO}"
    return (
        f"fault: {what}: this is a fault of simloop {__version__}, not of your input: "
        f"{how}; asked was: {printable(asked, 300)}{_notes(error)}"
    )


def _take_debug() -> bool:
    """Remove ``--debug`` from the arguments; return whether faults show their traceback."""
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    asked = "--debug" in sys.argv[1:end]
    if asked:
        sys.argv[1:end] = [one for one in sys.argv[1:end] if one != "--debug"]
    in_test = "pytest" in sys.modules and "PYTEST_CURRENT_TEST" in os.environ
    return asked or in_test or os.environ.get(_DEBUG, "0") not in ("", "0")


@contextmanager
def _safe_streams() -> Iterator[None]:
    """Let the standard streams bear closed descriptors, readers that are gone, and any text."""
    _fill_descriptors()
    before = sys.stdout, sys.stderr
    ours = logging.getLogger("simloop")
    sys.stdout = _Patient(before[0], "standard output")
    sys.stderr = errors = _Patient(before[1], _ERRORS)
    log = logging.StreamHandler(errors)
    log.setFormatter(_OneLine())
    ours.addHandler(log)
    try:
        yield
    finally:
        ours.removeHandler(log)
        sys.stdout, sys.stderr = before


def _fill_descriptors() -> None:
    """Open the null device for each standard stream that is closed, as with ``>&-``.

    Otherwise the next file that is opened gets its number, and prints of libraries go into it.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one


class _OneLine(logging.Formatter):
    """Format a log message as one line without control characters."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(record.getMessage())


class _Patient(io.TextIOBase):
    """A text stream that goes on when its reader is gone, and can write any character.

    The exit code of a command is that of its work: ``simloop run trap | head -1`` runs to its end.
    """

    def __init__(self, inner: TextIO | None, name: str) -> None:
        self._gone = inner is None
        self._inner = inner if inner is not None else io.StringIO()
        self._name = name
        if isinstance(self._inner, io.TextIOWrapper):
            # What a terminal's character set lacks is written as an escape.
            self._inner.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        self._do(lambda: self._inner.write(text))
        return len(text)

    def flush(self) -> None:
        self._do(self._inner.flush)

    def _do(self, act: Callable[[], Any]) -> None:
        if self._gone:
            return
        try:
            act()
        except BrokenPipeError:
            self._let_go()
        except OSError as error:  # e.g. a full disk
            self._let_go()
            if self._name == _ERRORS:  # there is no place left to tell it
                return
            raise InputError(f"{self._name}: cannot be written: {error.strerror}") from None

    def _let_go(self) -> None:
        """Send the rest to the null device, also what Python flushes when it exits."""
        self._gone = True
        with contextlib.suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._inner.fileno())
            os.close(null)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def isatty(self) -> bool:
        return self._inner.isatty()

    def fileno(self) -> int:
        return self._inner.fileno()

    def writable(self) -> bool:
        return True

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._inner.encoding or "utf-8"

    @property
    def errors(self) -> str | None:  # type: ignore[override]
        return self._inner.errors
