"""The one protocol that every planner keeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # `simloop list` reads the registry and shall not wait for numpy
    import numpy as np

    from simloop.messages import FloatArray, Plan, WorldView


class Planner(Protocol):
    """Plans a polyline through a world view; keeps no state between calls but its buffers."""

    name: str

    def plan(
        self,
        world: WorldView,
        start: FloatArray,
        goal: FloatArray,
        rng: np.random.Generator,
        *,
        previous: Plan | None = None,
        reason: str = "frame",
    ) -> Plan:
        """Plan from ``start`` (3,) x, y, yaw to ``goal`` (2,), both in map.

        previous: the last plan, for a warm start. All randomness comes from ``rng``. Always
        returns a plan; one that could not be made safe says ``safe=False``.
        """
        ...
