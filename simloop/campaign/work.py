"""One run of a campaign, as a pure function of its spec: what any worker does anywhere."""

from __future__ import annotations

import gc
import signal
from dataclasses import replace
from functools import lru_cache
from typing import Any

from simloop.campaign.spec import RunSpec
from simloop.common.errors import InputError
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.scenario.build import World, build_world

Row = dict[str, Any]
TIMING = ("wall_time_s", "real_time_factor", "plan_ms_p50", "plan_ms_p99")
"""What differs from one machine, or one day, to another; all else in a row does not."""


def do_run(spec: RunSpec) -> Row:
    """The figures of one run as a flat row; what went wrong with it, as outcome ``error``."""
    try:
        scenario = spec.load()
        world = _shared_world(replace(spec, seed=0)) if not scenario.drawn else None
        metrics = Simulation(scenario, world=world).run().metrics
    except InputError as error:
        return row_of(spec, "error", error=str(error))
    except Exception as error:  # of one run among thousands: it is told, and the others go on
        return row_of(spec, "error", error=f"{type(error).__name__}: {error}")
    finally:
        gc.collect()
    row = row_of(spec, metrics["outcome"])
    for key, value in metrics.items():
        if isinstance(value, str | int | float | bool | None):
            row.setdefault(key, value)
    return row


def row_of(spec: RunSpec, outcome: str, error: str = "") -> Row:
    """What each row begins with."""
    scenario, planner, sweep = spec.cell
    return {
        "scenario": scenario,
        "planner": planner,
        "sweep": sweep,
        "seed": spec.seed,
        "outcome": outcome,
        "success": outcome == Outcome.REACHED,
        "error": error,
    }


@lru_cache(maxsize=4)
def _shared_world(spec: RunSpec) -> World:
    """A world that is the same for all seeds is built once a worker."""
    return build_world(spec.load())


def leave_interrupts_to_the_parent() -> None:
    """For a worker process: Ctrl-C reaches it too, but who ends it is the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
