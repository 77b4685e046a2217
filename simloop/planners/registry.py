"""Registry of the planners: their names and properties.

A planner's module is imported only when the planner is made, so listing the planners is quick.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.protocol import Planner, WorldKind

_ALL_WORLDS = tuple(WorldKind)
_ALL_CHANGES = ("shift", "rotate", "mirror", "scale")
_NOT_TURNED = ("shift", "mirror", "scale")
"""Invariances of rules that treat x and y separately."""
_RULES = "simloop.planners.metaheuristics"
_REACTIVE = "simloop.planners.reactive"
_REFERENCE = "simloop.planners.reference"


@dataclass(frozen=True, slots=True)
class PlannerInfo:
    """Properties of a planner that are known without importing it.

    Attributes:
        name: Value of ``planner.name`` that selects it.
        factory: ``module:Class``. The class takes (PlannerConfig, VehicleConfig). The class of an
            update rule is wrapped by `population_planner.PopulationPlanner`.
        summary: One-line description.
        worlds: The kinds of world that it can plan in. In a distance field, a planner that needs
            discs uses the view's discs instead.
        stochastic: Whether another seed may give another plan.
        stepwise: Whether it walks step by step and can therefore be tested among moving obstacles;
            it then has a method ``steering()``.
        update_rule: Whether the class is an update rule (`population.Rule`), not a planner.
        metaheuristic: Whether it searches with a population of whole paths.
        slow: Whether one plan may take seconds.
        options: The allowed keys of ``[planner.options]``; every update rule also takes those of
            `population_planner.Setup`.
        invariances: Changes of the world (shift, rotate, mirror, scale) that do not change its
            results; a test checks them.
    """

    name: str
    factory: str
    summary: str
    worlds: tuple[WorldKind, ...] = _ALL_WORLDS
    stochastic: bool = True
    stepwise: bool = False
    update_rule: bool = False
    metaheuristic: bool = False
    slow: bool = False
    options: tuple[str, ...] = ()
    invariances: tuple[str, ...] = ()


def _rule(
    name: str,
    factory: str,
    summary: str,
    *options: str,
    invariances: tuple[str, ...] = _NOT_TURNED,
) -> PlannerInfo:
    """Make the entry of an update rule in the folder of the metaheuristics."""
    return PlannerInfo(
        name,
        f"{_RULES}.{factory}",
        summary,
        update_rule=True,
        metaheuristic=True,
        options=options,
        invariances=invariances,
    )


_PLANNERS = (
    PlannerInfo(
        "tlbo",
        "simloop.tlbo_planner:TlboPlanner",
        "the lead planner: routes, then TLBO of the lines of the path",
        metaheuristic=True,
        invariances=_ALL_CHANGES,
    ),
    _rule(
        "tlbo_paper",
        "rule_tlbo:TlboPaper",
        "TLBO exactly as the 2022 papers print it, defects included",
        "examined",
        invariances=(),
    ),
    _rule(
        "tlbo_elitist",
        "rule_tlbo:TlboElitist",
        "elitist TLBO (Rao & Patel 2012): elites kept, duplicates mutated",
        "elites",
        invariances=(),
    ),
    _rule(
        "niwtlbo",
        "rule_tlbo:Niwtlbo",
        "nonlinear inertia weighted TLBO on cross lines (Wu 2016)",
        "w_min",
        invariances=_ALL_CHANGES,
    ),
    _rule(
        "ga",
        "rule_genetic:GeneticAlgorithm",
        "genetic algorithm: tournament, SBX, polynomial mutation, (mu + mu)",
        "crossover",
        "crossover_index",
        "mutation_index",
    ),
    _rule(
        "pso",
        "rule_swarm:ParticleSwarm",
        "particle swarm, global best (Clerc & Kennedy 2002)",
        "inertia",
        "own",
        "social",
        "speed_limit",
    ),
    _rule(
        "ga_pso",
        "rule_genetic:GaPso",
        "hybrid GA-PSO (Juang 2004): the better half flies, the rest is bred from it",
        "crossover",
        "crossover_index",
        "mutation_index",
        "inertia",
        "own",
        "social",
        "speed_limit",
    ),
    _rule(
        "abc",
        "rule_evolution:BeeColony",
        "artificial bee colony (Karaboga & Basturk 2007)",
        "limit",
    ),
    _rule(
        "de",
        "rule_evolution:DifferentialEvolution",
        "differential evolution, DE/rand/1/bin (Storn & Price 1997)",
        "factor",
        "crossover",
    ),
    _rule(
        "avoa",
        "rule_avoa:AfricanVultures",
        "African vultures optimisation (Abdollahzadeh et al. 2021)",
        "p1",
        "p2",
        "p3",
        "first",
        "gamma",
        "levy_step",
        invariances=(),
    ),
    _rule(
        "apso",
        "rule_swarm:AdaptiveSwarm",
        "adaptive particle swarm (Zhan et al. 2009)",
        "speed_limit",
        "learn_high",
        "learn_low",
    ),
    PlannerInfo(
        "potential_field",
        f"{_REACTIVE}.potential_field:PotentialField",
        "the plain artificial potential field, local minima included",
        stochastic=False,
        invariances=_ALL_CHANGES,
    ),
    PlannerInfo(
        "ga_apf",
        f"{_REACTIVE}.ga_apf:GaApf",
        "potential field deformed by a genetic algorithm (Mohamed 2012)",
        metaheuristic=True,
        slow=True,
        invariances=_ALL_CHANGES,
    ),
    _rule(
        "wdo",
        "rule_wdo:WindDriven",
        "wind driven optimisation (Bayraktar et al. 2013)",
        "friction",
        "gravity",
        "gas",
        "coriolis",
        "speed_limit",
    ),
    PlannerInfo(
        "avoa_online",
        f"{_REACTIVE}.avoa_online:AvoaOnline",
        "step by step from what is sensed, each heading by AVOA (Abed 2022)",
        stepwise=True,
        slow=True,
        invariances=_ALL_CHANGES,
    ),
    PlannerInfo(
        "apso_online",
        f"{_REACTIVE}.avoa_online:ApsoOnline",
        "step by step from what is sensed, each heading by the adaptive swarm",
        stepwise=True,
        slow=True,
        invariances=_ALL_CHANGES,
    ),
    PlannerInfo(
        "fuzzy_wdo",
        f"{_REACTIVE}.avoa_online:FuzzyWdo",
        "step by step, by a fuzzy controller tuned by wind driven optimisation",
        stepwise=True,
        slow=True,
        invariances=("shift", "rotate", "scale"),  # its rules turn left when nothing else decides
    ),
    PlannerInfo(
        "exact",
        f"{_REFERENCE}.ref_exact:Exact",
        "the exact optimum among discs (tangent graph), the yardstick",
        worlds=(WorldKind.DISCS,),
        stochastic=False,
    ),
    PlannerInfo(
        "visibility",
        f"{_REFERENCE}.ref_visibility:VisibilityGraph",
        "visibility graph among polygons and discs",
        worlds=(WorldKind.DISCS, WorldKind.POLYGONS),
        stochastic=False,
    ),
    PlannerInfo(
        "astar",
        f"{_REFERENCE}.ref_grid:GridAStar",
        "A* on an eight-neighbour lattice: shortest along its edges",
        stochastic=False,
    ),
    PlannerInfo(
        "theta_star",
        f"{_REFERENCE}.ref_grid:ThetaStar",
        "Theta* on the same lattice: any angle (Nash et al. 2007)",
        stochastic=False,
    ),
    PlannerInfo(
        "cma",
        f"{_REFERENCE}.ref_cma:CmaEs",
        "CMA-ES with restarts (Hansen 2016); needs the extra 'references'",
        metaheuristic=True,
    ),
    PlannerInfo(
        "informed_rrt_star",
        f"{_REFERENCE}.ref_ompl:InformedRrtStar",
        "OMPL's Informed RRT* (Gammell 2014); needs the extra 'references'",
    ),
    PlannerInfo(
        "bit_star",
        f"{_REFERENCE}.ref_ompl:BitStar",
        "OMPL's BIT* (Gammell 2015); needs the extra 'references'",
    ),
)
_BY_NAME = MappingProxyType({planner.name: planner for planner in _PLANNERS})


def available() -> tuple[str, ...]:
    """List the planners.

    Returns:
        The names that ``planner.name`` may have.
    """
    return tuple(_BY_NAME)


def info(name: str) -> PlannerInfo:
    """Return the properties of a planner.

    Args:
        name: One of `available`.

    Returns:
        Its entry in the registry.

    Raises:
        ValueError: If no planner has that name; the message lists the names.
    """
    if name not in _BY_NAME:
        known = ", ".join(sorted(_BY_NAME))
        raise ValueError(f"unknown planner {name!r}; choose from {known}")
    return _BY_NAME[name]


def load(name: str) -> Any:
    """Import the class of a planner or of an update rule.

    Args:
        name: One of `available`.

    Returns:
        The class that ``info(name).factory`` names.

    Raises:
        ValueError: If no planner has that name.
    """
    module, _, attribute = info(name).factory.partition(":")
    return getattr(importlib.import_module(module), attribute)


def check_options(name: str, options: dict[str, Any]) -> None:
    """Check the options of a planner: unknown keys and invalid values are errors.

    Args:
        name: One of `available`.
        options: The keys and values of ``[planner.options]``.

    Raises:
        ValueError: If an option is wrong; the message says which one and what is allowed.
    """
    if info(name).update_rule:
        from simloop.planners.metaheuristics.population_planner import read_options

        read_options(load(name), options)
    elif options:
        raise ValueError(f"planner {name} has no options")


def make_planner(config: PlannerConfig, vehicle: VehicleConfig) -> Planner:
    """Make the planner that a config selects.

    Args:
        config: ``config.name`` selects the planner; the rest are its settings.
        vehicle: The robot's dimensions; planners need its footprint.

    Returns:
        A planner, ready to plan.

    Raises:
        ValueError: If no planner has that name; the message lists the names.
    """
    found = load(config.name)
    if info(config.name).update_rule:
        from simloop.planners.metaheuristics.population_planner import PopulationPlanner

        population_planner: Planner = PopulationPlanner(found, config, vehicle)
        return population_planner
    planner: Planner = found(config, vehicle)
    return planner
