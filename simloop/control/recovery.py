"""Progress of the robot: when it is stuck, and how long it then tries to free itself.

Being stuck chooses no velocity. It changes the weights by which the arbiter compares velocities:
room counts more than the path. Every second attempt also counts what leads on along the path.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.config import RecoveryConfig
from simloop.geometry.se2 import wrap_angle
from simloop.messages import Estimate, FloatArray

_NEARLY_STILL_M = 0.03
_NEARLY_STILL_RAD = 0.15
_TURN_S = 3.0  # of a turn on the spot, from standstill to standstill


class Recovery:
    """Watches progress. ``active`` while the robot frees itself; ``attempts`` counts recoveries.

    Attributes:
        active: Whether a recovery is under way.
        attempts: Recoveries begun so far.
        towards: (2,) in map, m: where the path leads next; None where it does not count.
    """

    def __init__(self, config: RecoveryConfig) -> None:
        self._config = config
        self._since_ns = self._turned_ns = self._until_ns = 0
        self._from: FloatArray | None = None
        self._yaw = 0.0
        self.towards: FloatArray | None = None
        self.active = False
        self.attempts = 0

    @property
    def exhausted(self) -> bool:
        """Whether it has been tried too often."""
        return self.attempts > self._config.attempts

    def is_stuck(self, estimate: Estimate, wants_to_move: bool) -> bool:
        """Take note of the robot's motion and say whether it has been stuck for long enough.

        Turning counts as progress only for as long as a turn on the spot may take: turning to and
        fro between two plans that are both held leads nowhere.

        Args:
            estimate: The belief now.
            wants_to_move: Whether the robot tries to move and nothing that moves holds it.

        Returns:
            True if a recovery should begin.
        """
        pose = estimate.pose
        if (
            not wants_to_move
            or self._from is None
            or math.dist(pose[:2], self._from[:2]) > _NEARLY_STILL_M
        ):
            self._restart(estimate)
        elif abs(wrap_angle(pose[2] - self._yaw)) > _NEARLY_STILL_RAD:
            self._yaw, self._turned_ns = pose[2], estimate.t_ns
        still_s = (estimate.t_ns - self._turned_ns) * 1e-9
        here_s = (estimate.t_ns - self._since_ns) * 1e-9
        return still_s > self._config.stuck_s or here_s > self._config.stuck_s + _TURN_S

    def start(self, estimate: Estimate, towards: FloatArray | None = None) -> None:
        """Begin to look for a way out.

        Args:
            estimate: The belief now.
            towards: (2,) in map, m: where the path leads next.
        """
        config = self._config
        self.active = True
        self.attempts += 1
        self.towards = towards if self.attempts % 2 else None
        self._restart(estimate)
        self._until_ns = estimate.t_ns + round(2e9 * config.back_off_m / config.back_off_mps)

    def goes_on(self, estimate: Estimate) -> bool:
        """Say whether the recovery goes on; it ends after a short way or when its time is up.

        Args:
            estimate: The belief now.

        Returns:
            True while ``active``.
        """
        assert self._from is not None
        far = math.dist(estimate.pose[:2], self._from[:2]) > self._config.back_off_m
        if estimate.t_ns > self._until_ns or far:
            self.active, self.towards = False, None
            self._restart(estimate)
        return self.active

    def _restart(self, estimate: Estimate) -> None:
        self._from, self._since_ns = np.array(estimate.pose), estimate.t_ns
        self._yaw, self._turned_ns = float(estimate.pose[2]), estimate.t_ns
