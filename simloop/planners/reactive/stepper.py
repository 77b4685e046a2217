"""Point robot that decides one step at a time from what it senses (Abed 2022, Sections 3, 4).

Each step has the paper's two phases. In the sensing phase the robot looks for obstacles; if none is
in range, it moves straight to its target. Otherwise a `Steering` (AVOA, APSO, fuzzy-WDO) computes
the heading of the step; see `simloop.planners.reactive.steering`.

Chosen here: the paper claims to leave local minima but does not say how. A cost of a single step
cannot do it. The stepper therefore follows surfaces, like the Bug algorithms (Lumelsky & Stepanov
1987; Kamon, Rimon & Rivlin 1998):

- It starts where a step no longer brings the robot nearer to the goal. The obstacle is kept on
  the side that needs the smaller turn. The steering's target becomes a point ahead along the
  surface. The steering's heading may differ from the surface's by `_STEERING_MARGIN_RAD` at most.
- It ends where the goal's bearing is free and the robot is nearer to the goal than at the start of
  the episode. Every episode brings the robot nearer to the goal, so it cannot circle for ever.
- If every heading is blocked, or the step would meet a mover, the robot waits.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from simloop.messages import FloatArray
from simloop.planners.reactive.sensing import (
    LocalView,
    collision_threat,
    easier_side,
    free_range,
    surface_heading,
)
from simloop.planners.splitmix import State

BLOCKED_COST = 10.0
"""Extra cost of a heading whose step would end too close to an obstacle."""
_PROGRESS_SHARE = 0.1  # less progress than this share of a step counts as a stop
_AHEAD_STEPS = 2.0
_OPEN_STEPS = 4.0
_LOOP_STEPS = 20
_STEERING_MARGIN_RAD = 0.6


class Steering(Protocol):
    """Chooses the heading of one step from what is sensed.

    Attributes:
        evaluations: Number of headings (or whole controllers) evaluated so far.
    """

    evaluations: int

    def heading(self, view: LocalView, heading: float, state: State) -> float:
        """Choose the heading of the next step.

        Args:
            view: What the robot knows.
            heading: The robot's present heading, rad, map frame.
            state: (1,) random state, advanced.

        Returns:
            Heading, rad, map frame.
        """
        ...


class Stepper:
    """Moves a point robot step by step; keeps its mode and its heading between the steps.

    The mode is either "towards the goal" or "along a surface".

    Attributes:
        circled: How often the robot has come back to where it met the present surface.
    """

    def __init__(self, steering: Steering, state: State, heading: float) -> None:
        """Start towards the goal.

        Args:
            steering: Chooses the headings.
            state: (1,) random state for the steering.
            heading: First heading, rad, map frame.
        """
        self._steering, self._state, self._heading = steering, state, heading
        self._side = 0  # 1 or -1: a surface is followed on the left or right; 0: towards the goal
        self._stopped_at = np.zeros(2)
        self._follow_steps = 0
        self.circled = 0

    @property
    def evaluations(self) -> int:
        """Number of headings (or whole controllers) evaluated so far."""
        return self._steering.evaluations

    def go_on_along_surface(self, view: LocalView) -> None:
        """Take up the nearest surface, as if the point had followed it up to here.

        Args:
            view: What the robot knows.
        """
        if not len(view.points):
            return
        aside = view.points - (view.x, view.y)
        dx, dy = aside[int(np.argmin(np.hypot(*aside.T)))]
        left = math.cos(self._heading) * dy - math.sin(self._heading) * dx
        self._side = 1 if left >= 0.0 else -1
        self._stopped_at, self._follow_steps = np.array([view.x, view.y]), 0

    def step(self, view: LocalView, goal: FloatArray) -> FloatArray:
        """Choose the robot's next position.

        Args:
            view: What the robot knows; its target is replaced here.
            goal: (2,) present position of the goal, m, map frame.

        Returns:
            (2,) next position, m, map frame; the present position if the robot waits.
        """
        here = np.array([view.x, view.y])
        left = math.dist(here, goal)
        bearing = math.atan2(goal[1] - here[1], goal[0] - here[0])
        view = view._replace(step_m=min(view.step_m, left), target_x=goal[0], target_y=goal[1])
        if left < 1e-12 or self._can_reach_goal(view, bearing, left):
            self._side = 0
            return np.array(goal, dtype=np.float64)
        if self._side and self._may_leave_surface(view, goal, bearing, left):
            self._side = 0
        if not self._side:
            there = self._move(view)
            waits = np.array_equal(there, here)
            ahead = free_range(view, view.x, view.y, math.cos(bearing), math.sin(bearing))
            stopped = math.dist(there, goal) > left - _PROGRESS_SHARE * view.step_m
            stopped = stopped and ahead < min(left, _AHEAD_STEPS * view.step_m)
            # A robot that waits for a mover is not stuck at a surface, so it keeps waiting.
            if not stopped or (waits and collision_threat(view, 0.0, 0.0) > 0.0):
                return there
            self._side = easier_side(view, bearing, min(_OPEN_STEPS * view.step_m, view.reach_m))
            self._heading, self._stopped_at, self._follow_steps = bearing, here, 0
            self.circled = 0
        return self._follow_surface(view, here)

    def _can_reach_goal(self, view: LocalView, bearing: float, left: float) -> bool:
        """Whether this step can end at the goal."""
        ux, uy = math.cos(bearing), math.sin(bearing)
        if left > view.step_m or free_range(view, view.x, view.y, ux, uy) < left:
            return False
        return collision_threat(view, left * ux, left * uy) == 0.0

    def _may_leave_surface(
        self, view: LocalView, goal: FloatArray, bearing: float, left: float
    ) -> bool:
        """Whether the goal's bearing is free and the robot is nearer to it than at its stop."""
        if left > math.dist(self._stopped_at, goal) - 0.5 * view.step_m:
            return False
        ahead = min(left, _AHEAD_STEPS * view.step_m)
        return free_range(view, view.x, view.y, math.cos(bearing), math.sin(bearing)) >= ahead

    def _follow_surface(self, view: LocalView, here: FloatArray) -> FloatArray:
        """Move one step along the surface that is kept on one side."""
        self._follow_steps += 1
        if self._follow_steps > _LOOP_STEPS and math.dist(here, self._stopped_at) < view.step_m:
            # The robot has circled the obstacle without finding a way, so it turns back.
            self._side, self._follow_steps = -self._side, 0
            self.circled += 1
        angle = surface_heading(view, self._heading, self._side)
        if not math.isfinite(angle):
            return here
        ahead = _AHEAD_STEPS * view.step_m
        target_x = view.x + ahead * math.cos(angle)
        target_y = view.y + ahead * math.sin(angle)
        return self._move(view._replace(target_x=target_x, target_y=target_y), angle)

    def _move(self, view: LocalView, surface_rad: float | None = None) -> FloatArray:
        """Move one step towards the view's target; surface_rad: heading along the surface."""
        here = np.array([view.x, view.y])
        if len(view.points) or len(view.movers):
            angle = self._steering.heading(view, self._heading, self._state)
        else:
            angle = math.atan2(view.target_y - view.y, view.target_x - view.x)
        # Near movers the steering is not limited: evasion matters more than the surface.
        if surface_rad is not None and not len(view.movers):
            off = math.remainder(angle - surface_rad, 2.0 * math.pi)
            angle = surface_rad if abs(off) > _STEERING_MARGIN_RAD else angle
        ux, uy = math.cos(angle), math.sin(angle)
        if free_range(view, view.x, view.y, ux, uy) < view.step_m:
            return here
        danger = collision_threat(view, view.step_m * ux, view.step_m * uy)
        if danger > 0.0 and danger >= collision_threat(view, 0.0, 0.0):
            return here
        self._heading = angle
        return here + view.step_m * np.array([ux, uy])
