"""What the robot does when it gets nowhere: back off, turn a little, plan anew."""

from __future__ import annotations

import math

import numpy as np

from simloop.config import TrackerConfig
from simloop.messages import Estimate, FloatArray
from simloop.se2 import wrap_angle

_NEARLY_STILL_M = 0.03
_NEARLY_STILL_RAD = 0.15
_TURN_RAD = 0.5
_TURN_RADPS = 0.8


class Recovery:
    """Watches progress; while it is active, its velocity goes before the tracker's."""

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self._since_ns = 0
        self._from: FloatArray | None = None
        self._phase = ""
        self._side = 1.0
        self.attempts = 0

    @property
    def active(self) -> bool:
        """Whether a recovery is under way."""
        return self._phase != ""

    def watch(self, estimate: Estimate, wants_to_move: bool) -> bool:
        """Note progress; True when the robot has been stuck for long enough to recover."""
        pose = estimate.pose
        moved = self._from is None or (
            math.dist(pose[:2], self._from[:2]) > _NEARLY_STILL_M
            or abs(wrap_angle(pose[2] - self._from[2])) > _NEARLY_STILL_RAD
        )
        if moved or not wants_to_move:
            self._restart(estimate)
        return estimate.t_ns - self._since_ns > self._config.stuck_s * 1e9

    def start(self, estimate: Estimate) -> None:
        """Begin to back off."""
        self._phase = "back_off"
        self.attempts += 1
        self._side = -self._side  # the other way round at the next attempt
        self._restart(estimate)

    def velocity(self, estimate: Estimate) -> tuple[float, float, str]:
        """Speed, yaw rate and mode to ask for; ends by itself, after which ``active`` is False."""
        assert self._from is not None
        config, pose = self._config, estimate.pose
        late = estimate.t_ns - self._since_ns > 2e9 * config.back_off_m / config.back_off_mps
        if self._phase == "back_off":
            if not late and math.dist(pose[:2], self._from[:2]) < config.back_off_m:
                return -config.back_off_mps, 0.0, "back_off"
            self._phase = "turn"
            self._restart(estimate)
        turned = abs(wrap_angle(pose[2] - self._from[2]))
        if turned < _TURN_RAD and estimate.t_ns - self._since_ns < 2e9 * _TURN_RAD / _TURN_RADPS:
            return 0.0, self._side * _TURN_RADPS, "recovery_turn"
        self._phase = ""
        self._restart(estimate)
        return 0.0, 0.0, "stop"

    def _restart(self, estimate: Estimate) -> None:
        self._from, self._since_ns = np.array(estimate.pose), estimate.t_ns
