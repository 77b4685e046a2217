"""Description of a campaign: the request, and the single runs that it contains."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from simloop.campaign.contents import digests, scenario_digest
from simloop.campaign.sweeps import (
    check_keys,
    check_once,
    check_scenarios,
    check_text,
    sweep_values,
)
from simloop.common.errors import InputError
from simloop.evaluation.provenance import versions
from simloop.scenario.load import load
from simloop.scenario.scenario import Scenario

Cell = tuple[str, str, str]
"""Scenario, planner and sweep: the common properties of runs with different seeds."""

_MOST_RUNS = 1_000_000
_SHOWN = 3  # differing versions or files in an error message


@dataclass(frozen=True, slots=True)
class RunSpec:
    """The full description of one run.

    Attributes:
        scenario: A scenario's name or file.
        planner: A planner's name. None: the scenario's own.
        sweep: ``key=value`` for each swept key.
        overrides: ``key=value`` for each other key that is set.
        seed: The run's seed.
    """

    scenario: str
    planner: str | None
    sweep: tuple[str, ...]
    overrides: tuple[str, ...]
    seed: int

    @property
    def key(self) -> str:
        """One line of text that identifies the run."""
        return json.dumps(list(asdict(self).values()))

    @property
    def cell(self) -> Cell:
        """Scenario, planner and sweep, each as a text that may be empty."""
        return self.scenario, self.planner or "", "; ".join(self.sweep)

    def load(self) -> Scenario:
        """Load the scenario with all overrides.

        Returns:
            The scenario.

        Raises:
            InputError: If the scenario, the planner or an override is wrong.
        """
        every = [*self.overrides, *self.sweep]
        return load(self.scenario, every, seed=self.seed, planner=self.planner)

    def command(self) -> str:
        """Format the command that does this run alone.

        Returns:
            A line for the shell, quoted as it needs.
        """
        parts = ["simloop", "run", self.scenario, "--seed", str(self.seed)]
        parts += ["--planner", self.planner] if self.planner else []
        for text in (*self.overrides, *self.sweep):
            parts += ["--set", text]
        return shlex.join(parts)


@dataclass(frozen=True, slots=True)
class Request:
    """All runs of a campaign: every combination of the values named here.

    Attributes:
        scenarios: Names or files of scenarios.
        seeds: The first seed, and the seed after the last.
        planners: Planners' names. Empty: each scenario's own.
        overrides: ``key=value`` for all runs.
        sweeps: ``key=v1,v2,...`` or ``key=first:last:step``.
    """

    scenarios: tuple[str, ...]
    seeds: tuple[int, int]
    planners: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    sweeps: tuple[str, ...] = ()

    def runs(self) -> list[RunSpec]:
        """List all runs.

        Returns:
            The runs: scenario by scenario, then planners, sweep values and seeds.

        Raises:
            InputError: If a sweep cannot be read, or there are too many runs.
        """
        return [replace(one, seed=seed) for one in self.cells() for seed in range(*self.seeds)]

    def cells(self) -> list[RunSpec]:
        """List the first run of each cell.

        Returns:
            The runs with the first seed, in the order of ``runs``.

        Raises:
            InputError: If a sweep cannot be read, or there are too many runs.
        """
        swept = [sweep_values(text) for text in self.sweeps]
        count = len(self.scenarios) * max(1, len(self.planners)) * (self.seeds[1] - self.seeds[0])
        count *= math.prod(len(values) for values in swept)
        if count > _MOST_RUNS:
            raise InputError(f"campaign: {count:,} runs are too many; at most {_MOST_RUNS:,}")
        return [
            RunSpec(scenario, planner, tuple(sweep), self.overrides, self.seeds[0])
            for scenario, planner, sweep in product(
                self.scenarios, self.planners or (None,), product(*swept)
            )
        ]

    def check(self) -> None:
        """Load one run of each cell, so that wrong input is found before the first run.

        Raises:
            InputError: If a scenario, a planner or a key is wrong, given twice, or overruled by
                another option.
        """
        check_text((*self.scenarios, *self.planners, *self.overrides, *self.sweeps))
        check_scenarios(self.scenarios)
        check_once(self.planners, "--planner")
        check_keys(self.overrides, self.sweeps, self.planners)
        for spec in self.cells():
            spec.load()

    def refusal(self, mine: dict[str, Any], other: dict[str, Any]) -> str:
        """Tell why the runs of a saved request cannot be used for this one.

        Args:
            mine: This request, in the form of ``to_table``.
            other: The saved request, in the same form.

        Returns:
            The reason; empty if only the seeds differ.
        """
        if any(mine[key] != other.get(key) for key in ("scenarios", *_OPTIONS)):
            return "only the seeds may differ"
        if not isinstance(other.get("contents"), dict) or not isinstance(
            other.get("versions"), dict
        ):
            return "its files and versions were not recorded then"
        return _difference(mine["contents"], other["contents"], "changed since then") or (
            _difference(mine["versions"], other["versions"], "another version now")
        )

    def to_table(self) -> dict[str, Any]:
        """Convert the request for JSON.

        Returns:
            Its values by name, the versions of the packages, and ``contents``: a hash of each
            scenario and of each file that the scenarios are read from.
        """
        asked = {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }
        loaded = [spec.load() for spec in self.cells()]
        contents = {name: scenario_digest(name) for name in self.scenarios}
        return {**asked, "contents": contents | digests(loaded), "versions": versions()}


_OPTIONS = ("planners", "overrides", "sweeps")


def _difference(mine: dict[str, str], theirs: dict[str, str], what: str) -> str:
    """Name what differs between two tables of hashes or versions; empty if nothing does."""
    names = [name for name in {**mine, **theirs} if mine.get(name) != theirs.get(name)]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{what}: {', '.join(names[:_SHOWN])}{more}" if names else ""
