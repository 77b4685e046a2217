"""Base class of the reference planners: methods from outside the papers, used for comparison.

They follow the same protocol as all planners and get the same account (J, clearance along every
segment). Most of them minimise length alone, because that is how they are defined.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.config import PlannerConfig
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.protocol import kind_of
from simloop.planners.reactive.rollout import RollOut, Rollout, RolloutPlanner
from simloop.planners.registry import info

DEAR_TRIALS = 3_000
"""Largest number of trials of a dear search, so that it fits into a frame of the loop."""


def import_library(name: str, planner: str) -> Any:
    """Import a module of an optional library.

    Args:
        name: Module to import.
        planner: Name of the planner that needs it, for the error message.

    Returns:
        The module.

    Raises:
        InputError: The library is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        root = name.partition(".")[0]
        raise InputError(
            f"planner {planner} needs the library {root}: pip install 'simloop[references]'"
        ) from None


def dear_budget(config: PlannerConfig) -> int:
    """Compute the budget of a search in which a trial takes far longer than its path's cost.

    Args:
        config: The planner's settings.

    Returns:
        Largest number of trials of one search: ``max_evaluations``, but at most `DEAR_TRIALS`
        unless the settings ask for ``precise`` plans.
    """
    return config.max_evaluations if config.precise else min(config.max_evaluations, DEAR_TRIALS)


class Reference(RolloutPlanner):
    """A planner whose subclasses find a `route`; without a route its plan is the straight line.

    If the registry does not list the view's kind for the planner, the view is replaced by its
    discs, if it has any.
    """

    def _usable_view(self, world: WorldView) -> WorldView:
        if kind_of(world) not in info(self.name).worlds and len(world.discs_xyr_m):
            # The view's discs cover the same obstacles as its cells, slightly enlarged.
            return replace(world, distance_m=np.zeros((0, 0), np.float32))
        return world

    def _make_rollout(self, world: WorldView, rng: np.random.Generator) -> RollOut:
        def solve(p: Problem, attempt: int, most_m: float) -> Rollout:
            before = int(p.trials[0])
            found = self.route(world, p, rng) if kind_of(world) in info(self.name).worlds else None
            straight = np.array([[p.start_x, p.start_y], [p.goal_x, p.goal_y]])
            return Rollout(straight if found is None else found, True, int(p.trials[0]) - before)

        return solve

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Find a path from start to goal.

        Args:
            world: The world view.
            p: The planning problem in that view; trials are counted in ``p.trials``.
            rng: Source of all randomness.

        Returns:
            (n, 2) waypoints from start to goal, m, map frame; None if no path was found.
        """
        raise NotImplementedError
