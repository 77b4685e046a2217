"""Do one run of a campaign: a pure function of the run's description, for any worker anywhere.

Each distinct world can be built beforehand, so that wrong input is found before any run.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Protocol

from simloop.campaign.spec import RunSpec
from simloop.common.errors import InputError, printable
from simloop.common.profiler import Profiler
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.planners.registry import make_planner
from simloop.scenario.build import World, build_world
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import Scenario
from simloop.truth import Published

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

_DRAWS = 3
"""Seeds that are tried for a world that is drawn from the seed. If one can be built, the scenario
is right, and a seed without a world is a row of the results."""


class Observer(Protocol):
    """Follows one run and adds columns of its own to the run's row."""

    def offer(self, message: Published) -> None:
        """Receive a message of the run.

        Args:
            message: The message; it is read-only.
        """
        ...

    def columns(self, simulation: Simulation) -> Row:
        """Make the additional columns after the run.

        Args:
            simulation: The finished run.

        Returns:
            The columns, with values that JSON can hold.
        """
        ...


def do_run(
    spec: RunSpec,
    observe: Callable[[Scenario, World], Observer] | None = None,
    profiler: Callable[[], Profiler] = Profiler,
) -> Row:
    """Simulate one run.

    Args:
        spec: The run.
        observe: Makes the observer of the run, just before the run is built. None: no observer.
        profiler: Makes the profiler of the run.

    Returns:
        The run's row: the columns of ``row_of``, every single-valued metric, and the columns of
        the observer. A run that fails with an exception gets the outcome ``error`` and the
        exception's text, so that the campaign's other runs continue.
    """
    try:
        scenario = spec.load()
        world = build_world(scenario) if scenario.drawn else _shared_world(replace(spec, seed=0))
        observer = observe(scenario, world) if observe is not None else None
        listeners = [observer.offer] if observer is not None else []
        simulation = Simulation(scenario, listeners, profiler(), world)
        metrics = simulation.run().metrics
        observed = observer.columns(simulation) if observer is not None else {}
    except InputError as error:
        return row_of(spec, ERROR, error=str(error))
    except Exception as error:
        return row_of(spec, ERROR, error=printable(f"{type(error).__name__}: {error}"))
    finally:
        gc.collect()
    row = row_of(spec, metrics["outcome"])
    for key, value in metrics.items():
        if isinstance(value, str | int | float | bool | None):
            row.setdefault(key, value)
    return row | observed


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


def check_worlds(
    cells: Iterable[RunSpec],
    seeds: tuple[int, int],
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[str, ...]:
    """Check that one run of each cell can begin.

    Args:
        cells: The first run of each cell.
        seeds: The first seed of the campaign, and the seed after the last.
        progress: Called with the number of cells that are checked.

    Returns:
        What was left out of the worlds or assumed when they were read, after the name of each
        scenario.

    Raises:
        InputError: If a world cannot be built, start or goal cannot be used, or a setting or a
            planner's library is missing.
    """
    seen: set[str] = set()
    notes: dict[str, None] = {}
    for number, spec in enumerate(cells, start=1):
        scenario = spec.load()
        world = _world_key(scenario)
        try:
            if world not in seen:
                seen.add(world)
                said = _check_one(scenario, seeds)
                notes |= dict.fromkeys(f"{spec.scenario}: {line}" for line in said)
            else:
                make_planner(scenario.config.planner, scenario.config.vehicle)
        except InputError as error:
            where = "; ".join(part for part in spec.cell[1:] if part)
            raise InputError(f"{error} ({where})" if where else str(error)) from None
        progress(number)
    return tuple(notes)


@lru_cache(maxsize=4)
def _shared_world(spec: RunSpec) -> World:
    """Build a world that is the same for all seeds only once per worker."""
    return build_world(spec.load())


def _check_one(scenario: Scenario, seeds: tuple[int, int]) -> tuple[str, ...]:
    """Build the first world that can be built, and return its notes."""
    tries = min(seeds[0] + _DRAWS, seeds[1]) if scenario.drawn else seeds[0] + 1
    for seed in range(seeds[0], tries):
        one = replace(scenario, seed=seed)
        try:
            world = build_world(one)
            Simulation(one, world=world)
            return world.notes
        except InputError:
            if seed == tries - 1:
                raise
        except Exception:  # a fault of the program, not of the input: each run reports it
            break
    return ()


def _world_key(scenario: Scenario) -> str:
    """Describe a scenario without its planner and its seed."""
    plain = type(scenario.config.planner)()
    config = replace(scenario.config, planner=plain)
    return to_toml(replace(scenario, seed=0, config=config))
