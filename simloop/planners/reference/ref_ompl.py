"""Informed RRT* (Gammell 2014) and BIT* (Gammell 2015) from the library OMPL, minimising length.

OMPL usually stops by the clock. Here it stops after a number of checked motions and states, so that
a plan is the same on every machine. Its random numbers depend on one seed for the whole process,
which is set again for each plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem, segment_clearance
from simloop.planners.problem.objective import make_stack
from simloop.planners.reference.reference import Reference, dear_budget, import_library

_SAME = 1e-9  # relative difference of two lengths that count as equal


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
        if not _goal_is_clear(p):
            return None
        base = self._base
        self._util.setLogLevel(self._util.LOG_NONE)
        self._util.RNG.setSeed(int(rng.integers(1, 2**31)))
        space = self._space(p)
        info = base.SpaceInformation(space)
        motions = self._motions(info, p)
        clear = motions.clear
        info.setMotionValidator(motions)
        info.setStateValidityChecker(lambda state: clear(state[0], state[1], state[0], state[1]))
        info.setup()
        task = base.ProblemDefinition(info)
        start, goal = info.allocState(), info.allocState()
        start[0], start[1], goal[0], goal[1] = p.start_x, p.start_y, p.goal_x, p.goal_y
        task.setStartAndGoalStates(start, goal)
        objective = base.PathLengthOptimizationObjective(info)
        # Nothing is shorter than the straight line: a search that has found it is over.
        straight = math.hypot(p.goal_x - p.start_x, p.goal_y - p.start_y)
        objective.setCostThreshold(base.Cost(straight * (1.0 + _SAME)))
        task.setOptimizationObjective(objective)
        search = getattr(self._geometric, self.method)(info)
        search.setProblemDefinition(task)
        search.setup()
        end = int(p.trials[0]) + self._budget()
        search.solve(base.PlannerTerminationCondition(lambda: int(p.trials[0]) >= end))
        if not task.hasExactSolution():
            return None
        states = task.getSolutionPath().getStates()
        return np.array([[state[0], state[1]] for state in states])

    def _budget(self) -> int:
        """Return the largest number of trials of one search."""
        return self._config.max_evaluations

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
    """OMPL's BIT* (batch informed trees).

    Its time grows with the square of the trials, so its budget is that of a dear search
    (`reference.dear_budget`). Median lengths above the shortest with 6000 and with 40,000 trials,
    in percent: S1 0.32 and 0.18, S2 0.28 and 0.10, S3 2.5 and 0.5. Lengths in m: S4a 9.80 and 9.74,
    S4b 9.68 and 9.63 (the first 1, 5, 3, 1, 1 instances, seed 0).
    """

    name = "bit_star"
    method = "BITstar"

    def _budget(self) -> int:
        return dear_budget(self._config)


@njit(cache=True)
def _is_clear(
    discs: FloatArray,
    corners: FloatArray,
    field: NDArray[np.float32],
    trials: NDArray[np.int64],
    n: FloatArray,
    stack: FloatArray,
    ax: float,
    ay: float,
    bx: float,
    by: float,
) -> bool:
    """Tell whether segment a-b keeps the clearance, as `bends.is_clear` does; it is a trial.

    OMPL asks tens of thousands of times. To hand over a whole `Problem` from Python takes four
    times as long as the check itself, so it is put together here from its arrays and numbers.
    """
    p = Problem(
        discs, corners, field,
        n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10],
        n[11], n[12], n[13], n[14], n[15], n[16], n[17], n[18], n[19], n[20],
        trials,
    )  # fmt: skip
    trials[0] += 1
    need = p.safe_m - 0.5 * p.tolerance_m
    return segment_clearance(p, ax, ay, bx, by, need, need, stack) >= need


def clear_check(p: Problem) -> Callable[[float, float, float, float], bool]:
    """Make the clearance check of a problem, which takes little time to call from Python.

    Args:
        p: The planning problem; each check is counted in ``p.trials``.

    Returns:
        Function of the ends ax, ay, bx, by of a segment, m, map frame.
    """
    arrays = ("discs", "corners", "field", "trials")
    numbers = np.array([value for key, value in p._asdict().items() if key not in arrays])
    return partial(_is_clear, p.discs, p.corners, p.field, p.trials, numbers, make_stack())


def _goal_is_clear(p: Problem) -> bool:
    """Tell whether the goal keeps the clearance. If it does not, BIT* waits for it for ever."""
    before = int(p.trials[0])
    clear = clear_check(p)(p.goal_x, p.goal_y, p.goal_x, p.goal_y)
    p.trials[0] = before  # OMPL checks it again, and counts it
    return clear


def _motions(base: Any) -> Any:
    """Make OMPL's motion validator from the planners' own clearance check.

    The class is made here because its base is only known once OMPL is imported.
    """

    class Motions(base.MotionValidator):  # type: ignore[misc, name-defined]
        def __init__(self, info: Any, p: Problem) -> None:
            super().__init__(info)
            self.clear = clear_check(p)

        def checkMotion(self, a: Any, b: Any, last: Any = None) -> bool:
            return self.clear(a[0], a[1], b[0], b[1])

    return Motions
