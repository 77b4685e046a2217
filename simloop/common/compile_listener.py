"""Who wants to know which kernels are being compiled hears of them here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event as numba_event

Report = Callable[[str, int], None]


def silent(name: str, count: int) -> None:
    """A report that says nothing."""


class CompileListener(numba_event.Listener):
    """Hears of every kernel that is compiled, not of those that come from the cache."""

    def __init__(self, report: Report) -> None:
        self._report, self.count = report, 0

    def on_start(self, event: Any) -> None:
        self.count += 1
        self._report(event.data["dispatcher"].py_func.__name__, self.count)

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def listening(report: Report) -> Iterator[CompileListener]:
    """report: called with a kernel's name and its number just before it is compiled."""
    listener = CompileListener(report)
    with numba_event.install_listener("numba:compile", listener):
        yield listener
