"""The protocol that every planner follows, and the task that a planner is given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # `simloop list` reads the registry and shall not wait for numpy
    import numpy as np

    from simloop.messages import FloatArray, Plan, WorldView


class WorldKind(StrEnum):
    """How the obstacles of a view are given."""

    DISCS = "discs"
    POLYGONS = "polygons"
    """Convex polygons, and discs beside them."""
    FIELD = "field"
    """A distance field; its discs, if any, describe the same obstacles."""


def kind_of(world: WorldView) -> WorldKind:
    """Return the kind of a view: the richest description that it holds.

    Args:
        world: The view to look at.

    Returns:
        ``FIELD`` if it has a distance field, else ``POLYGONS`` if it has any, else ``DISCS``.
    """
    if world.distance_m.size:
        return WorldKind.FIELD
    return WorldKind.POLYGONS if len(world.polygons_m) else WorldKind.DISCS


@dataclass(frozen=True, slots=True, eq=False)
class PlanningTask:
    """Everything that one plan depends on, apart from the planner's settings and its generator.

    Attributes:
        world: What is known of the obstacles, in map.
        start: (3,) x, y, yaw of base_link in map, m, m, rad.
        goal: (2,) x, y in map, m.
        safe_distance_m: Distance that the path has to keep from every obstacle, m.
        previous: The last plan, from which a planner may start warm.
        reason: Why a plan is asked for; the plan repeats it.
    """

    world: WorldView
    start: FloatArray
    goal: FloatArray
    safe_distance_m: float
    previous: Plan | None = None
    reason: str = "frame"


class Planner(Protocol):
    """Plans a polyline through a view of the world.

    A planner keeps no state between two calls except scratch buffers, so that one planner may
    serve several safe distances in turn.
    """

    name: str

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """Plan a path for a task.

        Args:
            task: Where to plan, from where to where, and how far from the obstacles.
            rng: The only source of randomness.

        Returns:
            A plan, always. If no safe path was found it is the best one, with ``safe=False``.
        """
        ...
