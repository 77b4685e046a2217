"""Description of a campaign: the request, and the single runs that it contains."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.scenario.load import load
from simloop.scenario.scenario import Scenario

Cell = tuple[str, str, str]
"""Scenario, planner and sweep: the common properties of runs with different seeds."""

_MOST_RUNS = 1_000_000
_MOST_STEPS = 10_000
_STEPS = re.compile(r"(-?[\d.eE+-]+):(-?[\d.eE+-]+):([\d.eE+-]+)\Z")


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
            A line for the shell.
        """
        parts = ["simloop run", self.scenario, f"--seed {self.seed}"]
        parts += [f"--planner {self.planner}"] if self.planner else []
        return " ".join(parts + [f"--set '{text}'" for text in (*self.overrides, *self.sweep)])


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
        swept = [sweep_values(text) for text in self.sweeps]
        count = len(self.scenarios) * max(1, len(self.planners)) * (self.seeds[1] - self.seeds[0])
        count *= int(np.prod([len(values) for values in swept]))
        if count > _MOST_RUNS:
            raise InputError(f"campaign: {count:,} runs are too many; at most {_MOST_RUNS:,}")
        cells = product(self.scenarios, self.planners or (None,), product(*swept))
        return [
            RunSpec(scenario, planner, tuple(sweep), self.overrides, seed)
            for scenario, planner, sweep in cells
            for seed in range(*self.seeds)
        ]

    def check(self) -> None:
        """Load one run of each cell, so that wrong input is found before the first run.

        Raises:
            InputError: If a scenario, a planner or a key is wrong.
        """
        for spec in first_of_each_cell(self.runs()):
            spec.load()

    @property
    def condition(self) -> str:
        """Why a saved request is refused, for the error message."""
        return "only the seeds may differ"

    def extends(self, other: dict[str, Any]) -> bool:
        """Tell whether this request differs from a saved one only in its seeds.

        Args:
            other: The saved request, in the form of ``to_table``.

        Returns:
            True if everything else is the same.
        """
        mine = self.to_table()
        return {**mine, "seeds": None} == {**other, "seeds": None}

    def to_table(self) -> dict[str, Any]:
        """Convert the request for JSON.

        Returns:
            Its values by name.
        """
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }


def first_of_each_cell(specs: Sequence[RunSpec]) -> Iterator[RunSpec]:
    """Choose one run of each cell.

    Args:
        specs: Runs.

    Yields:
        The first run of each cell.
    """
    seen: set[Cell] = set()
    for spec in specs:
        if spec.cell not in seen:
            seen.add(spec.cell)
            yield spec


def parse_seeds(text: str) -> tuple[int, int]:
    """Read a range of seeds.

    Args:
        text: ``A:B``, the seeds from A to B-1, or a single number N, which means 0:N.

    Returns:
        A and B.

    Raises:
        InputError: If the text is not such a range, or the range is empty.
    """
    first, colon, last = text.partition(":")
    try:
        seeds = (int(first), int(last)) if colon else (0, int(first))
    except ValueError:
        raise InputError(
            f"--seeds {text}: not a range; write A:B for the seeds from A to B-1, e.g. 0:50"
        ) from None
    if seeds[0] < 0 or seeds[1] <= seeds[0]:
        raise InputError(f"--seeds {text}: an empty range; A:B needs 0 <= A < B")
    return seeds


def sweep_values(text: str) -> list[str]:
    """Read the values of a sweep.

    Args:
        text: ``key=v1,v2,...`` or ``key=first:last:step``.

    Returns:
        ``key=value`` for each value.

    Raises:
        InputError: If the text is not a sweep, or its range is empty or too long.
    """
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise InputError(f"--sweep {text}: not a sweep; write KEY=V1,V2,... or KEY=FIRST:LAST:STEP")
    steps = _STEPS.match(values.strip())
    parts = _stepped(text, *steps.groups()) if steps else _split(values)
    return [f"{key.strip()}={part.strip()}" for part in parts]


def _stepped(text: str, first: str, last: str, step: str) -> list[str]:
    try:
        low, high, by = float(first), float(last), float(step)
        count = int(np.floor((high - low) / by + 1e-9)) + 1
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(
            f"--sweep {text}: FIRST:LAST:STEP must be numbers, and STEP not 0"
        ) from None
    if by <= 0.0 or not 1 <= count <= _MOST_STEPS:
        raise InputError(
            f"--sweep {text}: FIRST:LAST:STEP needs FIRST <= LAST and STEP > 0, "
            f"and at most {_MOST_STEPS:,} values"
        )
    return [f"{low + by * k:.10g}" for k in range(count)]


def _split(values: str) -> list[str]:
    """Split at commas outside brackets and quotes."""
    parts, depth, quoted = [""], 0, False
    for sign in values:
        quoted ^= sign == '"'
        depth += (sign in "[{") - (sign in "]}") if not quoted else 0
        if sign == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += sign
    return parts
