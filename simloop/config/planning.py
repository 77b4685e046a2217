"""Settings of the planner and of the path smoother."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    Length,
    NonNegative,
    Positive,
)


@dataclass(frozen=True, slots=True, config=STRICT)
class PlannerConfig:
    """Sabiha 2022: J = w1 S + w2 Theta + sigma sum R; class of 100; 30 idle generations end it.

    squeeze_m: what may be given up of the safety distance where that saves a long way round.
    prefer_m: what a way has over it that is taken where it costs no more than prefer_share more.
    options: of the planner named, see `simloop.planners`.
    """

    name: str = "tlbo"
    length_weight: NonNegative = 0.65
    turning_weight: NonNegative = 0.35
    start_turn_weight: NonNegative = 0.1
    penalty: Positive = 60.0
    learners: Annotated[int, Field(ge=4, le=10_000)] = 100
    idle_generations: Annotated[int, Field(ge=1, le=10_000)] = 30
    max_evaluations: Annotated[int, Field(ge=100, le=10**8)] = 40_000
    safe_distance_m: Annotated[float, Field(ge=0.06, le=5.0)] = 0.26
    squeeze_m: Annotated[float, Field(ge=0.0, lt=0.05)] = 0.008
    prefer_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    prefer_share: NonNegative = 0.05
    precise: bool = False
    latency: Literal["fixed", "per_evaluation"] = "fixed"
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True, config=STRICT)
class SmootherConfig:
    """Bezier corners; the lead-in takes the path from the robot's heading to the plan's.

    extra_room_m: what the path keeps over the safety distance where there is room for it.
    """

    spacing_m: Annotated[float, Field(ge=0.001, le=1.0)] = 0.02
    max_cut_m: Length = 0.6
    min_cut_m: Length = 0.01
    extra_room_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.04
    lead_in_m: Length = 0.25
    lead_in_max_turn_rad: NonNegative = 1.0
    lead_in_max_turn_with_camera_rad: NonNegative = 0.3
