"""Compiled searches for the heading of one step: AVOA and APSO on the cost of `steering`.

`simloop.planners.reactive.steering.RuleSteering` runs the rules of the population engine, which
fit any objective. A walk searches at every step, and the calls between the engine, the rule and the
objective then take longer than the search itself. The searches here are the same ones, with the
rules' own kernels, in one compiled function each; the plain ones are their oracle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import draw_uniform
from simloop.planners.metaheuristics.rule_avoa import AvoaOptions, soar
from simloop.planners.metaheuristics.rule_swarm import (
    CONVERGE,
    EXPLOIT,
    EXPLORE,
    ApsoOptions,
    evolutionary_factor,
    fly,
)
from simloop.planners.reactive.sensing import LocalView, within
from simloop.planners.reactive.steering import AGENTS, ITERATIONS, TURN_LIMIT_RAD, heading_costs
from simloop.planners.splitmix import State, below, normal, uniform

_BUDGET = AGENTS * (1 + ITERATIONS)
_TRAPEZES = (
    ((0.4, 0.6, 0.7, 0.8), (0.0, 1.0, 1.0, 0.0)),  # exploring
    ((0.2, 0.3, 0.4, 0.6), (0.0, 1.0, 1.0, 0.0)),  # exploiting
    ((-1.0, 0.0, 0.1, 0.3), (1.0, 1.0, 1.0, 0.0)),  # converging
    ((0.7, 0.9, 1.0, 2.0), (0.0, 1.0, 1.0, 1.0)),  # jumping out
)
"""Zhan 2009, Eqs. 8a-8d: corners of the memberships of the swarm's states, and their values."""
Search = Callable[[LocalView, State], tuple[float, int]]
"""Returns the turn relative to the target's bearing, rad, and the number of evaluations."""


@njit(cache=True)
def relevant(view: LocalView) -> LocalView:
    """Leave out the points that no cost of a step depends on.

    A step is blocked by points within its length and the safe distance. The nearest point to its
    end is at most two steps farther from the robot than the robot's own nearest point.

    Args:
        view: What the robot knows.

    Returns:
        The view with fewer points, in which every heading costs the same.
    """
    least = np.inf
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - view.x, view.points[k, 1] - view.y
        least = min(least, dx * dx + dy * dy)
    return within(view, max(view.step_m + view.safe_m, math.sqrt(least) + 2.0 * view.step_m))


@njit(cache=True)
def _evaluate(view: LocalView, x: FloatArray, out: FloatArray, best: FloatArray, spent: int) -> int:
    """Evaluate turns while the budget lasts; best: best turn and its cost. Return the new spent."""
    count = min(x.shape[0], max(0, _BUDGET - spent))
    out[count:] = np.inf
    if count == 0:
        return spent
    for k in range(x.shape[0]):
        turn = x[k, 0] if np.isfinite(x[k, 0]) else 0.0
        x[k, 0] = min(max(turn, -TURN_LIMIT_RAD), TURN_LIMIT_RAD)
    heading_costs(view, x[:count], out[:count])
    k = int(np.argmin(out[:count]))
    if out[k] < best[1]:
        best[0], best[1] = x[k, 0], out[k]
    return spent + count


@njit(cache=True)
def _remember(x: FloatArray, cost: FloatArray, lead_x: FloatArray, lead_cost: FloatArray) -> None:
    """Store the two best positions found so far, as `rule_avoa.AfricanVultures` does."""
    for k in np.argsort(cost, kind="mergesort")[:2]:
        if cost[k] < lead_cost[0]:
            lead_x[1], lead_cost[1] = lead_x[0], lead_cost[0]
            lead_x[0], lead_cost[0] = x[k], cost[k]
        elif lead_cost[0] < cost[k] < lead_cost[1]:
            lead_x[1], lead_cost[1] = x[k], cost[k]
    if not np.isfinite(lead_cost[1]):
        lead_x[1] = lead_x[0]


@njit(cache=True)
def vulture_turn(
    view: LocalView, figures: tuple[float, float, float, float, float, float], state: State
) -> tuple[float, int]:
    """Search for the turn of least cost with the African vultures (`rule_avoa`).

    Args:
        view: What the robot knows.
        figures: The fields of `AvoaOptions`.
        state: (1,) random state, advanced.

    Returns:
        Turn relative to the target's bearing, rad; number of evaluations.
    """
    p1, p2, p3, first, gamma, levy_step = figures
    view = relevant(view)
    low, high = np.full(1, -TURN_LIMIT_RAD), np.full(1, TURN_LIMIT_RAD)
    x, cost, best = np.empty((AGENTS, 1)), np.empty(AGENTS), np.array([0.0, np.inf])
    candidate = np.empty_like(x)
    lead_x, lead_cost = np.zeros((2, 1)), np.full(2, np.inf)
    draw_uniform(x, low, high, state)
    spent = _evaluate(view, x, cost, best, 0)
    _remember(x, cost, lead_x, lead_cost)
    for generation in range(1, ITERATIONS + 1):
        progress = generation / ITERATIONS
        quarter = 0.5 * math.pi * progress
        h = 4.0 * uniform(state) - 2.0
        t = h * (math.sin(quarter) ** gamma + math.cos(quarter) - 1.0)
        hunger = (2.0 * uniform(state) + 1.0) * (1.0 - progress) + t
        soar(x, candidate, lead_x, low, high, hunger, p1, p2, p3, first, levy_step, state)
        spent = _evaluate(view, candidate, cost, best, spent)
        x[:] = candidate
        _remember(x, cost, lead_x, lead_cost)
    return best[0], spent


