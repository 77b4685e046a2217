"""What a campaign runs: a request, and the single runs that it stands for."""

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

_MOST_RUNS = 1_000_000
_STEPS = re.compile(r"(-?[\d.eE+-]+):(-?[\d.eE+-]+):([\d.eE+-]+)\Z")


@dataclass(frozen=True, slots=True)
class RunSpec:
    """One run, wholly described. sweep: ``key=value`` of each swept key; overrides: of the others.

    planner: None for the scenario's own.
    """

    scenario: str
    planner: str | None
    sweep: tuple[str, ...]
    overrides: tuple[str, ...]
    seed: int

    @property
    def key(self) -> str:
        """What names this run among all others, in one line."""
        return json.dumps(list(asdict(self).values()))

    @property
    def cell(self) -> tuple[str, str, str]:
        """Scenario, planner and sweep: what runs of other seeds have in common."""
        return self.scenario, self.planner or "", "; ".join(self.sweep)

    def load(self) -> Scenario:
        """The scenario with all overrides. Raises InputError."""
        every = [*self.overrides, *self.sweep]
        return load(self.scenario, every, seed=self.seed, planner=self.planner)

    def command(self) -> str:
        """The line that does the same run alone."""
        parts = ["simloop run", self.scenario, f"--seed {self.seed}"]
        parts += [f"--planner {self.planner}"] if self.planner else []
        return " ".join(parts + [f"--set '{text}'" for text in (*self.overrides, *self.sweep)])


@dataclass(frozen=True, slots=True)
class Request:
    """scenarios: names or files. seeds: (first, beyond the last). sweeps: ``key=v1,v2,...``."""

    scenarios: tuple[str, ...]
    seeds: tuple[int, int]
    planners: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    sweeps: tuple[str, ...] = ()

    def runs(self) -> list[RunSpec]:
        """All the runs, in their order. Raises InputError for a sweep that cannot be read."""
        swept = [sweep_values(text) for text in self.sweeps]
        count = len(self.scenarios) * max(1, len(self.planners)) * (self.seeds[1] - self.seeds[0])
        count *= int(np.prod([len(values) for values in swept]))
        if count > _MOST_RUNS:
            raise InputError(f"{count:,} runs: no campaign has more than {_MOST_RUNS:,}")
        cells = product(self.scenarios, self.planners or (None,), product(*swept))
        return [
            RunSpec(scenario, planner, tuple(sweep), self.overrides, seed)
            for scenario, planner, sweep in cells
            for seed in range(*self.seeds)
        ]

    def check(self) -> None:
        """Load each cell's first run: what is wrong with one is said before any is begun."""
        for spec in first_of_each_cell(self.runs()):
            spec.load()

    def extends(self, other: dict[str, Any]) -> bool:
        """Whether this asks for the same as a saved request, its seeds aside."""
        mine = self.to_table()
        return {**mine, "seeds": None} == {**other, "seeds": None}

    def to_table(self) -> dict[str, Any]:
        """For JSON."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }


def first_of_each_cell(specs: Sequence[RunSpec]) -> Iterator[RunSpec]:
    """One run of each cell."""
    seen: set[tuple[str, str, str]] = set()
    for spec in specs:
        if spec.cell not in seen:
            seen.add(spec.cell)
            yield spec


def parse_seeds(text: str) -> tuple[int, int]:
    """(A, B) of ``A:B``, from A to before B; a single number N stands for 0:N."""
    first, colon, last = text.partition(":")
    try:
        seeds = (int(first), int(last)) if colon else (0, int(first))
    except ValueError:
        raise InputError(f"--seeds {text}: write A:B, from A to before B, e.g. 0:50") from None
    if seeds[0] < 0 or seeds[1] <= seeds[0]:
        raise InputError(f"--seeds {text}: from A to before B, 0 <= A < B")
    return seeds


def sweep_values(text: str) -> list[str]:
    """``key=value`` for each value of ``key=v1,v2,...`` or ``key=first:last:step``."""
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise InputError(f"--sweep {text}: write key=v1,v2,... or key=first:last:step")
    steps = _STEPS.match(values.strip())
    parts = _stepped(text, *steps.groups()) if steps else _split(values)
    return [f"{key.strip()}={part.strip()}" for part in parts]


def _stepped(text: str, first: str, last: str, step: str) -> list[str]:
    try:
        low, high, by = float(first), float(last), float(step)
        count = int(np.floor((high - low) / by + 1e-9)) + 1
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(f"--sweep {text}: first:last:step must be numbers") from None
    if by <= 0.0 or not 1 <= count <= 10_000:
        raise InputError(f"--sweep {text}: from first up to last, by a step above 0")
    return [f"{low + by * k:.10g}" for k in range(count)]


def _split(values: str) -> list[str]:
    """At commas that stand in no brackets and no quotes."""
    parts, depth, quoted = [""], 0, False
    for sign in values:
        quoted ^= sign == '"'
        depth += (sign in "[{") - (sign in "]}") if not quoted else 0
        if sign == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += sign
    return parts
