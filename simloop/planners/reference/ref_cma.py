"""CMA-ES (Hansen 2016) from the library ``cma``, on the coded waypoints of the metaheuristics.

It starts at the cheapest member of the same first population. Whenever it has converged, it
restarts at the next cheapest member with a doubled population (IPOP), until the budget is spent.

The library takes far longer for a generation than its paths' costs take, so the budget is that of a
dear search (`reference.dear_budget`). Medians of J above the optimum with 6000 and with 40,000
trials, in percent: S1 0.14 and 0.03, S2 0.06 and 0.02, S3 0.13 and 0.09, S4a 0.25 and 0.06, S4b
0.33 and 0.28 (the first 1, 5, 3, 1, 1 instances, seeds 0 to 2).
"""

from __future__ import annotations

import warnings
from typing import ClassVar

import numpy as np

from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.metaheuristics.codings import PathObjective, make_coding
from simloop.planners.metaheuristics.seeds import seeded
from simloop.planners.problem.clearance import Problem
from simloop.planners.reference.reference import Reference, dear_budget, import_library
from simloop.planners.splitmix import make_state

POINTS = 8
"""Number of waypoints between start and goal."""
_SIGMA = 0.02  # first standard deviation, as a share of the box's width


class CmaEs(Reference):
    """CMA-ES with restarts.

    Trials are the evaluated paths and the trials of the route search for the first population. The
    first population is always evaluated, even if the budget is smaller.
    """

    name = "cma"
    points: ClassVar[int] = POINTS

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        super().__init__(config, vehicle)
        self._cma = import_library("cma", self.name)

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Search for the path of least cost.

        Args:
            world: The world view.
            p: The planning problem in that view; trials are counted in ``p.trials``.
            rng: Source of all randomness.

        Returns:
            (n, 2) waypoints of the best evaluated path, m, map frame; it may be unsafe.
        """
        coding = make_coding(p, "box", self.points)
        objective = PathObjective(p, coding)
        end = int(p.trials[0]) + dear_budget(self._config)
        first = seeded(p, coding, self._config.learners, make_state(rng))
        # The first population is evaluated in any case.
        end = max(end, int(p.trials[0]) + self._config.learners)
        costs = _costs(objective, first)
        best_x, best = first[np.argmin(costs)], float(costs.min())
        starts, size = np.argsort(costs, kind="mergesort"), 0
        width = objective.high - objective.low
        for restart in range(len(starts)):
            if int(p.trials[0]) >= end:
                break
            options = {
                "bounds": [objective.low, objective.high],
                "CMA_stds": width,
                "seed": int(rng.integers(1, 2**31)),
                "verbose": -9,
                **({"popsize": size} if size else {}),
            }
            start = np.clip(first[starts[restart]], objective.low, objective.high)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                search = self._cma.CMAEvolutionStrategy(start, _SIGMA, options)
            size = 2 * search.popsize
            while not search.stop():
                asked = np.array(search.ask())
                left = end - int(p.trials[0])
                # A generation that exceeds the budget is not evaluated.
                if left < len(asked):
                    p.trials[0] = end
                    break
                costs = _costs(objective, asked)
                if costs.min() < best:
                    best, best_x = float(costs.min()), asked[np.argmin(costs)]
                search.tell(list(asked), list(costs))
        return objective.path(best_x)


def _costs(objective: PathObjective, x: FloatArray) -> FloatArray:
    """Compute the costs (n,) of coded paths (n, d)."""
    out = np.empty(len(x))
    objective.costs(np.ascontiguousarray(x), out, np.full(len(x), np.inf))
    return out
