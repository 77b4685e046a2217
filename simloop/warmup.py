"""Compile the kernels before the clock matters, and say which ones are being compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from numba.core import event as numba_event

from simloop.scenario import Scenario
from simloop.world import World

_WARM_UP_S = 0.5


class _CompileListener(numba_event.Listener):
    """Hears of every kernel that is compiled, not of those that come from the cache."""

    def __init__(self, report: Callable[[str, int], None]) -> None:
        self._report, self.count = report, 0

    def on_start(self, event: Any) -> None:
        self.count += 1
        self._report(event.data["dispatcher"].py_func.__name__, self.count)

    def on_end(self, event: Any) -> None:
        pass


def warm_up(
    scenario: Scenario, world: World, report: Callable[[str, int], None] = lambda name, count: None
) -> int:
    """Run half a simulated second, thrown away, so that every stage's kernels are ready.

    report: called with a kernel's name and its number just before it is compiled; never, where
    all come from the cache. Returns how many were compiled.
    """
    from simloop.loop import Simulation

    listener = _CompileListener(report)
    with numba_event.install_listener("numba:compile", listener):
        Simulation(replace(scenario, time_limit_s=_WARM_UP_S), world=world).run()
    return listener.count
