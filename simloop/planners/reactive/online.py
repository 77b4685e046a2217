"""A world that a point robot learns of only by sensing, for the planners that decide step by step.

Source: Abed 2022, Section 3: unknown fixed obstacles, obstacles that move, a goal that moves. What
stands fixed is what a `WorldView` can hold (discs, convex polygons, a distance field). Movers are
discs on a closed polyline, and so is a moving goal; both know nothing of the robot and do not stop
for it. A mover is sensed where any of it is within reach and no fixed obstacle hides its middle;
its velocity is what the robot makes of the last two places at which it saw it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem, make_problem, point_clearance
from simloop.planners.reactive.sensing import BEAMS, Look, cast, scan
from simloop.planners.reactive.walker import Steering, Walker
from simloop.planners.splitmix import make_state

_MARGIN_SHARE, _MARGIN_CELLS = 1.03, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A place that moves to and fro along a polyline (n, 2), m; speed: m a step. One point: at
    rest."""

    points_m: FloatArray
    speed: float = 0.0

    def at(self, step: float) -> FloatArray:
        """Where it is after so many steps, (2,)."""
        points = np.asarray(self.points_m, dtype=np.float64).reshape(-1, 2)
        legs = np.hypot(*np.diff(points, axis=0).T)
        total = float(legs.sum())
        if total <= 0.0 or self.speed <= 0.0:
            return points[0]
        s = (step * self.speed) % (2.0 * total)
        s = 2.0 * total - s if s > total else s
        arc = np.concatenate([[0.0], np.cumsum(legs)])
        return np.array([np.interp(s, arc, points[:, i]) for i in range(2)])


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A disc that moves."""

    track: Track
    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class OnlineWorld:
    """fixed: what does not move, and the bounds. radius_m: the robot's; safe_m: what it shall keep
    of everything (>= radius_m); step_m: what it goes in a step; reach_m: how far it senses."""

    name: str
    fixed: WorldView
    start: FloatArray
    goal: Track
    movers: tuple[Mover, ...] = ()
    radius_m: float = 0.5
    safe_m: float = 0.6
    step_m: float = 0.5
    reach_m: float = 8.0
    most_steps: int = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """points_m: (steps + 1, 2). reached: stood at the goal. collisions: steps in which the robot's
    disc touched something. clearance_m: the least distance of its centre from any surface."""

    points_m: FloatArray
    reached: bool
    collisions: int
    clearance_m: float
    evaluations: int

    @property
    def steps(self) -> int:
        """How many steps it took."""
        return len(self.points_m) - 1

    @property
    def length_m(self) -> float:
        """How long its way was."""
        return float(np.hypot(*np.diff(self.points_m, axis=0).T).sum())

    @property
    def success(self) -> bool:
        """Reached, and nothing touched."""
        return self.reached and self.collisions == 0


@dataclass(slots=True)
class Senses:
    """Casts rays, and remembers where movers were seen last."""

    problem: Problem
    reach_m: float
    box: FloatArray
    safe_m: float
    seen: dict[int, tuple[int, FloatArray]] = field(default_factory=dict)
    _points: FloatArray = field(default_factory=lambda: np.zeros((BEAMS, 2)))

    def points(self, x: float, y: float) -> FloatArray:
        """(n, 2) surfaces that rays meet."""
        count = scan(self.problem, x, y, self.reach_m, self.box, self.safe_m, self._points)
        return self._points[:count].copy()

    def movers(self, x: float, y: float, movers: Sequence[Mover], step: int) -> FloatArray:
        """(k, 5) x, y, radius and estimated velocity of the movers in sight."""
        rows = []
        for number, mover in enumerate(movers):
            where = mover.track.at(step)
            apart = math.hypot(where[0] - x, where[1] - y)
            if apart - mover.radius_m > self.reach_m:
                continue
            if apart > mover.radius_m:
                ux, uy = (where[0] - x) / apart, (where[1] - y) / apart
                if cast(self.problem, x, y, ux, uy, apart) < apart - mover.radius_m:
                    continue
            then, there = self.seen.get(number, (step, where))
            velocity = (where - there) / max(1, step - then)
            self.seen[number] = step, where
            rows.append([*where, mover.radius_m, *velocity])
        return np.array(rows).reshape(-1, 5)


def kept(p: Problem) -> float:
    """What a walker keeps from what it senses, m: a little over the safe distance, for rays leave
    gaps, a path is thinned, and a field's surfaces are known to a fifth of a cell."""
    grain = _MARGIN_CELLS / p.per_m if p.field.size else 0.0
    return _MARGIN_SHARE * p.safe_m + grain


def box_of(problem: Problem) -> FloatArray:
    """(4,) the bounds, as wide as start and goal need."""
    x = sorted((problem.start_x, problem.goal_x))
    y = sorted((problem.start_y, problem.goal_y))
    return np.array([
        min(problem.low_x, x[0]), min(problem.low_y, y[0]),
        max(problem.high_x, x[1]), max(problem.high_y, y[1]),
    ])  # fmt: skip


def simulate(world: OnlineWorld, steering: Steering, rng: np.random.Generator) -> Trajectory:
    """Let a robot walk through a world that it does not know, until it stands at the goal (moving
    or not) or its steps are over."""
    goal = world.goal.at(0)
    problem = make_problem(world.fixed, world.start, goal, safe_m=world.safe_m)
    box, safe_m = box_of(problem), kept(problem)
    senses = Senses(problem, world.reach_m, box, safe_m)
    heading = math.atan2(goal[1] - world.start[1], goal[0] - world.start[0])
    walker = Walker(steering, make_state(rng), heading)
    here = np.array(world.start[:2], dtype=np.float64)
    path, collisions, least, reached = [here], 0, np.inf, False
    for step in range(world.most_steps):
        goal = world.goal.at(step)
        (x, y), (goal_x, goal_y) = here, goal
        look = Look(
            senses.points(x, y), senses.movers(x, y, world.movers, step),
            x, y, goal_x, goal_y, safe_m, world.step_m, world.reach_m, box,
        )  # fmt: skip
        there = walker.step(look, goal)
        clear = _clearance_between(world, problem, here, there, step)
        collisions += clear < world.radius_m
        least, here = min(least, clear), there
        path.append(here)
        if math.dist(here, world.goal.at(step + 1)) <= 0.5 * world.step_m:
            reached = True
            break
    return Trajectory(np.array(path), reached, collisions, least, walker.evaluations)


_SUBSTEPS = 8


def _clearance_between(
    world: OnlineWorld, problem: Problem, a: FloatArray, b: FloatArray, step: int
) -> float:
    """Least distance of the robot's centre from any surface while it goes a step, m."""
    least = np.inf
    for share in np.linspace(0.0, 1.0, _SUBSTEPS + 1):
        x, y = a + share * (b - a)
        least = min(least, float(point_clearance(problem, x, y)))
        for mover in world.movers:
            least = min(least, math.dist((x, y), mover.track.at(step + share)) - mover.radius_m)
    return least
