"""Stop a command at Ctrl-C or SIGTERM without an exception in the middle of anything.

Python raises KeyboardInterrupt wherever the program happens to be. Inside an import, a compiled
kernel or the start of a process it turns into other errors. So nothing here raises: a command
either ends at once, or asks a function whether it shall stop.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from multiprocessing import resource_tracker, util
from pathlib import Path
from types import FrameType
from typing import ParamSpec

from simloop.cli.common import INTERRUPTED

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SHOW_CURSOR = b"\x1b[?25h"
_Given = ParamSpec("_Given")
_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the process with exit code 130 as soon as a signal arrives, and its own children too.

    For times in which the command has nothing that must be kept or completed.

    Yields:
        None.
    """
    with _handled_by(_leave):
        yield


def leaves_at_once(command: Callable[_Given, int]) -> Callable[_Given, int]:
    """Make a command that ends at once when a signal arrives.

    Args:
        command: A command that keeps nothing before its end.

    Returns:
        The same command within `leaving_at_once`.
    """

    @wraps(command)
    def leaving(*args: _Given.args, **kwargs: _Given.kwargs) -> int:
        with leaving_at_once():
            return command(*args, **kwargs)

    return leaving


@contextmanager
def stopping(note: str) -> Iterator[Callable[[], bool]]:
    """Remember the first signal; end the process at once at the second one.

    Args:
        note: Line for the standard error stream after the first signal. Empty: none.

    Yields:
        A function that tells whether a signal has arrived.
    """
    heard: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        if heard:
            _leave(number, frame)
        heard.append(number)
        if note:
            _say(f"{note}\n".encode())

    with _handled_by(handle):
        yield lambda: bool(heard)


@contextmanager
def _handled_by(handler: _Handler) -> Iterator[None]:
    before = [signal.signal(one, handler) for one in _SIGNALS]
    try:
        yield
    finally:
        for one, old in zip(_SIGNALS, before, strict=True):
            signal.signal(one, old)


def _leave(number: int, frame: FrameType | None) -> None:
    """End this process and the children that it has started, wherever it is."""
    with suppress(Exception):
        for child in multiprocessing.active_children():
            child.kill()
    with suppress(Exception):
        # It removes the semaphores of a pool, which would otherwise be reported as lost.
        util._run_finalizers(0)  # type: ignore[attr-defined]
    with suppress(Exception):
        tracker = getattr(resource_tracker._resource_tracker, "_pid", None)  # ends by itself
        for pid in _below(os.getpid()) - {tracker}:
            with suppress(OSError):  # it has just ended
                os.kill(pid, signal.SIGKILL)
    with suppress(Exception):
        sys.stdout.flush()
    with suppress(OSError):
        cursor = _SHOW_CURSOR if os.isatty(2) else b""  # a progress bar has hidden it
        _say(cursor + b"interrupted\n")
    os._exit(INTERRUPTED)


def _below(pid: int) -> set[int]:
    """List the processes that a process has started, and those that they have started (Linux)."""
    found = set()
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, file.read_text().split()):
            found |= {child} | _below(child)
    return found


def _say(text: bytes) -> None:
    """Write to the standard error stream; in a handler, Python's own stream may be in use."""
    with suppress(OSError):
        os.write(2, text)
