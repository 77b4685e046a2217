"""The view in which the robot plans, and the resulting plan and path."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

import numpy as np
from numpy.typing import NDArray

from simloop.messages.base import BaseMessage, FloatArray
from simloop.messages.beliefs import MoverTracks


@dataclass(frozen=True, slots=True, eq=False)
class WorldView(BaseMessage):
    """All that a planner may know of the world. All of it comes from the robot's own map.

    Places outside the grid are unknown. Each user defines how to treat them. The planners, the
    smoother and the elastic band use the distance of the nearest place inside ("edge" in
    `simloop.geometry.distance_field`): a wall that reaches the border continues outside.
    `navigation.planner_world.with_free_rim` adds free space around the grid if no path is left
    otherwise. The check whether a goal can be reached at all (`navigation.feasibility`) treats
    places outside as free. All users treat unknown cells inside the grid as free.

    Attributes:
        t_ns: Simulated time, ns.
        origin_m: (2,) lower left corner of cell (0, 0), in map, m.
        resolution_m: Size of a cell, m.
        distance_m: (rows, cols) float32 [iy, ix], distance from a cell's centre to the nearest
            occupied cell's surface, m; (0, 0) if there is no grid.
        discs_xyr_m: (K, 3) x, y, radius of obstacles as discs, in map, m.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the space in which waypoints may lie, m.
        polygons_m: Corners (N, 2) of convex obstacles, in map, m.
        movers: Moving obstacles, which are in none of the others; None if none are known.
    """

    t_ns: int
    origin_m: FloatArray
    resolution_m: float
    distance_m: NDArray[np.float32]
    discs_xyr_m: FloatArray
    bounds_m: FloatArray
    polygons_m: tuple[FloatArray, ...] = ()
    movers: MoverTracks | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Plan(BaseMessage):
    """A planner's answer to a task: a polyline and its cost.

    Attributes:
        t_ns: Simulated time of the planner's view, ns.
        waypoints_m: (M, 2) from the start to the goal, in map, m.
        cost: J of the whole polyline as the planner minimises it: length, turning, the turn at
            the start and, if there is too little clearance, its penalty.
        length_m: Length, m.
        turning_rad: Sum of the turns at the inner waypoints, rad.
        safe: Whether the whole polyline keeps ``safe_distance_m`` (near a start that is too close
            to an obstacle, as much of it as the start allows).
        evaluations: Number of paths and single segments that were evaluated.
        generations: Number of generations of a population.
        planner: Name of the planner.
        reason: Why the plan was requested.
        candidates_m: Some paths (., 2) of the final population, for display.
        history: (H, 2) evaluations and the best J from then on, one row for each improvement;
            empty if the planner keeps none.
        safe_distance_m: Distance from obstacles that the plan had to keep, m.
        start_turn_cost: Part of ``cost`` for the turn from the robot's heading to the first
            segment.
    """

    t_ns: int
    waypoints_m: FloatArray
    cost: float
    length_m: float
    turning_rad: float
    safe: bool
    evaluations: int
    generations: int
    planner: str
    reason: str = "frame"
    candidates_m: tuple[FloatArray, ...] = ()
    history: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    _: KW_ONLY
    safe_distance_m: float
    start_turn_cost: float = 0.0

    @property
    def path_cost(self) -> float:
        """J without the turn at the start. It does not depend on the robot's present heading."""
        return self.cost - self.start_turn_cost


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath(BaseMessage):
    """A densely sampled path in map with continuous curvature.

    Attributes:
        t_ns: Simulated time of the plan's view, ns.
        xy_m: (K, 2) positions of base_link, m.
        yaw_rad: (K,) headings, unwrapped, rad.
        curvature_1pm: (K,) signed curvature, left positive, 1/m.
        arc_m: (K,) length from the start, m.
        clearance_m: (K,) least distance from any of the footprint's disc centres to an obstacle,
            m.
        safe: Whether the footprint's discs keep the plan's safe distance at every sample, to
            1 mm. Near a start that is too close to an obstacle less is required, as for the plan.
    """

    t_ns: int
    xy_m: FloatArray
    yaw_rad: FloatArray
    curvature_1pm: FloatArray
    arc_m: FloatArray
    clearance_m: FloatArray
    safe: bool
