"""What the filter believed at each of the last periods, and what it was told in each of them.

A LiDAR pose comes late: the turn must be full, the match takes its time, and a network may add to
it. It belongs to its own instant. So the belief of that instant is corrected, and all that has
come since is told to it again, in one compiled call.
"""

from __future__ import annotations

import numpy as np

from simloop.estimation.ekf_model import INPUTS, STATES, replay
from simloop.messages import FloatArray


class History:
    """A ring of the last ``periods`` beliefs, each with the inputs that led to it."""

    def __init__(self, periods: int) -> None:
        self._t_ns = np.full(periods, np.iinfo(np.int64).min)
        self._states = np.zeros((periods, STATES))
        self._covariances = np.zeros((periods, STATES, STATES))
        self._inputs = np.zeros((periods, INPUTS))
        self._last, self._count = 0, 0

    def start(self, t_ns: int, x: FloatArray, p: FloatArray) -> None:
        """Forget all; the belief at ``t_ns``, from which any replay begins."""
        self._t_ns[:] = np.iinfo(np.int64).min
        self._last, self._count = 0, 1
        self._t_ns[0], self._states[0], self._covariances[0] = t_ns, x, p

    def push(self, t_ns: int, inputs: tuple[float, ...]) -> FloatArray:
        """Add a period; its row (11,) in the ring, of which ``inputs`` fill what comes first.

        The belief that it led to is ``keep``'s to add.
        """
        self._last = (self._last + 1) % len(self._t_ns)
        self._count = min(self._count + 1, len(self._t_ns))
        self._t_ns[self._last] = t_ns
        row = self._inputs[self._last]
        row[: len(inputs)] = inputs
        return row

    def keep(self, x: FloatArray, p: FloatArray) -> None:
        """The belief after the period that was pushed last."""
        self._states[self._last], self._covariances[self._last] = x, p

    def find(self, t_ns: int) -> int | None:
        """The row of the last period at or before an instant; None where that is forgotten."""
        for back in range(self._count):
            row = (self._last - back) % len(self._t_ns)
            if self._t_ns[row] <= t_ns:
                return row
        return None

    def belief(self, row: int) -> tuple[FloatArray, FloatArray]:
        """State (9,) and covariance (9, 9) of a row, as copies."""
        return self._states[row].copy(), self._covariances[row].copy()

    def rewrite(
        self,
        row: int,
        x: FloatArray,
        p: FloatArray,
        walk: FloatArray,
        gauge_m: float,
        gates: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Put another belief into a row; the one of now that follows from all inputs since."""
        self._states[row], self._covariances[row] = x, p
        count = (self._last - row) % len(self._t_ns)
        if count == 0:
            return x, p
        return replay(
            self._states, self._covariances, self._inputs, row, count, walk, gauge_m, gates
        )
