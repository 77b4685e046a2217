"""What the vehicle drives: each entry is a planner in a world, with its role there."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simloop.benchmarks.papers.papers import LEAD, PAPERS
from simloop.campaign.spec import RunSpec
from simloop.common.errors import InputError, did_you_mean
from simloop.evaluation.provenance import versions
from simloop.planners import registry
from simloop.scenario.load import load
from simloop.scenario.save import to_toml

EVERY = "planners"
"""The group in which every planner of the registry drives."""

WORLDS = ("experiment", "clutter", "trap", "moving_goal")
"""The worlds of that group."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A planner that drives in a world, once for each seed.

    Attributes:
        group: `EVERY`, or the key of a paper.
        world: Name of the scenario.
        planner: Name of the planner.
        role: ``own`` (the paper's method), ``rival``, ``lead`` (the project's planner) or ``any``.
    """

    group: str
    world: str
    planner: str
    role: str = "any"


def default_entries() -> tuple[Entry, ...]:
    """List the entries of the whole benchmark.

    Returns:
        Every planner of the registry in `WORLDS`, then each paper's methods in its worlds.
    """
    entries = [Entry(EVERY, world, name) for world in WORLDS for name in registry.available()]
    for paper in PAPERS:
        for drive in paper.drives:
            roles = {drive.own: "own"} | dict.fromkeys(drive.rivals, "rival")
            roles.setdefault(LEAD, "lead")
            entries += [Entry(paper.key, drive.world, name, role) for name, role in roles.items()]
    return tuple(entries)


@dataclass(frozen=True, slots=True)
class Drives:
    """All runs of the benchmark; the request of its journal.

    Attributes:
        entries: The whole table of entries.
        seeds: The first seed, and the seed after the last.
        only: Names of groups, worlds and planners. An entry is driven if it matches one name of
            each kind that is named. Empty: every entry.
    """

    entries: tuple[Entry, ...]
    seeds: tuple[int, int]
    only: tuple[str, ...] = ()

    def chosen(self) -> list[Entry]:
        """List the entries that are driven.

        Returns:
            Those that ``only`` matches, in the order of the table.
        """
        kinds = [
            {name for name in self.only if name in {getattr(one, kind) for one in self.entries}}
            for kind in ("group", "world", "planner")
        ]
        return [
            one
            for one in self.entries
            if all(
                not wanted or value in wanted
                for wanted, value in zip(kinds, (one.group, one.world, one.planner), strict=True)
            )
        ]

    def runs(self) -> list[RunSpec]:
        """List the runs.

        Returns:
            Entry by entry, each with its seeds.
        """
        return [spec for entry in self.chosen() for spec in self.runs_of(entry)]

    def runs_of(self, entry: Entry) -> list[RunSpec]:
        """List the runs of one entry.

        Args:
            entry: The entry.

        Returns:
            A run for each of its seeds.
        """
        seeds = range(*self.seeds)
        return [RunSpec(entry.world, entry.planner, (), (), seed) for seed in seeds]

    def check(self) -> None:
        """Check the request before anything is driven.

        Raises:
            InputError: If a name is unknown, nothing is chosen, or a scenario cannot be loaded.
        """
        names = {name for one in self.entries for name in (one.group, one.world, one.planner)}
        for name in self.only:
            if name not in names:
                raise InputError(f"--only {name}: unknown{did_you_mean(name, names)}")
        if not self.chosen():
            raise InputError(f"--only {','.join(self.only)}: no planner drives in such a world")
        for one in self.chosen():
            self.runs_of(one)[0].load()

    def cells(self) -> list[RunSpec]:
        """List the first run of each entry.

        Returns:
            The runs.
        """
        return [self.runs_of(one)[0] for one in self.chosen()]

    def to_table(self) -> dict[str, Any]:
        """Convert the request for JSON.

        Returns:
            The digest of each world's effective settings, the seeds and the packages' versions.
        """
        worlds = dict.fromkeys(one.world for one in self.entries)
        return {
            "scenarios": {world: _digest(world) for world in worlds},
            "seeds": list(self.seeds),
            "versions": versions(),
        }

    def refusal(self, mine: dict[str, Any], other: dict[str, Any]) -> str:
        """Tell why the runs of a saved request cannot be used for this one.

        Args:
            mine: This request, in the form of ``to_table``.
            other: The saved request, in the same form.

        Returns:
            The reason; empty if the versions are equal, and all scenarios that both know are.
        """
        theirs = other["scenarios"]
        if not isinstance(theirs, dict) or other.get("versions") != mine["versions"]:
            return "its packages' versions differ"
        changed = [
            world
            for world, digest in mine["scenarios"].items()
            if digest is not None and theirs.get(world) not in (None, digest)
        ]
        return f"its scenarios differ: {', '.join(changed)}" if changed else ""


def with_libraries(entries: Sequence[Entry], names: Sequence[str]) -> tuple[Entry, ...]:
    """Leave out the planners whose libraries are not installed.

    Args:
        entries: Entries.
        names: The planners whose libraries are installed.

    Returns:
        The entries of these planners.
    """
    return tuple(one for one in entries if one.planner in names)


def _digest(world: str) -> str | None:
    """Hash a scenario with all its settings; None if there is no such scenario."""
    try:
        return hashlib.sha256(to_toml(load(world)).encode()).hexdigest()[:16]
    except InputError:
        return None
