"""Simulation of a point robot in a world that it knows only by sensing.

Source: Abed 2022, Section 3: unknown fixed obstacles, moving obstacles, a moving goal. The fixed
part is anything that a `WorldView` can hold (discs, convex polygons, a distance field). Movers are
discs that go to and fro on a polyline; a moving goal does the same. Neither reacts to the robot. A
mover is sensed while any part of it is in range and no fixed obstacle lies in front of its centre.
The robot estimates its velocity from the last two positions at which it sensed it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem, make_problem, point_clearance
from simloop.planners.reactive.sensing import BEAMS, LocalView, cast_ray, scan
from simloop.planners.reactive.stepper import Steering, Stepper
from simloop.planners.splitmix import make_state

_MARGIN_SHARE, _MARGIN_CELLS = 1.03, 0.2
_SUBSTEPS = 8


@dataclass(frozen=True, slots=True, eq=False)
class MovingPoint:
    """A point that moves to and fro along a polyline at a constant speed.

    Attributes:
        points_m: (n, 2) corners of the polyline, m, map frame; one point if it is at rest.
        speed_m: Distance covered in one step, m.
    """

    points_m: FloatArray
    speed_m: float = 0.0

    def at(self, step: float) -> FloatArray:
        """Compute the position after some steps.

        Args:
            step: Number of steps since the start; fractions are allowed.

        Returns:
            (2,) position, m, map frame.
        """
        points = np.asarray(self.points_m, dtype=np.float64).reshape(-1, 2)
        legs = np.hypot(*np.diff(points, axis=0).T)
        total = float(legs.sum())
        if total <= 0.0 or self.speed_m <= 0.0:
            return points[0]
        s = (step * self.speed_m) % (2.0 * total)
        s = 2.0 * total - s if s > total else s
        arc = np.concatenate([[0.0], np.cumsum(legs)])
        return np.array([np.interp(s, arc, points[:, i]) for i in range(2)])


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A disc that moves.

    Attributes:
        track: Motion of its centre.
        radius_m: Radius, m.
    """

    track: MovingPoint
    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class OnlineWorld:
    """A world to cross step by step, with the robot's data.

    Attributes:
        name: Name of the scene.
        fixed: Fixed obstacles and the bounds.
        start: (3,) robot's first pose x, y, yaw, m and rad, map frame; yaw is not used.
        goal: Motion of the goal.
        movers: Moving obstacles.
        radius_m: Robot's radius, m.
        safe_m: Distance of its centre from all obstacles, m; at least ``radius_m``.
        step_m: Length of one step, m.
        reach_m: Range of its sensor, m.
        most_steps: The run ends after this many steps.
    """

    name: str
    fixed: WorldView
    start: FloatArray
    goal: MovingPoint
    movers: tuple[Mover, ...] = ()
    radius_m: float = 0.5
    safe_m: float = 0.6
    step_m: float = 0.5
    reach_m: float = 8.0
    most_steps: int = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """The result of one run.

    Attributes:
        points_m: (steps + 1, 2) robot's positions, m, map frame.
        reached: Whether the robot is at the goal at the end.
        collisions: Number of steps in which the robot's disc touched an obstacle.
        clearance_m: Least distance of its centre from any surface, m.
        evaluations: Headings (or controllers) evaluated.
    """

    points_m: FloatArray
    reached: bool
    collisions: int
    clearance_m: float
    evaluations: int

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.points_m) - 1

    @property
    def length_m(self) -> float:
        """Length of the path, m."""
        return float(np.hypot(*np.diff(self.points_m, axis=0).T).sum())

    @property
    def success(self) -> bool:
        """Whether the robot reached the goal without touching an obstacle."""
        return self.reached and self.collisions == 0


