"""Informed RRT* (Gammell 2014) and BIT* (Gammell 2015) by the library OMPL, minimising length.

The library stops by the clock as a rule; here it stops when its account of motions and states
checked is full, so that a plan is the same on any machine. Its random numbers hang on one seed of
the whole process, which is set anew for each plan.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.bends import is_clear
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.reference import Reference, library


class InformedRrtStar(Reference):
    """A trial is a motion or a state checked."""

    name = "informed_rrt_star"
    method: ClassVar[str] = "InformedRRTstar"

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._base = library("ompl.base", self.name)
        self._geometric = library("ompl.geometric", self.name)
        self._util = library("ompl.util", self.name)
        self._motions = _motions(self._base)

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """The best path when the account is full, or None."""
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
        path = np.array([[state[0], state[1]] for state in states])
        return path

    def _space(self, p: Problem) -> Any:
        """The plane between the bounds, start and goal included."""
        space, bounds = self._base.RealVectorStateSpace(2), self._base.RealVectorBounds(2)
        sides = ((p.low_x, p.high_x, p.start_x, p.goal_x), (p.low_y, p.high_y, p.start_y, p.goal_y))
        for axis, (low, high, start, goal) in enumerate(sides):
            bounds.setLow(axis, min(low, start, goal))
            bounds.setHigh(axis, max(high, start, goal))
        space.setBounds(bounds)
        return space


class BitStar(InformedRrtStar):
    """Batch informed trees."""

    name = "bit_star"
    method = "BITstar"


def _motions(base: Any) -> Any:
    """The planners' own clearance check in OMPL's form; its class can only be made once OMPL is."""

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
