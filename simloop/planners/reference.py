"""What the reference planners share: methods outside the papers, against which theirs are measured.

They keep the planners' one protocol and the same account (J, clearance along every segment); most
of them minimise length alone, which is what their own definition says.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from simloop.config import PlannerConfig, VehicleConfig
from simloop.errors import InputError
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.clearance import Problem
from simloop.planners.rollout import Walk, plan_by_walking, problem_of

WORLDS = ("discs", "polygons", "field")


def kind_of(world: WorldView) -> str:
    """Which of `WORLDS` a view is: the richest that it holds."""
    if world.distance_m.size:
        return "field"
    return "polygons" if len(world.polygons_m) else "discs"


def library(name: str, planner: str) -> Any:
    """An optional library; where it is missing, one line says how to get it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        root = name.partition(".")[0]
        raise InputError(
            f"planner {planner} needs the library {root}: pip install 'simloop[references]'"
        ) from None


class Reference:
    """Keeps `simloop.planners.protocol.Planner`; a subclass finds a `route`."""

    name: ClassVar[str] = ""
    worlds: ClassVar[tuple[str, ...]] = WORLDS
    """The kinds of world it has an answer for; a field's discs stand for it elsewhere. Where it
    finds nothing its plan is the straight line."""

    def __init__(self, config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self.config = config
        self._overhang = max(vehicle.footprint_offsets_m)

    def plan(
        self,
        world: WorldView,
        start: FloatArray,
        goal: FloatArray,
        rng: np.random.Generator,
        *,
        previous: Plan | None = None,
        reason: str = "frame",
    ) -> Plan:
        """As the protocol says; ``previous`` is not used."""
        if kind_of(world) not in self.worlds and len(world.discs_xyr_m):
            # What the cells hold is there as discs too, a little larger.
            world = replace(world, distance_m=np.zeros((0, 0), np.float32))
        problem = problem_of(self.config, self._overhang, world, start, goal)

        def walk(p: Problem, attempt: int) -> Walk:
            before = int(p.trials[0])
            found = self.route(world, p, rng) if kind_of(world) in self.worlds else None
            straight = np.array([[p.start_x, p.start_y], [p.goal_x, p.goal_y]])
            return Walk(straight if found is None else found, True, int(p.trials[0]) - before)

        return plan_by_walking(self.name, world, problem, walk, reason)

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Waypoints (n, 2) from start to goal, or None; what is tried is counted in p.trials."""
        raise NotImplementedError
