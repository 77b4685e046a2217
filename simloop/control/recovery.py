"""What the robot does when it gets nowhere: take the arc that frees it most, then plan anew.

The plan has led to where the monitor lets nothing of it through; that may be beside, before or
behind something, or in a gap that holds both ends. So the robot asks the monitor how far each of
a fan of arcs is free and how much room there is on them, and goes along the best, again
and again, until it has come a little way or its time is up. What brings it on along its path is
worth something too; where that has not helped, the next attempt does without.
"""

from __future__ import annotations

import math

import numpy as np

from simloop.config import TrackerConfig
from simloop.control.collision_monitor import CollisionMonitor
from simloop.geometry.se2 import wrap_angle
from simloop.messages import Estimate, FloatArray

MOST_RECOVERIES = 8
_NEARLY_STILL_M = 0.03
_NEARLY_STILL_RAD = 0.15
_TURN_S = 3.0  # for a turn on the spot, from standstill to standstill
_RATES_RADPS = (0.0, 0.3, -0.3, 0.7, -0.7)
_TURN_RADPS = 0.7
_LOOK_S = 1.5  # how long the arcs are that are compared
_KEEP_S = 0.4  # how long one is kept to
_ROOM_M = 0.08  # more room than this around the robot is worth no more
_WAY_WORTH = 0.1  # m of room that a metre of way is worth, whatever it leads to
_NEARER_WORTH = 0.3  # m of room that a metre nearer to the path's next part is worth


class Recovery:
    """Watches progress; while it is active, its velocity goes before the tracker's."""

    def __init__(self, config: TrackerConfig, monitor: CollisionMonitor) -> None:
        self._config, self._monitor = config, monitor
        self._since_ns = self._turned_ns = 0
        self._from: FloatArray | None = None
        self._yaw = 0.0
        self._until_ns = 0
        self._chosen, self._chosen_ns = (0.0, 0.0), 0
        self._towards: FloatArray | None = None
        self.active = False
        self.attempts = 0

    @property
    def exhausted(self) -> bool:
        """Whether it has been tried too often."""
        return self.attempts > MOST_RECOVERIES

    def watch(self, estimate: Estimate, wants_to_move: bool) -> bool:
        """Note progress; True when the robot has been stuck for long enough to recover.

        Turning counts as progress only for as long as a turn on the spot may take: to and fro
        between two plans that are both held leads nowhere.
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
        """Begin to look for a way out. towards: (2,) where the path leads next, in map."""
        config = self._config
        self.active = True
        self.attempts += 1
        self._towards = towards if self.attempts % 2 else None
        self._restart(estimate)
        self._until_ns = estimate.t_ns + round(2e9 * config.back_off_m / config.back_off_mps)
        self._chosen_ns = 0

    def velocity(self, estimate: Estimate) -> tuple[float, float, str]:
        """Speed, yaw rate and mode to ask for; ends by itself, after which ``active`` is False."""
        assert self._from is not None
        pose, t_ns = estimate.pose, estimate.t_ns
        if t_ns > self._until_ns or math.dist(pose[:2], self._from[:2]) > self._config.back_off_m:
            self.active = False
            self._restart(estimate)
            return 0.0, 0.0, "stop"
        if t_ns >= self._chosen_ns:
            self._chosen, self._chosen_ns = self._freest(pose), t_ns + round(_KEEP_S * 1e9)
        return *self._chosen, "back_off"

    def _freest(self, pose: FloatArray) -> tuple[float, float]:
        """The velocity, m/s and rad/s, whose arc is worth most."""
        speed = self._config.back_off_mps
        arcs = [(s * speed, rate) for s in (-1.0, 1.0) for rate in _RATES_RADPS]
        arcs += [(0.0, _TURN_RADPS), (0.0, -_TURN_RADPS)]
        return max(arcs, key=lambda arc: self._worth(arc, pose))

    def _worth(self, velocity: tuple[float, float], pose: FloatArray) -> float:
        """m: the most room on an arc from ``pose`` (3,), and what its way is worth."""
        ahead, turned = velocity[0] * _LOOK_S, velocity[1] * _LOOK_S
        free, room = self._monitor.look_along(ahead, turned, pose)
        worth = min(room, _ROOM_M) + _WAY_WORTH * free * abs(ahead)
        if self._towards is not None:
            heading = pose[2] + 0.5 * free * turned  # of the arc's chord
            there = pose[:2] + free * ahead * np.array([math.cos(heading), math.sin(heading)])
            nearer = math.dist(pose[:2], self._towards) - math.dist(there, self._towards)
            worth += _NEARER_WORTH * nearer
        return worth

    def _restart(self, estimate: Estimate) -> None:
        self._from, self._since_ns = np.array(estimate.pose), estimate.t_ns
        self._yaw, self._turned_ns = float(estimate.pose[2]), estimate.t_ns
