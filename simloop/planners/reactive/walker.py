"""A point robot that decides one step at a time from what it senses: Abed 2022, Sections 3 and 4.

Each step has the paper's two phases. Sensing: nothing within reach, and the robot goes straight to
its target; else a steering (AVOA, APSO, fuzzy-WDO) chooses the heading, see
`simloop.planners.reactive.steering`.

Filled in, for the paper claims to leave local minima but does not say how, and a cost of one step
alone cannot: where a step no longer brings the robot nearer to the goal, it keeps what blocks it
at one side (that which turns it least), heading for the end of the surface that it sees, until the
goal's bearing is free from a place nearer to the goal than where it was stopped (Lumelsky &
Stepanov 1987; Kamon, Rimon & Rivlin 1998). A steering may not leave that surface: its heading is
kept within 0.6 rad of the surface's. Between two such places it has come nearer, so it never goes
round for ever. Where every heading is blocked, or something moving would be met, it waits.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from simloop.messages import FloatArray
from simloop.planners.reactive.sensing import Look, easier_side, free_range, threat, wall_heading
from simloop.planners.splitmix import State

BLOCKED = 10.0
"""What a heading costs more that would end too close to something."""
_NEARER_SHARE = 0.1
_AHEAD_STEPS = 2.0
_OPEN_STEPS = 4.0
_LOOP_STEPS = 20
_LEEWAY_RAD = 0.6


class Steering(Protocol):
    """Chooses a heading from what is sensed."""

    evaluations: int

    def heading(self, look: Look, heading: float, state: State) -> float:
        """Where to go, rad. heading: where the robot has been going."""
        ...


class Walker:
    """Keeps the mode (towards the goal, or along a surface) and the heading between steps."""

    def __init__(self, steering: Steering, state: State, heading: float) -> None:
        self._steering, self._state, self._heading = steering, state, heading
        self._side = 0
        self._hit = np.zeros(2)
        self._along_steps = 0

    @property
    def evaluations(self) -> int:
        """How many headings (or whole controllers) have been tried so far."""
        return self._steering.evaluations

    def step(self, look: Look, goal: FloatArray) -> FloatArray:
        """The next place (2,); the present one where it waits. look.target is set here."""
        here = np.array([look.x, look.y])
        left = math.dist(here, goal)
        bearing = math.atan2(goal[1] - here[1], goal[0] - here[0])
        look = look._replace(step=min(look.step, left), target_x=goal[0], target_y=goal[1])
        if left < 1e-12 or self._goal_at_hand(look, bearing, left):
            self._side = 0
            return np.array(goal, dtype=np.float64)
        if self._side and self._may_leave(look, goal, bearing, left):
            self._side = 0
        if not self._side:
            there = self._go(look)
            waits = np.array_equal(there, here)
            ahead = free_range(look, look.x, look.y, math.cos(bearing), math.sin(bearing))
            stopped = math.dist(there, goal) > left - _NEARER_SHARE * look.step
            stopped = stopped and ahead < min(left, _AHEAD_STEPS * look.step)
            if not stopped or (waits and threat(look, 0.0, 0.0) > 0.0):
                return there
            self._side = easier_side(look, bearing, min(_OPEN_STEPS * look.step, look.reach))
            self._heading, self._hit, self._along_steps = bearing, here, 0
        return self._along(look, here, left, goal)

    def _goal_at_hand(self, look: Look, bearing: float, left: float) -> bool:
        ux, uy = math.cos(bearing), math.sin(bearing)
        if left > look.step or free_range(look, look.x, look.y, ux, uy) < left:
            return False
        return threat(look, left * ux, left * uy) == 0.0

    def _may_leave(self, look: Look, goal: FloatArray, bearing: float, left: float) -> bool:
        """Whether the goal's bearing is free, nearer to the goal than where it was stopped."""
        if left > math.dist(self._hit, goal) - 0.5 * look.step:
            return False
        ahead = min(left, _AHEAD_STEPS * look.step)
        return free_range(look, look.x, look.y, math.cos(bearing), math.sin(bearing)) >= ahead

    def _along(self, look: Look, here: FloatArray, left: float, goal: FloatArray) -> FloatArray:
        """One step along the surface that is kept at one side."""
        self._along_steps += 1
        if self._along_steps > _LOOP_STEPS and math.dist(here, self._hit) < look.step:
            self._side, self._along_steps = -self._side, 0  # once round: try the other way
        angle = wall_heading(look, self._heading, self._side)
        if not math.isfinite(angle):
            return here
        ahead = _AHEAD_STEPS * look.step
        target_x = look.x + ahead * math.cos(angle)
        target_y = look.y + ahead * math.sin(angle)
        return self._go(look._replace(target_x=target_x, target_y=target_y), angle)

    def _go(self, look: Look, surface_rad: float | None = None) -> FloatArray:
        """One step towards the look's target; surface_rad: the heading along what is followed."""
        here = np.array([look.x, look.y])
        if len(look.points) or len(look.movers):
            angle = self._steering.heading(look, self._heading, self._state)
        else:
            angle = math.atan2(look.target_y - look.y, look.target_x - look.x)
        if surface_rad is not None and not len(look.movers):
            off = math.remainder(angle - surface_rad, 2.0 * math.pi)
            angle = surface_rad if abs(off) > _LEEWAY_RAD else angle
        ux, uy = math.cos(angle), math.sin(angle)
        if free_range(look, look.x, look.y, ux, uy) < look.step:
            return here
        danger = threat(look, look.step * ux, look.step * uy)
        if danger > 0.0 and danger >= threat(look, 0.0, 0.0):
            return here
        self._heading = angle
        return here + look.step * np.array([ux, uy])