@dataclass(slots=True)
class RangeSensor:
    """Senses fixed surfaces and movers, and stores where it last sensed each mover.

    Attributes:
        problem: The problem with the fixed obstacles.
        reach_m: Range, m.
        box: (4,) x_min, y_min, x_max, y_max that the robot's centre stays in, m, map frame.
        safe_m: Distance of the outer walls from the box, m.
        last_seen: Number of a mover -> step and position (2,), m, of its last detection.
    """

    problem: Problem
    reach_m: float
    box: FloatArray
    safe_m: float
    last_seen: dict[int, tuple[int, FloatArray]] = field(default_factory=dict)
    _points: FloatArray = field(default_factory=lambda: np.zeros((BEAMS, 2)))

    def points(self, x: float, y: float) -> FloatArray:
        """Compute the points on fixed surfaces that the beams hit.

        Args:
            x: x of the sensor, m, map frame.
            y: y of the sensor, m, map frame.

        Returns:
            (n, 2) points, m, map frame.
        """
        count = scan(self.problem, x, y, self.reach_m, self.box, self.safe_m, self._points)
        return self._points[:count].copy()

    def movers(self, x: float, y: float, movers: Sequence[Mover], step: int) -> FloatArray:
        """Return the visible movers, with estimated velocities.

        Args:
            x: x of the sensor, m, map frame.
            y: y of the sensor, m, map frame.
            movers: All movers of the world.
            step: Number of the present step.

        Returns:
            (k, 5) x, y, radius, m, and vx, vy, m per step, map frame.
        """
        rows = []
        for number, mover in enumerate(movers):
            where = mover.track.at(step)
            apart = math.hypot(where[0] - x, where[1] - y)
            if apart - mover.radius_m > self.reach_m:
                continue
            if apart > mover.radius_m:
                ux, uy = (where[0] - x) / apart, (where[1] - y) / apart
                if cast_ray(self.problem, x, y, ux, uy, apart) < apart - mover.radius_m:
                    continue
            then, there = self.last_seen.get(number, (step, where))
            velocity = (where - there) / max(1, step - then)
            self.last_seen[number] = step, where
            rows.append([*where, mover.radius_m, *velocity])
        return np.array(rows).reshape(-1, 5)


def padded_safe_distance(p: Problem) -> float:
    """Compute the distance that a stepping robot keeps from the points that it senses.

    It is a little more than the safe distance for three reasons: there are gaps between the beams,
    the path is simplified afterwards, and the surfaces in a field are known to a fifth of a cell.

    Args:
        p: The planning problem.

    Returns:
        Distance, m.
    """
    grain = _MARGIN_CELLS / p.per_m if p.field.size else 0.0
    return _MARGIN_SHARE * p.safe_m + grain


def motion_box(problem: Problem) -> FloatArray:
    """Compute the box that the robot's centre stays in: the bounds, extended to start and goal.

    Args:
        problem: The planning problem.

    Returns:
        (4,) x_min, y_min, x_max, y_max, m, map frame.
    """
    x = sorted((problem.start_x, problem.goal_x))
    y = sorted((problem.start_y, problem.goal_y))
    return np.array([
        min(problem.low_x, x[0]), min(problem.low_y, y[0]),
        max(problem.high_x, x[1]), max(problem.high_y, y[1]),
    ])  # fmt: skip


def simulate(world: OnlineWorld, steering: Steering, rng: np.random.Generator) -> Trajectory:
    """Simulate a robot in a world that it does not know, up to the goal or the last step.

    Args:
        world: The world and the robot's data.
        steering: Chooses the headings.
        rng: Source of all randomness.

    Returns:
        The robot's trajectory and how it ended.
    """
    goal = world.goal.at(0)
    problem = make_problem(world.fixed, world.start, goal, safe_m=world.safe_m)
    box, safe_m = motion_box(problem), padded_safe_distance(problem)
    sensor = RangeSensor(problem, world.reach_m, box, safe_m)
    heading = math.atan2(goal[1] - world.start[1], goal[0] - world.start[0])
    stepper = Stepper(steering, make_state(rng), heading)
    here = np.array(world.start[:2], dtype=np.float64)
    path, collisions, least, reached = [here], 0, np.inf, False
    for step in range(world.most_steps):
        goal = world.goal.at(step)
        (x, y), (goal_x, goal_y) = here, goal
        view = LocalView(
            sensor.points(x, y), sensor.movers(x, y, world.movers, step),
            x, y, goal_x, goal_y, safe_m, world.step_m, world.reach_m, box,
        )  # fmt: skip
        there = stepper.step(view, goal)
        clear = _clearance_during(world, problem, here, there, step)
        collisions += clear < world.radius_m
        least, here = min(least, clear), there
        path.append(here)
        # The goal may move during the step: half a step from its new position is close enough.
        if math.dist(here, world.goal.at(step + 1)) <= 0.5 * world.step_m:
            reached = True
            break
    return Trajectory(np.array(path), reached, collisions, least, stepper.evaluations)


def _clearance_during(
    world: OnlineWorld, problem: Problem, a: FloatArray, b: FloatArray, step: int
) -> float:
    """Compute the least distance of the robot's centre from any surface on its way a to b, m."""
    least = np.inf
    for share in np.linspace(0.0, 1.0, _SUBSTEPS + 1):
        x, y = a + share * (b - a)
        least = min(least, float(point_clearance(problem, x, y)))
        for mover in world.movers:
            least = min(least, math.dist((x, y), mover.track.at(step + share)) - mover.radius_m)
    return least
