"""Why a planner cannot do a world by construction. A reason is shown only if it is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

_MINIMUM = (
    "the plain field has no way out of a local minimum: attraction and repulsion cancel, and the "
    "point mass stops"
)


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a planner fails in a world.

    Attributes:
        text: The reason.
        most: Largest share of arrivals, 0 to 1, that it explains. With more, it is not shown.
    """

    text: str
    most: float = 0.9


REASONS: Mapping[tuple[str, str], Reason] = MappingProxyType(
    {
        ("potential_field", world): Reason(_MINIMUM)
        for world in (
            *("experiment", "clutter", "trap", "moving_goal"),
            *("paper_mohamed_5", "paper_mohamed_50", "paper_mohamed_150"),
        )
    }
)
"""Planner and world -> reason."""


def reason_of(planner: str, world: str, arrivals: int, runs: int) -> str:
    """Look up why a planner fails in a world.

    Args:
        planner: Name of the planner.
        world: Name of the scenario.
        arrivals: Number of runs that arrived.
        runs: Number of runs, at least 1.

    Returns:
        The reason; empty if none is known or the measurement contradicts it.
    """
    reason = REASONS.get((planner, world))
    if reason is None or arrivals > reason.most * runs:
        return ""
    return reason.text


def contradicted(cells: Mapping[tuple[str, str], tuple[int, int]]) -> list[tuple[str, str]]:
    """List the reasons that the measurement contradicts.

    Args:
        cells: (planner, world) -> arrivals and runs.

    Returns:
        (planner, world) of each reason that is not shown although the planner drove there.
    """
    return [key for key in REASONS if key in cells and not reason_of(*key, *cells[key])]
