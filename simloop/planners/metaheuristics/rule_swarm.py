"""Particle swarms: the global-best swarm and the adaptive one.

Sources: Kennedy & Eberhart 1995 with the parameters of Clerc & Kennedy 2002; Zhan, Zhang, Li, Chung
2009 for the adaptive swarm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import Population, Rule
from simloop.planners.splitmix import State, below, normal, uniform


@dataclass(frozen=True, slots=True)
class PsoOptions:
    """Parameters of the swarm (Clerc & Kennedy 2002's constriction; Wu 2016 has 0.9, 2, 2).

    Attributes:
        inertia: w, the share of the velocity that is kept.
        own: c1, the pull of a particle's own best position.
        social: c2, the pull of the best position found so far.
        speed_limit: Largest velocity, as a share of the box's width per generation.
    """

    inertia: float = 0.729
    own: float = 1.49445
    social: float = 1.49445
    speed_limit: float = 0.5


@njit(cache=True)
def fly(
    x: FloatArray,
    speed: FloatArray,
    own_x: FloatArray,
    best_x: FloatArray,
    candidate: FloatArray,
    low: FloatArray,
    high: FloatArray,
    w: float,
    c1: float,
    c2: float,
    limit: float,
    state: State,
) -> None:
    """Move every particle: v = w v + c1 r1 (own best - x) + c2 r2 (best - x), limited.

    A particle that meets a wall of the box stops in that coordinate.

    Args:
        x: (n, d) the particles.
        speed: (n, d) their velocities; changed.
        own_x: (n, d) the best position of each particle.
        best_x: (d,) the best position found so far.
        candidate: (n, d) receives the new positions.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        w: Inertia.
        c1: Pull of a particle's own best position.
        c2: Pull of the best position found so far.
        limit: Largest velocity, as a share of the box's width.
        state: (1,) state of the random generator.
    """
    n, d = x.shape
    for k in range(n):
        for j in range(d):
            v = w * speed[k, j] + c1 * uniform(state) * (own_x[k, j] - x[k, j])
            v += c2 * uniform(state) * (best_x[j] - x[k, j])
            most = limit * (high[j] - low[j])
            v = min(max(v, -most), most)
            candidate[k, j] = x[k, j] + v
            outside = candidate[k, j] < low[j] or candidate[k, j] > high[j]
            speed[k, j] = 0.0 if outside else v


class ParticleSwarm(Rule):
    """Global-best swarm; the first velocities are zero."""

    name = "pso"
    Options: ClassVar[Any] = PsoOptions

    def begin(self, population: Population) -> None:
        """Start every particle with zero velocity and its own position as its best.

        Args:
            population: The population.
        """
        self._speed = np.zeros_like(population.x)
        self._own_x, self._own_cost = population.x.copy(), population.cost.copy()

    def _move(self, p: Population, w: float, c1: float, c2: float, limit: float) -> None:
        fly(
            p.x, self._speed, self._own_x, p.best_x, p.candidate, p.low, p.high,
            w, c1, c2, limit, p.state,
        )  # fmt: skip
        # All that is asked of a cost: is it a particle's own best, and which is the least of all?
        p.replace(self._own_cost, keep=1)
        better = p.cost < self._own_cost
        self._own_x[better], self._own_cost[better] = p.x[better], p.cost[better]

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        o = self.options
        self._move(population, o.inertia, o.own, o.social, o.speed_limit)


@dataclass(frozen=True, slots=True)
class ApsoOptions:
    """Parameters of the adaptive swarm (Zhan 2009).

    Attributes:
        speed_limit: Largest velocity, as a share of the box's width per generation.
        learn_high: Width of the elitist learning's Gaussian at the start.
        learn_low: Width of that Gaussian at the end.
    """

    speed_limit: float = 0.2
    learn_high: float = 1.0
    learn_low: float = 0.1


@njit(cache=True)
def evolutionary_factor(x: FloatArray, best: int) -> float:
    """Compute f of Zhan 2009, Eq. 7: how far the best particle is from the others.

    Args:
        x: (n, d) the particles.
        best: Index of the best one.

    Returns:
        0 (among the others) to 1 (farthest out).
    """
    n, d = x.shape
    columns = x.T.copy()
    means, squares = np.zeros(n), np.empty(n)
    for i in range(n):
        # Each pair once, and all k side by side; every sum keeps the order of a plain double loop.
        square, mean = squares[i + 1 :], means[i + 1 :]
        square[:] = 0.0
        for j in range(d):
            here, column = columns[j, i], columns[j, i + 1 :]
            for k in range(column.size):
                square[k] += (here - column[k]) ** 2
        total = means[i]
        for k in range(square.size):
            square[k] = math.sqrt(square[k])
            mean[k] += square[k]
        for k in range(square.size):
            total += square[k]
        means[i] = total
    means /= n - 1
    least, most, at_best = means.min(), means.max(), means[best]
    return (at_best - least) / (most - least) if most > least else 0.0


EXPLORE, EXPLOIT, CONVERGE, JUMP_OUT = 0, 1, 2, 3


def memberships(f: float) -> tuple[float, float, float, float]:
    """Compute the fuzzy membership of f in the four states, Zhan 2009, Eqs. 8a-8d.

    Args:
        f: The evolutionary factor, 0 to 1.

    Returns:
        Memberships of exploring, exploiting, converging and jumping out.
    """
    explore = float(np.interp(f, [0.4, 0.6, 0.7, 0.8], [0.0, 1.0, 1.0, 0.0]))
    exploit = float(np.interp(f, [0.2, 0.3, 0.4, 0.6], [0.0, 1.0, 1.0, 0.0]))
    converge = float(np.interp(f, [0.1, 0.3], [1.0, 0.0]))
    jump = float(np.interp(f, [0.7, 0.9], [0.0, 1.0]))
    return explore, exploit, converge, jump


def classify(f: float, before: int) -> int:
    """Choose the state of the swarm, in Zhan's sequence explore, exploit, converge, jump out.

    If two states overlap, the present state is kept, or else the next one in the sequence is taken.

    Args:
        f: The evolutionary factor, 0 to 1.
        before: The present state.

    Returns:
        The new state.
    """
    likely = [s for s, m in enumerate(memberships(f)) if m > 0.0]
    if not likely:
        return before
    if before in likely:
        return before
    follows = (before + 1) % 4
    return follows if follows in likely else int(np.argmax(memberships(f)))


class AdaptiveSwarm(ParticleSwarm):
    """A swarm whose parameters depend on its state (Zhan 2009).

    While it converges, the best particle tries a jump.
    """

    name = "apso"
    Options: ClassVar[Any] = ApsoOptions
    scheduled = True

    def begin(self, population: Population) -> None:
        """Start as the particle swarm does, in the exploring state.

        Args:
            population: The population.
        """
        super().begin(population)
        self._c1 = self._c2 = 2.0
        self._swarm_state = EXPLORE

    def generation(self, population: Population) -> None:
        """Compute one generation.

        Args:
            population: The population; changed.
        """
        p, o = population, self.options
        f = evolutionary_factor(p.x, int(np.argmin(p.cost)))
        self._swarm_state = classify(f, self._swarm_state)
        inertia = 1.0 / (1.0 + 1.5 * math.exp(-2.6 * f))  # Eq. 10
        self._adapt(0.05 + 0.05 * uniform(p.state))
        if self._swarm_state == CONVERGE:
            self._elitist_learning(p)
        self._move(p, inertia, self._c1, self._c2, o.speed_limit)

    def _adapt(self, step: float) -> None:
        """Adapt c1 and c2, Zhan 2009, Section III-C: each in [1.5, 2.5], their sum in [3, 4]."""
        own, social = {
            EXPLORE: (1.0, -1.0),
            EXPLOIT: (0.5, -0.5),
            CONVERGE: (0.5, 0.5),
            JUMP_OUT: (-1.0, 1.0),
        }[self._swarm_state]
        self._c1 = min(max(self._c1 + own * step, 1.5), 2.5)
        self._c2 = min(max(self._c2 + social * step, 1.5), 2.5)
        total = self._c1 + self._c2
        if total > 4.0:
            self._c1, self._c2 = 4.0 * self._c1 / total, 4.0 * self._c2 / total

    def _elitist_learning(self, p: Population) -> None:
        """Change one coordinate of the best; without a gain, the result replaces the worst."""
        o = self.options
        sigma = o.learn_high - (o.learn_high - o.learn_low) * p.progress
        jump, cost = p.best_x.reshape(1, -1).copy(), np.empty(1)
        j = below(p.state, jump.shape[1])
        jump[0, j] += (p.high[j] - p.low[j]) * sigma * normal(p.state)
        jump[0, j] = min(max(jump[0, j], p.low[j]), p.high[j])
        best = int(np.argmin(self._own_cost))
        p.evaluate(jump, cost, self._own_cost[best : best + 1])
        if cost[0] < self._own_cost[best]:
            self._own_x[best], self._own_cost[best] = jump[0], cost[0]
        else:
            worst = p.worst()
            p.x[worst], p.cost[worst] = jump[0], cost[0]
