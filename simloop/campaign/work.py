"""Do one run of a campaign: a pure function of the run's description, for any worker anywhere."""

from __future__ import annotations

import gc
from dataclasses import replace
from functools import lru_cache
from typing import Any

from simloop.campaign.spec import RunSpec
from simloop.common.errors import InputError
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.scenario.build import World, build_world

Row = dict[str, Any]
"""The figures of one run, by column name."""

REACHED = Outcome.REACHED
"""The outcome of a successful run, by the name that the simulation uses."""

ERROR = "error"
"""The campaign's own outcome: the run could not be simulated to its end."""

OUTCOMES = (*Outcome, ERROR)
"""All outcomes that a row can have."""

TIMING = ("wall_time_s", "real_time_factor", "plan_ms_p50", "plan_ms_p99")
"""The columns that depend on the machine's speed. All others are the same on every machine."""


def do_run(spec: RunSpec) -> Row:
    """Simulate one run.

    Args:
        spec: The run.

    Returns:
        The run's row: the columns of ``row_of`` and every single-valued metric. A run that fails
        with an exception gets the outcome ``error`` and the exception's text, so that the
        campaign's other runs continue.
    """
    try:
        scenario = spec.load()
        world = _shared_world(replace(spec, seed=0)) if not scenario.drawn else None
        metrics = Simulation(scenario, world=world).run().metrics
    except InputError as error:
        return row_of(spec, ERROR, error=str(error))
    except Exception as error:
        return row_of(spec, ERROR, error=f"{type(error).__name__}: {error}")
    finally:
        gc.collect()
    row = row_of(spec, metrics["outcome"])
    for key, value in metrics.items():
        if isinstance(value, str | int | float | bool | None):
            row.setdefault(key, value)
    return row


def row_of(spec: RunSpec, outcome: str, error: str = "") -> Row:
    """Make the first columns of every row.

    Args:
        spec: The run.
        outcome: How the run ended.
        error: The error text, for a run with the outcome ``error``.

    Returns:
        A row with scenario, planner, sweep, seed, outcome, success and error.
    """
    scenario, planner, sweep = spec.cell
    return {
        "scenario": scenario,
        "planner": planner,
        "sweep": sweep,
        "seed": spec.seed,
        "outcome": outcome,
        "success": outcome == REACHED,
        "error": error,
    }


@lru_cache(maxsize=4)
def _shared_world(spec: RunSpec) -> World:
    """Build a world that is the same for all seeds only once per worker."""
    return build_world(spec.load())
