"""The protocol that every planner follows, and the task that a planner is given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # `simloop list` reads the registry and must not wait for numpy
    import numpy as np

    from simloop.messages import FloatArray, Plan, WorldView


class WorldKind(StrEnum):
    """How the obstacles of a view are given."""

    DISCS = "discs"
    POLYGONS = "polygons"
    """Convex polygons, possibly with discs."""
    FIELD = "field"
    """A distance field; discs, if any, describe the same obstacles."""


def kind_of(world: WorldView) -> WorldKind:
    """Return the kind of a view, which is the richest description that it holds.

    Args:
        world: The view.

    Returns:
        ``FIELD`` if it has a distance field, else ``POLYGONS`` if it has any, else ``DISCS``.
    """
    if world.distance_m.size:
        return WorldKind.FIELD
    return WorldKind.POLYGONS if len(world.polygons_m) else WorldKind.DISCS


@dataclass(frozen=True, slots=True, eq=False)
class PlanningTask:
    """All inputs of one plan, except the planner's settings and its random generator.

    Attributes:
        world: What is known of the obstacles, in map.
        start: (3,) x, y, yaw of base_link in map, m, m, rad.
        goal: (2,) x, y in map, m.
        safe_distance_m: Distance that the path must keep from every obstacle, m.
        previous: The last plan; a planner may start from it.
        reason: Why the robot plans; the plan repeats it.
    """

    world: WorldView
    start: FloatArray
    goal: FloatArray
    safe_distance_m: float
    previous: Plan | None = None
    reason: str = "frame"


class Planner(Protocol):
    """Plans a polyline through a view of the world.

    A planner keeps no state between two calls except scratch buffers. One planner can therefore
    serve several safe distances in turn.
    """

    name: str

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """Plan a path for a task.

        Args:
            task: The obstacles, the start, the goal and the safe distance.
            rng: The only source of randomness.

        Returns:
            A plan in any case. If no safe path was found, it is the best one, with ``safe=False``.
        """
        ...
