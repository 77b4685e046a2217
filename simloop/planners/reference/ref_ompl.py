"""Informed RRT* (Gammell 2014) and BIT* (Gammell 2015) from the library OMPL, minimising length.

OMPL usually stops by the clock. Here it stops after a number of checked motions and states, so that
a plan is the same on every machine. Its random numbers depend on one seed for the whole process,
which is set again for each plan.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.reference import Reference, import_library


class InformedRrtStar(Reference):
    """OMPL's Informed RRT*; a trial is one checked motion or state."""

    name = "informed_rrt_star"
    method: ClassVar[str] = "InformedRRTstar"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._base = import_library("ompl.base", self.name)
        self._geometric = import_library("ompl.geometric", self.name)
        self._util = import_library("ompl.util", self.name)
        self._motions = _motions(self._base)

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Search until the budget of trials is used up.

        Args:
            world: The world view.
            p: The planning problem in that view; trials are counted in ``p.trials``.
            rng: Source of the seed.

        Returns:
            (n, 2) waypoints of the best path, m, map frame; None if none reaches the goal.
        """
        base = self._base
        self._util.setLogLevel(self._util.LOG_NONE)
        self._util.RNG.setSeed(int(rng.integers(1, 2**31)))
        space = self._space(p)
        info = base.SpaceInformation(space)
        motions = self._motions(info, p)
        info.setMotionValidator(motions)
        info.setStateValidityChecker(lambda state: motions.clear(state, state))
        info.setup()
        task = base.ProblemDefinition(info)
        start, goal = info.allocState(), info.allocState()
        start[0], start[1], goal[0], goal[1] = p.start_x, p.start_y, p.goal_x, p.goal_y
        task.setStartAndGoalStates(start, goal)
        task.setOptimizationObjective(base.PathLengthOptimizationObjective(info))
        search = getattr(self._geometric, self.method)(info)
        search.setProblemDefinition(task)
        search.setup()
        end = int(p.trials[0]) + self._config.max_evaluations
        search.solve(base.PlannerTerminationCondition(lambda: int(p.trials[0]) >= end))
        if not task.hasExactSolution():
            return None
        states = task.getSolutionPath().getStates()
        return np.array([[state[0], state[1]] for state in states])

    def _space(self, p: Problem) -> Any:
        """Make the plane within the bounds, extended to start and goal."""
        space, bounds = self._base.RealVectorStateSpace(2), self._base.RealVectorBounds(2)
        sides = ((p.low_x, p.high_x, p.start_x, p.goal_x), (p.low_y, p.high_y, p.start_y, p.goal_y))
        for axis, (low, high, start, goal) in enumerate(sides):
            bounds.setLow(axis, min(low, start, goal))
            bounds.setHigh(axis, max(high, start, goal))
        space.setBounds(bounds)
        return space


class BitStar(InformedRrtStar):
    """OMPL's BIT* (batch informed trees)."""

    name = "bit_star"
    method = "BITstar"


def _motions(base: Any) -> Any:
    """Make OMPL's motion validator from the planners' own clearance check.

    The class is made here because its base is only known once OMPL is imported.
    """

    class Motions(base.MotionValidator):  # type: ignore[misc, name-defined]
        def __init__(self, info: Any, p: Problem) -> None:
            super().__init__(info)
            self._problem, self._stack, self._ends = p, make_stack(), np.empty((2, 2))

        def clear(self, a: Any, b: Any) -> bool:
            ends = self._ends
            ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = a[0], a[1], b[0], b[1]
            return bool(is_clear(self._problem, ends[0], ends[1], self._stack))

        def checkMotion(self, a: Any, b: Any, last: Any = None) -> bool:
            return self.clear(a, b)

    return Motions
