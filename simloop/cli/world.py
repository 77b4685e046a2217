"""Build a scenario's world, and tell what was left out or assumed when it was read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.console import Console

from simloop.common.terminal import print_lines

if TYPE_CHECKING:
    from simloop.scenario.build import World
    from simloop.scenario.scenario import Scenario


def build_shown(scenario: Scenario, notes: Console) -> World:
    """Build a scenario's world, and print what was left out or assumed when it was read.

    Args:
        scenario: The scenario.
        notes: The console to print to.

    Returns:
        The world.

    Raises:
        InputError: If it cannot be built.
    """
    from simloop.common.waiting import said_if_slow
    from simloop.scenario.build import build_world

    with said_if_slow(notes, "building the world"):
        world = build_world(scenario)
    print_notes(notes, world.notes)
    return world


def print_notes(notes: Console, lines: Iterable[str]) -> None:
    """Print what was left out of worlds or assumed.

    Args:
        notes: The console to print to.
        lines: The sentences. They may quote a world's file.
    """
    print_lines(notes, lines, "note: ")