@njit(cache=True)
def _membership(f: float, kind: int) -> float:
    """Interpolate the membership of f in a state of the swarm."""
    at, value = _TRAPEZES[kind]
    if f <= at[0]:
        return value[0]
    for k in range(3):
        if f < at[k + 1]:
            slope = (value[k + 1] - value[k]) / (at[k + 1] - at[k])
            return slope * (f - at[k]) + value[k]
    return value[3]


@njit(cache=True)
def swarm_state(f: float, before: int) -> int:
    """Choose the state of the swarm: the compiled `rule_swarm.classify`.

    Args:
        f: The evolutionary factor, 0 to 1.
        before: The present state.

    Returns:
        The new state.
    """
    follows, most, likeliest = (before + 1) % 4, 0.0, before
    if _membership(f, before) > 0.0:
        return before
    for kind in range(4):
        if _membership(f, kind) > most:
            most, likeliest = _membership(f, kind), kind
    return follows if _membership(f, follows) > 0.0 else likeliest


@njit(cache=True)
def _adapted(c1: float, c2: float, swarm: int, step: float) -> tuple[float, float]:
    """Adapt the pulls of a swarm in a state, Zhan 2009, Section III-C."""
    own, social = -1.0, 1.0
    if swarm == EXPLORE:
        own, social = 1.0, -1.0
    elif swarm == EXPLOIT:
        own, social = 0.5, -0.5
    elif swarm == CONVERGE:
        own, social = 0.5, 0.5
    c1 = min(max(c1 + own * step, 1.5), 2.5)
    c2 = min(max(c2 + social * step, 1.5), 2.5)
    total = c1 + c2
    if total > 4.0:
        return 4.0 * c1 / total, 4.0 * c2 / total
    return c1, c2


@njit(cache=True)
def swarm_turn(
    view: LocalView, figures: tuple[float, float, float], state: State
) -> tuple[float, int]:
    """Search for the turn of least cost with the adaptive swarm (`rule_swarm.AdaptiveSwarm`).

    Args:
        view: What the robot knows.
        figures: The fields of `ApsoOptions`.
        state: (1,) random state, advanced.

    Returns:
        Turn relative to the target's bearing, rad; number of evaluations.
    """
    speed_limit, learn_high, learn_low = figures
    view = relevant(view)
    low, high = np.full(1, -TURN_LIMIT_RAD), np.full(1, TURN_LIMIT_RAD)
    x, cost, best = np.empty((AGENTS, 1)), np.empty(AGENTS), np.array([0.0, np.inf])
    candidate, speed = np.empty_like(x), np.zeros_like(x)
    jump, jump_cost = np.empty((1, 1)), np.empty(1)
    draw_uniform(x, low, high, state)
    spent = _evaluate(view, x, cost, best, 0)
    own_x, own_cost = x.copy(), cost.copy()
    c1, c2, swarm, generation = 2.0, 2.0, EXPLORE, 0
    while spent < _BUDGET:
        generation += 1
        f = evolutionary_factor(x, np.argmin(cost))
        swarm = swarm_state(f, swarm)
        inertia = 1.0 / (1.0 + 1.5 * math.exp(-2.6 * f))
        c1, c2 = _adapted(c1, c2, swarm, 0.05 + 0.05 * uniform(state))
        if swarm == CONVERGE:
            # Elitist learning: the best tries a jump, which replaces the worst if it is no better.
            sigma = learn_high - (learn_high - learn_low) * min(1.0, generation / ITERATIONS)
            jump[0, 0] = best[0]
            j = below(state, 1)
            jump[0, j] += (high[j] - low[j]) * sigma * normal(state)
            jump[0, j] = min(max(jump[0, j], low[j]), high[j])
            leader = np.argmin(own_cost)
            spent = _evaluate(view, jump, jump_cost, best, spent)
            if jump_cost[0] < own_cost[leader]:
                own_x[leader], own_cost[leader] = jump[0], jump_cost[0]
            else:
                worst = np.argmax(cost)
                x[worst], cost[worst] = jump[0], jump_cost[0]
        best_x = best[:1]
        fly(
            x, speed, own_x, best_x, candidate, low, high, inertia, c1, c2, speed_limit, state
        )  # fmt: skip
        spent = _evaluate(view, candidate, cost, best, spent)
        x[:] = candidate
        for k in range(AGENTS):
            if cost[k] < own_cost[k]:
                own_x[k], own_cost[k] = x[k], cost[k]
    return best[0], spent


class CompiledSteering:
    """A `Steering` that finds each heading with one of the compiled searches."""

    def __init__(self, search: Search) -> None:
        self._search, self.evaluations = search, 0

    def heading(self, view: LocalView, heading: float, state: State) -> float:
        """Search for the heading of least cost (Abed 2022, Eq. 5).

        Args:
            view: What the robot knows.
            heading: The robot's present heading, rad; not used.
            state: (1,) random state, advanced.

        Returns:
            Heading, rad, map frame.
        """
        turn, spent = self._search(view, state)
        self.evaluations += spent
        return math.atan2(view.target_y - view.y, view.target_x - view.x) + turn


def vulture_steering() -> CompiledSteering:
    """Make a steering that searches by AVOA.

    Returns:
        The steering; it chooses the same headings as ``RuleSteering(AfricanVultures)``.
    """
    figures = astuple(AvoaOptions())
    return CompiledSteering(lambda view, state: vulture_turn(view, figures, state))


def swarm_steering() -> CompiledSteering:
    """Make a steering that searches by APSO.

    Returns:
        The steering; it chooses the same headings as ``RuleSteering(AdaptiveSwarm)``.
    """
    figures = astuple(ApsoOptions())
    return CompiledSteering(lambda view, state: swarm_turn(view, figures, state))
