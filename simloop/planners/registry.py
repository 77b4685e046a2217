"""Planners by name."""

from __future__ import annotations

from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners import available, planner_class
from simloop.planners.protocol import Planner


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
