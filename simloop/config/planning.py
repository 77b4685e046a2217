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
    Small,
)

_Int64 = Annotated[int, Field(gt=-(2**63), lt=2**63)]


@dataclass(frozen=True, slots=True, config=STRICT)
class PlannerConfig:
    """The planner's objective and effort (Sabiha 2022).

    J = length_weight S + turning_weight Theta + penalty sum R, with S in metres, Theta in radians
    and R the intrusion into the safety distance in metres.

    Attributes:
        name: Name of the planner, see ``simloop list``.
        length_weight: Weight w1 of the length.
        turning_weight: Weight w2 of the turning.
        start_turn_weight: Weight of the turn from the robot's heading to the first leg.
        penalty: Weight sigma of the intrusion.
        learners: Size of the class (population).
        idle_generations: Generations without improvement that end the search.
        max_evaluations: Evaluations that end the search.
        safe_distance_m: Clearance that the path keeps, m.
        squeeze_m: Part of safe_distance_m that may be given up to avoid a long detour, m.
        prefer_m: Clearance of a wider path in addition to safe_distance_m, m.
        prefer_share: A wider path is selected if its J is at most this share larger.
        precise: Whether to search longer than a frame of the loop allows.
        latency: Model of the planning time: ``latency_s`` for each plan, or ``per_evaluation``.
        latency_s: Simulated time that planning takes, s.
        options: Options of the selected planner, see docs/planners.md.
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
    squeeze_m: Annotated[Small, Field(lt=0.05)] = 0.008
    prefer_m: Annotated[Small, Field(le=1.0)] = 0.02
    prefer_share: NonNegative = 0.05
    precise: bool = False
    latency: Literal["fixed", "per_evaluation"] = "fixed"
    latency_s: Annotated[NonNegative, Field(le=3600.0)] = 0.0
    options: dict[str, bool | _Int64 | float | str] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True, config=STRICT)
class SmootherConfig:
    """The smoother: Bezier corners, and a lead-in from the robot's heading.

    Attributes:
        spacing_m: Distance of the path's samples, m.
        max_cut_m: Largest distance from a corner at which its curve begins, m.
        min_cut_m: Smallest such distance, m.
        extra_room_m: Clearance in addition to the safety distance, where there is room for it, m.
        lead_in_m: Length of the lead-in, m.
        lead_in_max_turn_rad: Largest turn of the lead-in, rad.
        lead_in_max_turn_with_camera_rad: Replaces this limit while the depth camera is enabled, if
            it is smaller, rad.
    """

    spacing_m: Annotated[float, Field(ge=0.001, le=1.0)] = 0.02
    max_cut_m: Length = 0.6
    min_cut_m: Length = 0.01
    extra_room_m: Annotated[Small, Field(le=1.0)] = 0.04
    lead_in_m: Length = 0.25
    lead_in_max_turn_rad: NonNegative = 1.0
    lead_in_max_turn_with_camera_rad: NonNegative = 0.3
