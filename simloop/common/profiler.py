"""Measure the time of each stage of the loop. No decision depends on it."""

from __future__ import annotations

import ctypes
import gc
import resource
import sys
from array import array
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from time import perf_counter_ns
from typing import Any, Protocol, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

Clock = Callable[[], int]
"""Returns a time, ns, such as ``time.perf_counter_ns`` or ``time.thread_time_ns``."""


class StageTimer:
    """Reusable context manager that measures the duration of each of its uses.

    Attributes:
        durations_ns: The duration of every use, ns.
    """

    __slots__ = ("_began_ns", "_clock", "durations_ns")

    def __init__(self, clock: Clock = perf_counter_ns) -> None:
        """clock: returns a time, ns."""
        self.durations_ns = array("q")
        self._began_ns = 0
        self._clock = clock

    def __enter__(self) -> None:
        self._began_ns = self._clock()

    def __exit__(self, *_: object) -> None:
        self.durations_ns.append(self._clock() - self._began_ns)

    @property
    def milliseconds(self) -> list[float]:
        """Duration of every use, in order, ms."""
        return [duration * 1e-6 for duration in self.durations_ns]


class Stopwatch(Protocol):
    """Interface of a profiler for the loop."""

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Return the context manager that measures a stage.

        Args:
            name: The stage's name.

        Returns:
            The context manager, the same one for the same name.
        """
        ...

    def wrap(self, name: str, function: Function) -> Function:
        """Wrap a function, so that each call is measured as a stage.

        Args:
            name: The stage's name.
            function: The function.

        Returns:
            A function that does the same.
        """
        ...


class Profiler:
    """Profiler of named stages. Get a stage once and keep it: each use then costs about 0.2 us."""

    def __init__(self, clock: Clock = perf_counter_ns) -> None:
        """Make a profiler without stages.

        Args:
            clock: The clock of all stages.
        """
        self._stages: dict[str, StageTimer] = {}
        self._clock = clock

    def stage(self, name: str) -> StageTimer:
        """Return the timer of a stage.

        Args:
            name: The stage's name.

        Returns:
            The timer, the same one for the same name.
        """
        return self._stages.setdefault(name, StageTimer(self._clock))

    def wrap(self, name: str, function: Function) -> Function:
        """Wrap a function, so that each call is measured as a stage.

        Args:
            name: The stage's name.
            function: The function.

        Returns:
            A function that does the same.
        """
        timer = self.stage(name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            with timer:
                return function(*args, **kwargs)

        return timed  # type: ignore[return-value]

    def summary(self, wall_time_s: float) -> dict[str, dict[str, float]]:
        """Summarise the stages.

        Args:
            wall_time_s: Total wall time, s.

        Returns:
            For each used stage: its mean and longest duration ``mean_ms`` and ``worst_ms``, its
            ``share`` of the wall time (0 to 1), and its number of ``calls``.
        """
        table = {}
        for name, timer in self._stages.items():
            durations = timer.durations_ns
            if durations:
                table[name] = {
                    "mean_ms": sum(durations) / len(durations) * 1e-6,
                    "worst_ms": max(durations) * 1e-6,
                    "share": sum(durations) * 1e-9 / wall_time_s,
                    "calls": len(durations),
                }
        return table


class NullProfiler:
    """Profiler that measures nothing and takes no time."""

    _nothing: AbstractContextManager[None] = nullcontext()

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Return a context manager that does nothing.

        Args:
            name: The stage's name.

        Returns:
            The context manager.
        """
        return self._nothing

    def wrap(self, name: str, function: Function) -> Function:
        """Return a function unchanged.

        Args:
            name: The stage's name.
            function: The function.

        Returns:
            The same function.
        """
        return function


def reset_peak_memory() -> None:
    """Begin to measure this process's peak memory anew. This works on Linux only.

    What earlier work has freed is given back to the system first, so that it does not count.
    """
    gc.collect()
    with suppress(OSError, AttributeError):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def peak_memory_mb() -> float:
    """Read this process's peak memory since its start, or since `reset_peak_memory`.

    Returns:
        The largest resident size, MB (10^6 bytes).
    """
    with suppress(OSError, ValueError), open("/proc/self/status") as file:
        for line in file:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024e-6
    scale = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale * 1e-6
