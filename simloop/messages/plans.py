"""What the robot plans in, and what comes of it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

import numpy as np
from numpy.typing import NDArray

from simloop.messages.base import BaseMessage, FloatArray
from simloop.messages.beliefs import MoverTracks


@dataclass(frozen=True, slots=True, eq=False)
class WorldView(BaseMessage):
    """What a planner may know of the world, all of it from the robot's own map.

    What lies outside the grid is unknown, and each user says how it reads it. The planners, the
    smoother and the elastic band take the distance of the nearest place inside ("edge" in
    `simloop.geometry.distance_field`): a wall that reaches the border goes on outside.
    `navigation.planner_world.with_free_rim` adds free space about the grid where that leaves no
    way.
    The check whether a goal can be reached at all (`navigation.feasibility`) takes it for free.
    Unknown cells inside the grid are free for all.

    Attributes:
        t_ns: Simulated time, ns.
        origin_m: (2,) lower left corner of cell (0, 0), in map, m.
        resolution_m: Side of a cell, m.
        distance_m: (rows, cols) float32 [iy, ix], distance from a cell's centre to the nearest
            occupied cell's surface, m; (0, 0) if there is no grid.
        discs_xyr_m: (K, 3) x, y, radius of obstacles as discs, in map, m.
        bounds_m: (4,) x_min, y_min, x_max, y_max of the space in which waypoints may lie, m.
        polygons_m: Corners (N, 2) of convex obstacles, in map, m.
        movers: What moves, which is in none of the others; None where nothing is known to.
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
    """A planner's answer to a task: a polyline and what it costs.

    Attributes:
        t_ns: Simulated time of the view that was planned in, ns.
        waypoints_m: (M, 2) from the start to the goal, in map, m.
        cost: J of the whole polyline as the planner minimises it: length, turning, the turn at
            the start and, where clearance is lacking, its penalty.
        length_m: Length, m.
        turning_rad: Sum of the turns at the inner waypoints, rad.
        safe: Whether the polyline keeps ``safe_distance_m`` all along (near a start that is too
            close to something, as much of it as the start allows).
        evaluations: How many paths and single segments were tried.
        generations: How many generations a population went through.
        planner: Name of the planner.
        reason: Why the plan was asked for.
        candidates_m: Some paths (., 2) of the final population, to look at.
        history: (H, 2) evaluations and the best J from then on, one row for each gain; empty if
            the planner keeps none.
        safe_distance_m: Distance from obstacles that the plan was asked to keep, m.
        start_turn_cost: What the turn from the robot's heading to the first segment adds to
            ``cost``.
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
        """J without the turn at the start: what it costs whichever way the robot faces now."""
        return self.cost - self.start_turn_cost


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPath(BaseMessage):
    """A densely sampled path in map whose curvature is continuous.

    Attributes:
        t_ns: Simulated time of the plan's view, ns.
        xy_m: (K, 2) places of base_link, m.
        yaw_rad: (K,) headings, unwrapped, rad.
        curvature_1pm: (K,) signed curvature, left positive, 1/m.
        arc_m: (K,) length from the start, m.
        clearance_m: (K,) least distance from any of the footprint's disc centres to an obstacle,
            m.
        safe: Whether the footprint's discs keep the plan's safe distance at every sample, to
            1 mm. Near a start that is too close to something less is asked for, as of the plan.
    """

    t_ns: int
    xy_m: FloatArray
    yaw_rad: FloatArray
    curvature_1pm: FloatArray
    arc_m: FloatArray
    clearance_m: FloatArray
    safe: bool
