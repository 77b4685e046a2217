"""The planners: one protocol, many methods, each chosen by name."""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any

_CLASSES = {
    "tlbo": "simloop.tlbo_planner:TlboPlanner",
    "tlbo_paper": "simloop.planners.rule_tlbo:TlboPaper",
    "tlbo_elitist": "simloop.planners.rule_tlbo:TlboElitist",
    "niwtlbo": "simloop.planners.rule_tlbo:Niwtlbo",
    "ga": "simloop.planners.rule_genetic:GeneticAlgorithm",
    "pso": "simloop.planners.rule_swarm:ParticleSwarm",
    "ga_pso": "simloop.planners.rule_genetic:GaPso",
    "abc": "simloop.planners.rule_evolution:BeeColony",
    "de": "simloop.planners.rule_evolution:DifferentialEvolution",
    "avoa": "simloop.planners.rule_avoa:AfricanVultures",
    "apso": "simloop.planners.rule_swarm:AdaptiveSwarm",
}
"""Name -> module:class, of a planner or of an update rule (`simloop.planners.population.Rule`)."""


def available() -> tuple[str, ...]:
    """The names that ``planner.name`` may have."""
    return tuple(_CLASSES)


def load(name: str) -> Any:
    """The class behind a name, imported only now. Raises KeyError for an unknown name."""
    module, _, attribute = _CLASSES[name].partition(":")
    return getattr(importlib.import_module(module), attribute)


def planner_class(name: str) -> Any:
    """What makes a planner of a config and a vehicle. Raises KeyError for an unknown name."""
    found = load(name)
    if hasattr(found, "generation"):
        from simloop.planners.population_planner import PopulationPlanner

        return partial(PopulationPlanner, found)
    return found


def check_options(name: str, options: dict[str, Any]) -> None:
    """Refuse options that a planner does not know: a one-line ValueError with the choices."""
    found = load(name)
    if hasattr(found, "generation"):
        from simloop.planners.population_planner import read_options

        read_options(found, options)
    elif hasattr(found, "check_options"):
        found.check_options(options)
    elif options:
        raise ValueError(f"planner {name} has no options")


def summary(name: str) -> str:
    """One line about a planner."""
    return str(getattr(load(name), "summary", ""))
