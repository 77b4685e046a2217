"""Keep the filter's beliefs and inputs of the last control periods, for late corrections.

A LiDAR pose comes late: the laser's turn must be complete, the match takes time, and a network may
add to the delay. So the belief at the time of the scan is corrected, and all inputs since then are
filtered again in one compiled call.
"""

from __future__ import annotations

import numpy as np

from simloop.estimation.ekf_model import INPUTS, STATES, replay
from simloop.messages import FloatArray


class History:
    """Ring buffer of beliefs, each with the inputs that led to it."""

    def __init__(self, periods: int) -> None:
        """Allocate the buffer.

        Args:
            periods: Number of beliefs to keep.
        """
        self._t_ns = np.full(periods, np.iinfo(np.int64).min)
        self._states = np.zeros((periods, STATES))
        self._covariances = np.zeros((periods, STATES, STATES))
        self._inputs = np.zeros((periods, INPUTS))
        self._last, self._count = 0, 0

    def start(self, t_ns: int, x: FloatArray, p: FloatArray) -> None:
        """Clear the buffer and store a first belief.

        Args:
            t_ns: Time of the belief, ns.
            x: (9,) state.
            p: (9, 9) covariance.
        """
        self._t_ns[:] = np.iinfo(np.int64).min
        self._last, self._count = 0, 1
        self._t_ns[0], self._states[0], self._covariances[0] = t_ns, x, p

    def push(self, t_ns: int, inputs: tuple[float, ...]) -> FloatArray:
        """Add a period's inputs; ``keep`` then stores the belief after it.

        Args:
            t_ns: Time of the period, ns, later than the last one.
            inputs: The first values of the period's ``INPUTS``; see ``ekf_model``.

        Returns:
            (11,) the period's row in the buffer, a view. The filter marks in it which belts it
            refused.
        """
        self._last = (self._last + 1) % len(self._t_ns)
        self._count = min(self._count + 1, len(self._t_ns))
        self._t_ns[self._last] = t_ns
        row = self._inputs[self._last]
        row[: len(inputs)] = inputs
        return row

    def keep(self, x: FloatArray, p: FloatArray) -> None:
        """Store the belief after the last pushed period.

        Args:
            x: (9,) state.
            p: (9, 9) covariance.
        """
        self._states[self._last], self._covariances[self._last] = x, p

    def find(self, t_ns: int) -> int | None:
        """Find the row of the last period at or before a time.

        Args:
            t_ns: The time, ns.

        Returns:
            A row for ``belief`` and ``rewrite``; None if the period is no longer kept.
        """
        for back in range(self._count):
            row = (self._last - back) % len(self._t_ns)
            if self._t_ns[row] <= t_ns:
                return row
        return None

    def belief(self, row: int) -> tuple[FloatArray, FloatArray]:
        """Return a kept belief.

        Args:
            row: From ``find``.

        Returns:
            State (9,) and covariance (9, 9), as copies.
        """
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
        """Replace a kept belief, and filter all inputs since then again.

        Args:
            row: From ``find``.
            x: (9,) new state.
            p: (9, 9) new covariance.
            walk: (7,) process noise densities; see ``ekf_model.motion_noise``.
            gauge_m: Nominal distance of the tracks, m.
            gates: (3,) see ``ekf_model.gate_wheels``.

        Returns:
            Present state (9,) and covariance (9, 9).
        """
        self._states[row], self._covariances[row] = x, p
        count = (self._last - row) % len(self._t_ns)
        if count == 0:
            return x, p
        return replay(
            self._states, self._covariances, self._inputs, row, count, walk, gauge_m, gates
        )
