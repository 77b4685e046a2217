"""Measures the wall time of each stage of the loop. No decision depends on it."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from time import perf_counter_ns
from typing import Any, Protocol, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


class StageTimer:
    """A reusable context manager that measures the duration of each of its uses.

    Attributes:
        durations_ns: The duration of every use, ns.
    """

    __slots__ = ("_began_ns", "durations_ns")

    def __init__(self) -> None:
        self.durations_ns = array("q")
        self._began_ns = 0

    def __enter__(self) -> None:
        self._began_ns = perf_counter_ns()

    def __exit__(self, *_: object) -> None:
        self.durations_ns.append(perf_counter_ns() - self._began_ns)

    @property
    def milliseconds(self) -> list[float]:
        """The duration of every use in order, ms."""
        return [duration * 1e-6 for duration in self.durations_ns]


class Stopwatch(Protocol):
    """What the loop needs of a profiler."""

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Give the context manager that measures a stage.

        Args:
            name: The stage's name.

        Returns:
            The context manager, the same one for the same name.
        """
        ...

    def wrap(self, name: str, function: Function) -> Function:
        """Make a function that is measured as a stage at each call.

        Args:
            name: The stage's name.
            function: The function.

        Returns:
            A function that does the same.
        """
        ...


class Profiler:
    """Measures named stages. Get a stage once and keep it; then each use costs about 0.2 us."""

    def __init__(self) -> None:
        self._stages: dict[str, StageTimer] = {}

    def stage(self, name: str) -> StageTimer:
        """Give the timer of a stage.

        Args:
            name: The stage's name.

        Returns:
            The timer, the same one for the same name.
        """
        return self._stages.setdefault(name, StageTimer())

    def wrap(self, name: str, function: Function) -> Function:
        """Make a function that is measured as a stage at each call.

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
        """Sum up the stages.

        Args:
            wall_time_s: The wall time of everything together, s.

        Returns:
            For each stage that was used: its mean and greatest duration ``mean_ms`` and
            ``worst_ms``, its ``share`` of the wall time (0 to 1), and how many ``calls`` it had.
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
    """Measures nothing and costs nothing."""

    _nothing: AbstractContextManager[None] = nullcontext()

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Give a context manager that does nothing.

        Args:
            name: The stage's name.

        Returns:
            The context manager.
        """
        return self._nothing

    def wrap(self, name: str, function: Function) -> Function:
        """Leave a function as it is.

        Args:
            name: The stage's name.
            function: The function.

        Returns:
            The same function.
        """
        return function
