"""African vultures optimisation (Abdollahzadeh, Gharehchopogh, Mirjalili 2021).

Eqs. 1-18 of the original are used, because those printed in Abed 2022 are garbled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule
from simloop.planners.splitmix import State, normal, uniform

_LEVY = 1.5
_TINY = 1e-15


@dataclass(frozen=True, slots=True)
class AvoaOptions:
    """Parameters of the vultures.

    Attributes:
        p1: Chance of the first way of exploring.
        p2: Chance of the first way in the second phase of exploitation.
        p3: Chance of the first way in the first phase of exploitation.
        first: Chance to follow the best vulture instead of the second best (L1).
        gamma: How early exploration ends (w).
        levy_step: Step of the Levy flight.
    """

    p1: float = 0.6
    p2: float = 0.4
    p3: float = 0.6
    first: float = 0.8
    gamma: float = 2.5
    levy_step: float = 0.01


@njit(cache=True)
def _levy_sigma() -> float:
    """Compute the width of the Gaussian in Mantegna's Levy flight, Eq. 18."""
    sigma = math.gamma(1.0 + _LEVY) * math.sin(0.5 * math.pi * _LEVY)
    sigma /= math.gamma(0.5 * (1.0 + _LEVY)) * _LEVY * 2.0 ** (0.5 * (_LEVY - 1.0))
    return float(sigma ** (1.0 / _LEVY))


@njit(cache=True)
def soar(
    x: FloatArray,
    candidate: FloatArray,
    best: FloatArray,
    low: FloatArray,
    high: FloatArray,
    hunger: float,
    p1: float,
    p2: float,
    p3: float,
    first: float,
    levy_step: float,
    state: State,
) -> None:
    """Move all vultures once.

    Args:
        x: (n, d) the vultures.
        candidate: (n, d) receives their new positions.
        best: (2, d) the two best positions.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        hunger: Factor of z in Eq. 4.
        p1: See `AvoaOptions`.
        p2: See `AvoaOptions`.
        p3: See `AvoaOptions`.
        first: See `AvoaOptions`.
        levy_step: See `AvoaOptions`.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    sigma = _levy_sigma()
    for k in range(n):
        f = hunger * (2.0 * uniform(state) - 1.0)
        r = best[0] if uniform(state) < first else best[1]
        a, b, c = uniform(state), uniform(state), uniform(state)
        for j in range(d):
            here = x[k, j]
            apart = abs(r[j] - here)
            around = abs(2.0 * b * r[j] - here)
            if abs(f) >= 1.0:  # sated vultures explore
                if a < p1:
                    y = r[j] - around * f
                else:
                    y = r[j] - f + b * ((high[j] - low[j]) * c + low[j])
            elif abs(f) >= 0.5:  # exploitation, first phase: siege or rotating flight
                if a < p3:
                    y = around * (f + c) - (r[j] - here)
                else:
                    turn = r[j] * here / (2.0 * math.pi)
                    y = r[j] - turn * (b * math.cos(here) + c * math.sin(here))
            elif a < p2:  # exploitation, second phase: about both best, or a Levy flight
                y = 0.0
                for i in range(2):
                    v = best[i, j]
                    y += 0.5 * (v - v * here / (v - here * here + _TINY) * f)
            else:
                fly = normal(state) * sigma / abs(normal(state)) ** (1.0 / _LEVY)
                y = r[j] - apart * f * levy_step * fly
            candidate[k, j] = y


class AfricanVultures(Rule):
    """Every vulture moves, even if its cost rises; the two best positions so far lead."""

    name = "avoa"
    Options = AvoaOptions
    scheduled = True

    def begin(self, population: Population) -> None:
        """Store the two best of the first population.

        Args:
            population: The population.
        """
        self._best_x = np.zeros((2, population.x.shape[1]))
        self._best_cost = np.full(2, np.inf)
        self._remember(population)

    def _remember(self, p: Population) -> None:
        """Store the two best positions found so far; they are different."""
        for k in np.argsort(p.cost, kind="mergesort")[:2]:
            if p.cost[k] < self._best_cost[0]:
                self._best_x[1], self._best_cost[1] = self._best_x[0], self._best_cost[0]
                self._best_x[0], self._best_cost[0] = p.x[k], p.cost[k]
            elif self._best_cost[0] < p.cost[k] < self._best_cost[1]:
                self._best_x[1], self._best_cost[1] = p.x[k], p.cost[k]
        if not np.isfinite(self._best_cost[1]):
            self._best_x[1] = self._best_x[0]

    def generation(self, population: Population) -> None:
        """Compute one generation, with the hunger by Eqs. 3 and 4.

        Args:
            population: The population; changed.
        """
        p, o = population, self.options
        quarter = 0.5 * math.pi * p.progress
        h = 4.0 * uniform(p.state) - 2.0
        t = h * (math.sin(quarter) ** o.gamma + math.cos(quarter) - 1.0)  # Eq. 3
        hunger = (2.0 * uniform(p.state) + 1.0) * (1.0 - p.progress) + t  # Eq. 4
        soar(
            p.x, p.candidate, self._best_x, p.low, p.high, hunger,
            o.p1, o.p2, o.p3, o.first, o.levy_step, p.state,
        )  # fmt: skip
        # Only a vulture that becomes one of the two best so far matters.
        p.replace(np.full(p.size, self._best_cost[1]))
        self._remember(p)
