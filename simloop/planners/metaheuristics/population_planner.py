"""Population planner: a planner made of a rule, a coding, a first population and a budget."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from simloop.common.errors import did_you_mean
from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import Plan
from simloop.planners.metaheuristics.codings import CODINGS, PathObjective, encode, make_coding
from simloop.planners.metaheuristics.population import Population, Rule, minimise
from simloop.planners.metaheuristics.seeds import seeded
from simloop.planners.problem.account import account, problem_of
from simloop.planners.problem.clearance import Problem
from simloop.planners.protocol import PlanningTask
from simloop.planners.splitmix import make_state
from simloop.planners.tlbo.warm import way_ahead

_SEEDINGS = ("seeded", "uniform")
_SHOWN = 12
_HERE_M = 1e-6


@dataclass(frozen=True, slots=True)
class Setup:
    """The keys of ``[planner.options]`` that every rule's planner takes.

    Attributes:
        points: Number of inner waypoints of a path; 0 for the rule's own number.
        coding: One of `codings.CODINGS`; empty for the rule's own.
        seeding: ``seeded`` (routes and bends) or ``uniform`` (as in the papers); empty for the
            rule's own.
    """

    points: int = 0
    coding: str = ""
    seeding: str = ""


def read_options(rule: type[Rule], given: dict[str, Any]) -> tuple[Setup, Any]:
    """Split and check ``[planner.options]``.

    Args:
        rule: The rule's class.
        given: The keys and values of ``[planner.options]``.

    Returns:
        The planner's `Setup`, and the rule's own ``Options``.

    Raises:
        ValueError: If an option is wrong; the message says which one and what is allowed.
    """
    known = {f.name: f.default for f in (*fields(Setup), *fields(rule.Options))}
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"unknown option '{key}'{did_you_mean(key, known)}")
        default: Any = known[key]
        wanted = (int, float) if isinstance(default, float) else type(default)
        if not isinstance(value, wanted) or (isinstance(value, bool) and default is not value):
            kind = {int: "a whole number", float: "a number", str: "a string"}[type(default)]
            raise ValueError(f"option {key}: must be {kind}, not {value!r}")
        if not isinstance(value, str) and not 0 <= value <= 1e6:
            raise ValueError(f"option {key}: must be between 0 and 1e6, not {value!r}")
    own = {f.name for f in fields(Setup)}
    setup = Setup(**{k: v for k, v in given.items() if k in own})
    for key, names in (("coding", CODINGS), ("seeding", _SEEDINGS)):
        value = getattr(setup, key)
        if value and value not in names:
            raise ValueError(f"option {key}: '{value}' is none of {', '.join(names)}")
    if not 0 <= setup.points <= 100:
        raise ValueError(f"option points: must be between 0 and 100, not {setup.points}")
    return setup, rule.Options(**{k: v for k, v in given.items() if k not in own})


class PopulationPlanner:
    """A planner that searches with a rule; it implements `simloop.planners.protocol.Planner`."""

    def __init__(self, rule: type[Rule], config: PlannerConfig, vehicle: VehicleConfig) -> None:
        self._rule, self._config, self.name = rule, config, rule.name
        self._setup, self._options = read_options(rule, dict(config.options))
        self._overhang = max(vehicle.footprint_offsets_m)

    def plan(self, task: PlanningTask, rng: np.random.Generator) -> Plan:
        """Plan a path for a task.

        A seeded first population contains the remaining part of the previous plan. Rules with a
        uniform first population, as in the papers, ignore the previous plan.

        Args:
            task: The task.
            rng: The only source of randomness; one number is drawn.

        Returns:
            The plan, with its history, and some of the last population as its candidates.
        """
        problem = problem_of(self._config, self._overhang, task)
        population, objective, generations = self._search(problem, rng, task.previous)
        path = objective.path(population.best_x)
        if math.dist(task.start[:2], task.goal) < _HERE_M:
            path = np.array([task.start[:2], task.goal], dtype=np.float64)
        shown = np.argsort(population.exact_costs(), kind="mergesort")[:_SHOWN]
        return account(
            self.name,
            task,
            problem,
            path,
            evaluations=population.spent,
            generations=generations,
            candidates_m=tuple(objective.path(population.x[k]) for k in shown),
            history=np.array(population.history, dtype=np.float64).reshape(-1, 2),
        )

    def _search(
        self, problem: Problem, rng: np.random.Generator, previous: Plan | None
    ) -> tuple[Population, PathObjective, int]:
        """Search; return the last population, its objective, and the number of generations."""
        config, setup, rule = self._config, self._setup, self._rule(self._options)
        coding = make_coding(problem, setup.coding or rule.coding, setup.points or rule.points)
        objective = PathObjective(problem, coding, rule.examined)
        state = make_state(rng)
        population = Population(
            objective, config.learners, config.max_evaluations, state, reflect=rule.reflect
        )
        first = None
        if (setup.seeding or rule.seeding) == "seeded":
            first = seeded(problem, coding, config.learners, state)
            old_way = way_ahead(problem, previous)
            if old_way is not None:
                first[-1] = encode(problem, coding, old_way)
            # The trials of the route search count, but the budget covers at least one population.
            most = max(0, config.max_evaluations - config.learners)
            population.spent = min(int(problem.trials[0]), most)
        generations = minimise(rule, population, first, idle=config.idle_generations)
        return population, objective, generations
