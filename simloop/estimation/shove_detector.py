"""Detect a push from the side by a lateral acceleration that the tracks cannot cause."""

from __future__ import annotations

from collections import deque

_SHOVE_MPS2 = 1.5  # a larger mean lateral acceleration is a push; tracks alone stay below it
_WINDOW = 5  # number of readings in the mean
_SHOVE_NS = 300_000_000  # assumed duration of a push
_SHOVE_VAR = 0.1  # position noise of a push, m^2/s: about 0.1 m between two scans


class ShoveDetector:
    """Detector of lateral accelerations that the robot's own motion does not explain."""

    def __init__(self) -> None:
        self._lateral = deque([0.0] * _WINDOW, _WINDOW)
        self._until_ns = 0

    def update(self, t_ns: int, unexplained_mps2: float) -> bool:
        """Process one accelerometer reading.

        Args:
            t_ns: Stamp of the belief that the reading belongs to, ns.
            unexplained_mps2: Lateral acceleration minus speed times yaw rate, m/s^2.

        Returns:
            Whether the mean of the last readings shows a push.
        """
        self._lateral.append(unexplained_mps2)
        pushed = abs(sum(self._lateral)) > _WINDOW * _SHOVE_MPS2
        if pushed:
            self._until_ns = t_ns + _SHOVE_NS
        return pushed

    def position_noise(self, t_ns: int) -> float:
        """Return the process noise that a push adds to the position.

        Args:
            t_ns: The time, ns.

        Returns:
            Noise along each axis, m^2/s; 0 if no push was detected lately.
        """
        return _SHOVE_VAR if t_ns < self._until_ns else 0.0
