"""Notice a push from the side: a lateral acceleration that the tracks cannot have made."""

from __future__ import annotations

from collections import deque

_SHOVE_MPS2 = 1.5  # lateral, mean over _WINDOW periods; tracks alone stay below it
_WINDOW = 5
_SHOVE_NS = 300_000_000  # how long a push is taken to last
_SHOVE_VAR = 0.1  # m^2/s: about a decimetre between two scans


class ShoveDetector:
    """Watches the lateral acceleration that the robot's own motion does not explain."""

    def __init__(self) -> None:
        self._lateral = deque([0.0] * _WINDOW, _WINDOW)
        self._until_ns = 0

    def update(self, t_ns: int, unexplained_mps2: float) -> bool:
        """Take one accelerometer reading.

        Args:
            t_ns: Stamp of the belief that it belongs to.
            unexplained_mps2: Lateral acceleration less speed times yaw rate, m/s^2.

        Returns:
            Whether the mean over the last readings means a push.
        """
        self._lateral.append(unexplained_mps2)
        pushed = abs(sum(self._lateral)) > _WINDOW * _SHOVE_MPS2
        if pushed:
            self._until_ns = t_ns + _SHOVE_NS
        return pushed

    def position_noise(self, t_ns: int) -> float:
        """Return the process noise of the position that a push calls for.

        Args:
            t_ns: An instant.

        Returns:
            m^2/s along each axis; 0 when no push was noticed lately.
        """
        return _SHOVE_VAR if t_ns < self._until_ns else 0.0
