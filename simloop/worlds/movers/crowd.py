"""All movers of a run, and the moving goal. They are ground truth, unknown to the robot.

They are stepped between the plant's truth and its next step, and compute where each mover is at the
end of the coming control period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, GoalReading
from simloop.worlds.body import Outline
from simloop.worlds.floor_plan import FloorPlan
from simloop.worlds.movers.motion import (
    CONSTANT,
    PATH,
    PEDESTRIAN,
    WALK,
    FloorField,
    MoverStates,
    RobotOutline,
    advance,
    gap_to_outline,
)
from simloop.worlds.movers.settings import GoalMotion, Mover

_KINDS = {"path": PATH, "constant": CONSTANT, "walk": WALK, "pedestrian": PEDESTRIAN}
_FAR_M = 1e6
_TOUCHING_M = 0.01  # gap to the outline below which a mover has touched, if a contact is reported
_DEEPEST_M = 0.06  # depth in the outline above which a mover has touched in any case
_BACK_S, _WAIT_S = 0.5, 2.0  # after a touch: time to go back, then time to wait
_NOBODY = RobotOutline(_FAR_M, _FAR_M, 0.0, 0.0, 0.0)


class Crowd:
    """The movers over a floor plan.

    Args:
        movers: settings of the movers.
        floor: the floor plan.
        body: the robot's true outline.
        period_s: the control period, s.
        rng: random generator of all draws.
    """

    def __init__(
        self,
        movers: Sequence[Mover],
        floor: FloorPlan,
        body: Outline,
        period_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._rng, self._period_s = rng, period_s
        self._half = (0.5 * body.length_m, 0.5 * body.width_m)
        distance = np.array(floor.distance_m, np.float32)
        corner = floor.origin_m.tolist()
        bounds = np.array(floor.bounds_m)
        self._floor = FloorField(distance, corner[0], corner[1], floor.resolution_m, bounds)
        self._states = _initial_states(movers)
        self._paths = [
            _Path(i, np.array(mover.keys_txy), mover.pushes, 0.5 * mover.diameter_m)
            for i, mover in enumerate(movers)
            if mover.keys_txy
        ]

    def step(self, pose: FloatArray | None, touched: bool = False) -> FloatArray:
        """Move all movers by one control period.

        Args:
            pose: (3,) true x, y, yaw of the robot now; None if the movers must ignore it.
            touched: whether something touches the robot now.

        Returns:
            (n, 2) places after the period, x, y in map, m. The next step changes this array.
        """
        states = self._states
        depth = -_TOUCHING_M if touched else _DEEPEST_M
        robot = _NOBODY
        if pose is not None:
            robot = RobotOutline(pose[0], pose[1], pose[2], *self._half, depth)
        count = len(states.kind)
        # All movers get draws at every step, so that no mover shifts another's draws.
        normal, uniform = self._rng.standard_normal(count), self._rng.random((count, 2))
        advance(states, self._floor, robot, normal, uniform, self._period_s)
        for path in self._paths:
            path.go_on(states.place[path.number], robot, self._period_s)
        return states.place


@dataclass
class _Path:
    """A mover on keys (k, 3) of t, x, y. Its clock runs back after a touch."""

    number: int
    keys: FloatArray
    pushes: bool
    radius_m: float
    clock_s: float = 0.0
    rest_s: float = 0.0

    def go_on(self, place: FloatArray, robot: RobotOutline, period_s: float) -> None:
        """Write the mover's place after one period into ``place`` (2,)."""
        gap = gap_to_outline(robot, *place.tolist())[0] - self.radius_m
        if gap < -robot.depth and not self.pushes and self.rest_s <= 0.0:
            self.rest_s = _BACK_S + _WAIT_S
        # After a touch the mover first goes back, then waits, then continues.
        if self.rest_s <= 0.0:
            self.clock_s += period_s
        elif self.rest_s > _WAIT_S:
            self.clock_s -= period_s
        self.rest_s -= period_s
        place[:] = on_path(self.keys, self.clock_s)


class MovingGoal:
    """A goal that moves, and the readings of it that the robot gets.

    Args:
        motion: settings of its motion and of the readings.
        goal: (2,) its initial place, x, y in map, m.
        floor: the floor plan.
        body: the robot's true outline.
        period_s: the control period, s.
        rng: random generator of all draws.
    """

    def __init__(
        self,
        motion: GoalMotion,
        goal: Sequence[float],
        floor: FloorPlan,
        body: Outline,
        period_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._noise_m, self._rng = motion.noise_m, rng
        self._every_ns = round(motion.period_s * 1e9)
        at_start = None if motion.keys_txy else (float(goal[0]), float(goal[1]))
        mover = Mover(
            motion=motion.motion,
            position_m=at_start,
            keys_txy=motion.keys_txy,
            speed_mps=motion.speed_mps,
            heading_rad=motion.heading_rad,
            turn_rad=motion.turn_rad,
            diameter_m=max(0.05, 2.0 * motion.room_m),
        )
        self._crowd = Crowd([mover], floor, body, period_s, rng)

    def step(self) -> FloatArray:
        """Move the goal by one control period.

        Returns:
            (2,) its true place after the period, x, y in map, m.
        """
        return self._crowd.step(None)[0].copy()

    def reading(self, t_ns: int, goal: FloatArray) -> GoalReading | None:
        """Make the reading that the robot gets at an instant.

        Args:
            t_ns: the instant, ns.
            goal: (2,) true place of the goal, x, y in map, m.

        Returns:
            The place with noise, or None between two readings.
        """
        if t_ns % self._every_ns:
            return None
        return GoalReading(t_ns, goal + self._noise_m * self._rng.standard_normal(2))


def on_path(keys: FloatArray, t_s: float) -> FloatArray:
    """Compute the place on a path at an instant. It is straight between keys, and repeats.

    Args:
        keys: (k, 3) t, x, y, s and m, in order of time, the first at t = 0.
        t_s: the instant, s.

    Returns:
        (2,) x, y in map, m.
    """
    t = t_s % float(keys[-1, 0])
    return np.array([np.interp(t, keys[:, 0], keys[:, 1]), np.interp(t, keys[:, 0], keys[:, 2])])


def _initial_states(movers: Sequence[Mover]) -> MoverStates:
    heading = np.array([wrap_angle(m.heading_rad) for m in movers])
    pace = np.array([m.speed_mps for m in movers], np.float64)
    moving = np.array([m.motion in ("constant", "walk") for m in movers], bool)
    velocity = np.where(moving, pace, 0.0)[:, None] * np.stack(
        [np.cos(heading), np.sin(heading)], axis=1
    )
    place = np.array([m.start_m for m in movers], np.float64)
    return MoverStates(
        kind=np.array([_KINDS[m.motion] for m in movers], np.int64),
        place=place,
        velocity=velocity,
        aim=place.copy(),
        pace=pace,
        radius=np.array([0.5 * m.diameter_m for m in movers], np.float64),
        turn=np.array([m.turn_rad for m in movers], np.float64),
        aimed_s=np.zeros(len(movers)),
    )
