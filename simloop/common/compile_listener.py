"""Report which numba kernels are being compiled, so that the user knows why a start is slow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event as numba_event

Report = Callable[[str, int], None]
"""Function that takes a kernel's name and its number, 1 for the first kernel compiled."""


def silent(name: str, count: int) -> None:
    """Report nothing. This is the ``Report`` of callers that show no progress.

    Args:
        name: The kernel's name.
        count: The kernel's number.
    """


class CompileListener(numba_event.Listener):
    """Listener that counts and reports each compiled kernel. Kernels from the cache do not count.

    Attributes:
        count: Number of kernels compiled so far.
    """

    def __init__(self, report: Report) -> None:
        self._report, self.count = report, 0

    def on_start(self, event: Any) -> None:
        """Count and report a kernel. numba calls this when it starts to compile the kernel.

        Args:
            event: numba's event.
        """
        self.count += 1
        self._report(event.data["dispatcher"].py_func.__name__, self.count)

    def on_end(self, event: Any) -> None:
        """Do nothing. numba calls this when it has compiled a kernel.

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
