"""Where the wall time goes, stage by stage. Only ever reported, never decided upon."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from time import perf_counter_ns
from typing import Any, Protocol, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


class StageTimer:
    """A reusable context manager that keeps the duration of each of its uses, ns."""

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
        """The duration of every use, in order."""
        return [duration * 1e-6 for duration in self.durations_ns]


class Stopwatch(Protocol):
    """What the loop asks of a profiler."""

    def stage(self, name: str) -> AbstractContextManager[None]:
        """The context manager that times this stage; the same one for the same name."""
        ...

    def wrap(self, name: str, function: Function) -> Function:
        """The function, timed as this stage at each call."""
        ...


class Profiler:
    """Times named stages. Ask for a stage once and keep it; entering it costs about 0.2 us."""

    def __init__(self) -> None:
        self._stages: dict[str, StageTimer] = {}

    def __iter__(self) -> Iterator[tuple[str, StageTimer]]:
        return iter(self._stages.items())

    def stage(self, name: str) -> StageTimer:
        return self._stages.setdefault(name, StageTimer())

    def wrap(self, name: str, function: Function) -> Function:
        timer = self.stage(name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            with timer:
                return function(*args, **kwargs)

        return timed  # type: ignore[return-value]

    def summary(self, wall_time_s: float) -> dict[str, dict[str, float]]:
        """stage -> mean_ms, worst_ms, calls, and share of ``wall_time_s`` (0 to 1)."""
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
    """Times nothing: ``wrap`` gives back the very function, ``stage`` does nothing."""

    _nothing: AbstractContextManager[None] = nullcontext()

    def stage(self, name: str) -> AbstractContextManager[None]:
        return self._nothing

    def wrap(self, name: str, function: Function) -> Function:
        return function
