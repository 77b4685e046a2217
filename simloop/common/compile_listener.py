"""Reports which numba kernels are being compiled, so that a user knows why a start takes long."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event as numba_event

Report = Callable[[str, int], None]
"""Called with a kernel's name and its number, 1 for the first kernel that is compiled."""


def silent(name: str, count: int) -> None:
    """Report nothing: a ``Report`` for callers who show no progress.

    Args:
        name: The kernel's name.
        count: The kernel's number.
    """


class CompileListener(numba_event.Listener):
    """Counts and reports each kernel that is compiled. Kernels from the cache do not count.

    Attributes:
        count: How many kernels have been compiled so far.
    """

    def __init__(self, report: Report) -> None:
        self._report, self.count = report, 0

    def on_start(self, event: Any) -> None:
        """Report a kernel. numba calls this when it begins to compile the kernel.

        Args:
            event: numba's event.
        """
        self.count += 1
        self._report(event.data["dispatcher"].py_func.__name__, self.count)

    def on_end(self, event: Any) -> None:
        """Do nothing. numba calls this when a kernel is compiled.

        Args:
            event: numba's event.
        """


@contextmanager
def listening(report: Report) -> Iterator[CompileListener]:
    """Report every kernel that is compiled during the context.

    Args:
        report: Called just before each kernel is compiled.

    Yields:
        The listener, which counts the kernels.
    """
    listener = CompileListener(report)
    with numba_event.install_listener("numba:compile", listener):
        yield listener
