"""Planners by name."""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any

from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.protocol import Planner

_CLASSES = {
    "tlbo": (
        "simloop.tlbo_planner:TlboPlanner",
        "the lead planner: routes, then TLBO of the lines of the path",
    ),
    "tlbo_paper": (
        "simloop.planners.metaheuristics.rule_tlbo:TlboPaper",
        "TLBO exactly as the 2022 papers print it, defects included",
    ),
    "tlbo_elitist": (
        "simloop.planners.metaheuristics.rule_tlbo:TlboElitist",
        "elitist TLBO (Rao & Patel 2012): elites kept, duplicates mutated",
    ),
    "niwtlbo": (
        "simloop.planners.metaheuristics.rule_tlbo:Niwtlbo",
        "nonlinear inertia weighted TLBO on cross lines (Wu 2016)",
    ),
    "ga": (
        "simloop.planners.metaheuristics.rule_genetic:GeneticAlgorithm",
        "genetic algorithm: tournament, SBX, polynomial mutation, (mu + mu)",
    ),
    "pso": (
        "simloop.planners.metaheuristics.rule_swarm:ParticleSwarm",
        "particle swarm, global best (Clerc & Kennedy 2002)",
    ),
    "ga_pso": (
        "simloop.planners.metaheuristics.rule_genetic:GaPso",
        "hybrid GA-PSO (Juang 2004): the better half flies, the rest is bred from it",
    ),
    "abc": (
        "simloop.planners.metaheuristics.rule_evolution:BeeColony",
        "artificial bee colony (Karaboga & Basturk 2007)",
    ),
    "de": (
        "simloop.planners.metaheuristics.rule_evolution:DifferentialEvolution",
        "differential evolution, DE/rand/1/bin (Storn & Price 1997)",
    ),
    "avoa": (
        "simloop.planners.metaheuristics.rule_avoa:AfricanVultures",
        "African vultures optimisation (Abdollahzadeh et al. 2021)",
    ),
    "apso": (
        "simloop.planners.metaheuristics.rule_swarm:AdaptiveSwarm",
        "adaptive particle swarm (Zhan et al. 2009)",
    ),
    "potential_field": (
        "simloop.planners.reactive.potential_field:PotentialField",
        "the plain artificial potential field, local minima included",
    ),
    "ga_apf": (
        "simloop.planners.reactive.ga_apf:GaApf",
        "potential field deformed by a genetic algorithm (Mohamed 2012)",
    ),
    "wdo": (
        "simloop.planners.metaheuristics.rule_wdo:WindDriven",
        "wind driven optimisation (Bayraktar et al. 2013)",
    ),
    "avoa_online": (
        "simloop.planners.reactive.avoa_online:AvoaOnline",
        "step by step from what is sensed, each heading by AVOA (Abed 2022)",
    ),
    "apso_online": (
        "simloop.planners.reactive.avoa_online:ApsoOnline",
        "the same, each heading by the adaptive swarm",
    ),
    "fuzzy_wdo": (
        "simloop.planners.reactive.avoa_online:FuzzyWdo",
        "the same by a fuzzy controller, tuned by wind driven optimisation",
    ),
    "exact": (
        "simloop.planners.reference.ref_exact:Exact",
        "the exact optimum among discs (tangent graph), the yardstick",
    ),
    "visibility": (
        "simloop.planners.reference.ref_visibility:VisibilityGraph",
        "visibility graph among polygons and discs",
    ),
    "astar": (
        "simloop.planners.reference.ref_grid:GridAStar",
        "A* on an eight-neighbour lattice: shortest along its edges",
    ),
    "theta_star": (
        "simloop.planners.reference.ref_grid:ThetaStar",
        "Theta* on the same lattice: any angle (Nash et al. 2007)",
    ),
    "cma": (
        "simloop.planners.reference.ref_cma:CmaEs",
        "CMA-ES with restarts (Hansen 2016); needs the extra 'references'",
    ),
    "informed_rrt_star": (
        "simloop.planners.reference.ref_ompl:InformedRrtStar",
        "OMPL's Informed RRT* (Gammell 2014); needs the extra 'references'",
    ),
    "bit_star": (
        "simloop.planners.reference.ref_ompl:BitStar",
        "OMPL's BIT* (Gammell 2015); needs the extra 'references'",
    ),
}
"""Name -> module:class, of a planner or an update rule (`population.Rule`), and what it is."""


def available() -> tuple[str, ...]:
    """The names that ``planner.name`` may have."""
    return tuple(_CLASSES)


def load(name: str) -> Any:
    """The class behind a name, imported only now. Raises KeyError for an unknown name."""
    module, _, attribute = _CLASSES[name][0].partition(":")
    return getattr(importlib.import_module(module), attribute)


def planner_class(name: str) -> Any:
    """What makes a planner of a config and a vehicle. Raises KeyError for an unknown name."""
    found = load(name)
    if hasattr(found, "generation"):
        from simloop.planners.metaheuristics.population_planner import PopulationPlanner

        return partial(PopulationPlanner, found)
    return found


def check_options(name: str, options: dict[str, Any]) -> None:
    """Refuse options that a planner does not know: a one-line ValueError with the choices."""
    found = load(name)
    if hasattr(found, "generation"):
        from simloop.planners.metaheuristics.population_planner import read_options

        read_options(found, options)
    elif hasattr(found, "check_options"):
        found.check_options(options)
    elif options:
        raise ValueError(f"planner {name} has no options")


def invariance(name: str) -> tuple[str, ...]:
    """Changes of the world (shift, rotate, mirror, scale) under which a planner's results agree."""
    claimed: tuple[str, ...] = getattr(load(name), "invariant", ())
    return claimed


def summary(name: str) -> str:
    """One line about a planner."""
    return _CLASSES[name][1]


def planner_names() -> list[str]:
    """The names that `make_planner` knows, sorted."""
    return sorted(available())


def make_planner(config: PlannerConfig, vehicle: VehicleConfig) -> Planner:
    """The planner that ``config.name`` asks for; raises ValueError that lists the names."""
    if config.name not in available():
        known = ", ".join(planner_names())
        raise ValueError(f"unknown planner {config.name!r}; choose from {known}")
    planner: Planner = planner_class(config.name)(config, vehicle)
    return planner
