"""Detect that the robot moves as its tracks do not drive it: pushed from the side, or sliding."""

from __future__ import annotations

import math
from collections import deque
from operator import itemgetter

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray

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


_SPEED = itemgetter(4)
_SLIDE_MPS = 0.12  # motion that the belts do not explain; on firm ground it stays below 0.09
_SLIDE_NS = 300_000_000  # the motion over this time is compared, so that several scans count
_SLIPPERY_NS = 3_000_000_000  # ground on which the robot has slid counts as slippery for this time


class SlideDetector:
    """Detector of motion, between the fixes, that the belts' speeds do not explain.

    Tracks that turn use up the ground's friction, and the robot slides on as it went before. Where
    that happens, it cannot stop on the arc that it was commanded.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, float, float, float, float]] = deque()
        self._until_ns = 0

    def slippery(self, t_ns: int) -> bool:
        """Tell whether the robot has slid lately.

        Args:
            t_ns: The time, ns.

        Returns:
            Whether the ground counts as slippery.
        """
        return t_ns < self._until_ns

    def update(self, t_ns: int, state: FloatArray, certain: bool) -> None:
        """Process a belief.

        Args:
            t_ns: Its stamp, ns.
            state: (4+,) x, y, m, yaw, rad, and speed, m/s, first.
            certain: Whether the pose is held by fixes. If not, nothing is concluded.
        """
        if not certain:
            self._kept.clear()
            return
        x, y, yaw, speed = state[:4].tolist()
        self._kept.append((t_ns, x, y, yaw, speed))
        if t_ns - self._kept[0][0] < _SLIDE_NS:
            return
        then_ns, x0, y0, yaw0, _ = self._kept.popleft()
        seconds = 1e-9 * (t_ns - then_ns)
        # Along an arc the chord has the heading of its middle.
        middle = yaw0 + 0.5 * wrap_angle(yaw - yaw0)
        cos, sin = math.cos(middle), math.sin(middle)
        ahead = (cos * (x - x0) + sin * (y - y0)) / seconds
        aside = (cos * (y - y0) - sin * (x - x0)) / seconds
        driven = sum(map(_SPEED, self._kept)) / len(self._kept)
        if math.hypot(ahead - driven, aside) > _SLIDE_MPS:
            self._until_ns = t_ns + _SLIPPERY_NS
