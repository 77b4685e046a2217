"""First populations of paths, the same for every rule: routes with sideways bends."""

from __future__ import annotations

import math

import numpy as np

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.codings import Coding, encode
from simloop.planners.problem.bends import MAX_POINTS
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import make_stack
from simloop.planners.splitmix import State, normal
from simloop.planners.tlbo.recombine import recombine
from simloop.planners.tlbo.routes import find_routes

_NODES, _ROUTES, _SWEEPS, _WAVES = 4000, 12, 4, 3
_SWING = 0.05


def find_seed_routes(problem: Problem) -> list[FloatArray]:
    """Find routes as the lead planner does; the trials are counted in ``problem.trials``.

    Args:
        problem: The problem.

    Returns:
        Routes (m, 2), m: their best mixture, if there is one, then the cheapest first. If there
        are none, the straight line.
    """
    stack = make_stack()
    routes = np.zeros((_ROUTES + 1, MAX_POINTS, 2))
    counts, costs = np.zeros(_ROUTES, np.int32), np.zeros(_ROUTES)
    found = find_routes(problem, _NODES, _SWEEPS, routes[:_ROUTES], counts, costs, stack)
    mixed = recombine(problem, routes, counts, found, np.inf, routes[_ROUTES], stack)
    out = [routes[k, : counts[k]] for k in range(found)]
    if mixed > 0:
        out.insert(0, routes[_ROUTES, :mixed])
    ends = [[problem.start_x, problem.start_y], [problem.goal_x, problem.goal_y]]
    return out or [np.array(ends)]


def seeded(problem: Problem, coding: Coding, size: int, state: State) -> FloatArray:
    """Make a first population of routes, and of routes with smooth and growing sideways bends.

    Args:
        problem: The problem.
        coding: The coding of the paths.
        size: Number of vectors.
        state: (1,) state of the random generator.

    Returns:
        (size, d) vectors within the box.
    """
    routes = [encode(problem, coding, route) for route in find_seed_routes(problem)]
    reach = max(coding.reach, 1e-9)
    points, rows = coding.points, []
    share = np.arange(1, points + 1) / (points + 1)
    for k in range(size):
        x = routes[k % len(routes)].copy()
        if k >= len(routes):
            wide = _SWING * reach * 2.0 * k / size
            sizes = [wide * normal(state) / (wave + 1) for wave in range(_WAVES)]
            bend = sum(s * np.sin(math.pi * (w + 1) * share) for w, s in enumerate(sizes))
            if coding.kind == 0:
                x[0::2] += bend * coding.along_y
                x[1::2] -= bend * coding.along_x
            else:
                x += bend
        rows.append(np.clip(x, coding.low, coding.high))
    return np.array(rows)
