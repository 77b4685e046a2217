"""Wind driven optimisation (Bayraktar, Komurcuoglu, Bossard, Werner 2013).

Parcels of air move in a pressure field; the box is scaled to [-1, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule
from simloop.planners.splitmix import State, below


@dataclass(frozen=True, slots=True)
class WdoOptions:
    """Parameters of the wind, with the values of Bayraktar 2013.

    Attributes:
        friction: alpha.
        gravity: g.
        gas: R T.
        coriolis: c.
        speed_limit: Largest velocity in the scaled box.
    """

    friction: float = 0.4
    gravity: float = 0.2
    gas: float = 3.0
    coriolis: float = 0.4
    speed_limit: float = 0.3


@njit(cache=True)
def blow(
    x: FloatArray,
    cost: FloatArray,
    speed: FloatArray,
    best_x: FloatArray,
    candidate: FloatArray,
    low: FloatArray,
    high: FloatArray,
    figures: tuple[float, float, float, float, float],
    state: State,
) -> None:
    """Move all parcels, Eqs. 19-21.

    u = (1 - a) u - g x + |1/i - 1| R T (x_best - x) + c u_other / i, limited. i is the rank by
    pressure, 1 for the least. u_other is the parcel's velocity in a randomly drawn dimension.

    Args:
        x: (n, d) the parcels.
        cost: (n,) their costs, the pressure.
        speed: (n, d) their velocities; changed.
        best_x: (d,) the best position found so far.
        candidate: (n, d) receives the new positions.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        figures: a, g, R T, c and the largest velocity.
        state: (1,) state of the random generator.
    """
    alpha, gravity, gas, coriolis, limit = figures
    n, d = x.shape
    order = np.argsort(cost, kind="mergesort")
    before = np.empty(d)
    for rank in range(n):
        k = order[rank]
        i = rank + 1.0
        before[:] = speed[k]
        for j in range(d):
            half = 0.5 * (high[j] - low[j])
            middle = low[j] + half
            at, best = (x[k, j] - middle) / half, (best_x[j] - middle) / half
            u = (1.0 - alpha) * before[j] - gravity * at + abs(1.0 / i - 1.0) * gas * (best - at)
            u += coriolis * before[below(state, d)] / i
            u = min(max(u, -limit), limit)
            speed[k, j] = u
            candidate[k, j] = middle + half * (at + u)


class WindDriven(Rule):
    """All parcels move, even if their cost rises; the best position so far attracts them."""

    name = "wdo"
    Options = WdoOptions

    def begin(self, population: Population) -> None:
        """Draw the velocities.

        Args:
            population: The population.
        """
        p, limit = population, self.options.speed_limit
        self._speed = np.empty_like(p.x)
        for row in self._speed:
            for j in range(p.x.shape[1]):
                row[j] = limit * (2.0 * below(p.state, 1 << 30) / (1 << 30) - 1.0)

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p, o = population, self.options
        figures = (o.friction, o.gravity, o.gas, o.coriolis, o.speed_limit)
        blow(p.x, p.cost, self._speed, p.best_x, p.candidate, p.low, p.high, figures, p.state)
        p.replace()
