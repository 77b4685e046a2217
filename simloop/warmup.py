"""Compile the kernels before the clock matters, and say which ones are being compiled."""

from __future__ import annotations

from dataclasses import replace

from simloop.common.compile_listener import Report, listening, silent
from simloop.scenario.build import World
from simloop.scenario.scenario import Scenario

_WARM_UP_S = 0.5


def warm_up(scenario: Scenario, world: World, report: Report = silent) -> int:
    """Run half a simulated second, thrown away, so that every stage's kernels are ready.

    report: called with a kernel's name and its number just before it is compiled; never, where
    all come from the cache. Returns how many were compiled.
    """
    from simloop.loop import Simulation

    with listening(report) as listener:
        Simulation(replace(scenario, time_limit_s=_WARM_UP_S), world=world).run()
    return listener.count
