"""Let the LiDAR's beams pass through panes of glass and measure what is behind them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from simloop.messages import FloatArray
from simloop.truth import RayCaster

_THROUGH_M = 1e-3  # a beam starts again this far behind the surface of a pane
_PANES = 4  # a beam that meets more glass surfaces than this is too weak to come back


class Pane(Protocol):
    """A box of glass that may be there for a while."""

    @property
    def min_m(self) -> tuple[float, float] | None:
        """(2,) lower corner in map, m."""
        ...

    @property
    def max_m(self) -> tuple[float, float] | None:
        """(2,) upper corner in map, m."""
        ...

    def on(self, t_ns: int) -> bool:
        """Tell whether it is there.

        Args:
            t_ns: the instant, ns.

        Returns:
            Whether it is.
        """
        ...


class Glass:
    """A world in which beams pass through panes and measure what is behind them."""

    def __init__(self, world: RayCaster, panes: Sequence[Pane]) -> None:
        """Put panes into a world.

        Args:
            world: the true world.
            panes: faults of the kind 'glass'.
        """
        self._world, self._panes, self.t_ns = world, panes, 0

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Measure ranges as `RayCaster.cast` does. After four surfaces nothing comes back.

        Args:
            origins_m: (n, 3) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a beam hits nothing within the cutoff.
        """
        ranges = self._world.cast(origins_m, directions, cutoff_m)
        panes = [p for p in self._panes if p.on(self.t_ns)]
        boxes = [np.array((p.min_m, p.max_m), np.float64) for p in panes]
        for passed in range(_PANES + 1):
            ends = origins_m + ranges[:, None] * directions
            inside = np.zeros(len(ranges), bool)
            for low, high in boxes:
                inside |= np.all((ends[:, :2] >= low) & (ends[:, :2] <= high), axis=1)
            inside &= ranges >= 0.0
            if passed == _PANES:
                ranges[inside] = -1.0
            elif not inside.any():
                break
            for i in np.nonzero(inside & (ranges >= 0.0))[0]:
                ranges[i] = self._beyond(ends[i], directions[i], ranges[i], cutoff_m)
        return ranges

    def _beyond(
        self, end: FloatArray, direction: FloatArray, range_m: float, cutoff_m: float
    ) -> float:
        """Continue a beam behind the glass: its whole range, m, or -1 where it hits nothing."""
        start = (end + _THROUGH_M * direction)[None]
        more = float(self._world.cast(start, direction[None].copy(), cutoff_m)[0])
        total = range_m + _THROUGH_M + more
        return total if more >= 0.0 and total <= cutoff_m else -1.0
