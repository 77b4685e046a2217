"""What the reference planners share: methods outside the papers, against which theirs are measured.

They keep the planners' one protocol and the same account (J, clearance along every segment); most
of them minimise length alone, which is what their own definition says.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.protocol import kind_of
from simloop.planners.reactive.rollout import Walk, WalkingPlanner
from simloop.planners.registry import info


def library(name: str, planner: str) -> Any:
    """An optional library; where it is missing, one line says how to get it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        root = name.partition(".")[0]
        raise InputError(
            f"planner {planner} needs the library {root}: pip install 'simloop[references]'"
        ) from None


class Reference(WalkingPlanner):
    """A subclass finds a `route`. Where it finds none the plan is the straight line."""

    def _seen(self, world: WorldView) -> WorldView:
        if kind_of(world) not in info(self.name).worlds and len(world.discs_xyr_m):
            # What the cells hold is there as discs too, a little larger.
            return replace(world, distance_m=np.zeros((0, 0), np.float32))
        return world

    def _walker(self, world: WorldView, rng: np.random.Generator) -> Callable[[Problem, int], Walk]:
        def walk(p: Problem, attempt: int) -> Walk:
            before = int(p.trials[0])
            found = self.route(world, p, rng) if kind_of(world) in info(self.name).worlds else None
            straight = np.array([[p.start_x, p.start_y], [p.goal_x, p.goal_y]])
            return Walk(straight if found is None else found, True, int(p.trials[0]) - before)

        return walk

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Waypoints (n, 2) from start to goal, or None; what is tried is counted in p.trials."""
        raise NotImplementedError
