"""All movers of a run, and the goal that moves: truth, of which the robot is told nothing.

They stand between the plant's truth and its next step: where each is to be by the end of the
coming control period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simloop.config import VehicleConfig
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, GoalReading
from simloop.worlds.floor_plan import FloorPlan
from simloop.worlds.movers.motion import (
    CONSTANT,
    PATH,
    PEDESTRIAN,
    WALK,
    Floor,
    Herd,
    Outline,
    advance,
    gap_to_outline,
)
from simloop.worlds.movers.settings import GoalMotion, Mover

_KINDS = {"path": PATH, "constant": CONSTANT, "walk": WALK, "pedestrian": PEDESTRIAN}
_FAR_M = 1e6
_NEAR_M, _DEEP_M = 0.01, 0.06  # of the outline: who is this near has touched it; most there is
_BACK_S, _WAIT_S = 0.5, 2.0  # after a touch
_NOBODY = Outline(_FAR_M, _FAR_M, 0.0, 0.0, 0.0)


class Crowd:
    """Movers over a floor. rng: what they draw. ``place``: (n, 2) m, in map."""

    def __init__(
        self,
        movers: Sequence[Mover],
        floor: FloorPlan,
        vehicle: VehicleConfig,
        period_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._rng, self._period_s = rng, period_s
        self._half = (0.5 * vehicle.length_m, 0.5 * vehicle.width_m)
        distance = np.array(floor.distance_m, np.float32)
        corner = floor.origin_m.tolist()
        bounds = np.array(floor.bounds_m)
        self._floor = Floor(distance, corner[0], corner[1], floor.resolution_m, bounds)
        self._herd = _herd(movers)
        self._paths = [
            _Path(i, np.array(mover.keys_txy), mover.pushes, 0.5 * mover.diameter_m)
            for i, mover in enumerate(movers)
            if mover.keys_txy
        ]

    @property
    def place(self) -> FloatArray:
        """(n, 2) where they are, m."""
        return self._herd.place

    def step(self, pose: FloatArray | None, touched: bool = False) -> FloatArray:
        """Where they are, (n, 2), one control period later.

        pose: (3,) the robot's true one now; None if they are not to feel it. touched: whether
        something touches the robot now.
        """
        herd = self._herd
        depth = -_NEAR_M if touched else _DEEP_M
        robot = _NOBODY if pose is None else Outline(pose[0], pose[1], pose[2], *self._half, depth)
        count = len(herd.kind)
        normal, uniform = self._rng.standard_normal(count), self._rng.random((count, 2))
        advance(herd, self._floor, robot, normal, uniform, self._period_s)
        for path in self._paths:
            path.go_on(herd.place[path.number], robot, self._period_s)
        return herd.place


@dataclass
class _Path:
    """A mover on keys (k, 3) of t, x, y, with a clock of its own: back after a touch, then on."""

    number: int
    keys: FloatArray
    pushes: bool
    radius_m: float
    clock_s: float = 0.0
    rest_s: float = 0.0

    def go_on(self, place: FloatArray, robot: Outline, period_s: float) -> None:
        """Put a place (2,) where the mover is a period later."""
        gap = gap_to_outline(robot, *place.tolist())[0] - self.radius_m
        if gap < -robot.depth and not self.pushes and self.rest_s <= 0.0:
            self.rest_s = _BACK_S + _WAIT_S
        if self.rest_s <= 0.0:
            self.clock_s += period_s
        elif self.rest_s > _WAIT_S:
            self.clock_s -= period_s
        self.rest_s -= period_s
        place[:] = on_path(self.keys, self.clock_s)


class MovingGoal:
    """Where the goal truly is, and what the robot is told of it. goal: (2,) where it begins."""

    def __init__(
        self,
        motion: GoalMotion,
        goal: Sequence[float],
        floor: FloorPlan,
        vehicle: VehicleConfig,
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
        self._crowd = Crowd([mover], floor, vehicle, period_s, rng)

    def step(self) -> FloatArray:
        """(2,) its place one control period later."""
        return self._crowd.step(None)[0].copy()

    def reading(self, t_ns: int, goal: FloatArray) -> GoalReading | None:
        """What the robot is told at an instant, if anything. goal: (2,) the true one."""
        if t_ns % self._every_ns:
            return None
        return GoalReading(t_ns, goal + self._noise_m * self._rng.standard_normal(2))


def on_path(keys: FloatArray, t_s: float) -> FloatArray:
    """(2,) where it is at a time on keys (k, 3) of t, x, y, straight between them, looped."""
    t = t_s % float(keys[-1, 0])
    return np.array([np.interp(t, keys[:, 0], keys[:, 1]), np.interp(t, keys[:, 0], keys[:, 2])])


def _herd(movers: Sequence[Mover]) -> Herd:
    heading = np.array([wrap_angle(m.heading_rad) for m in movers])
    pace = np.array([m.speed_mps for m in movers], np.float64)
    moving = np.array([m.motion in ("constant", "walk") for m in movers], bool)
    velocity = np.where(moving, pace, 0.0)[:, None] * np.stack(
        [np.cos(heading), np.sin(heading)], axis=1
    )
    place = np.array([m.start_m for m in movers], np.float64)
    return Herd(
        kind=np.array([_KINDS[m.motion] for m in movers], np.int64),
        place=place,
        velocity=velocity,
        aim=place.copy(),
        pace=pace,
        radius=np.array([0.5 * m.diameter_m for m in movers], np.float64),
        turn=np.array([m.turn_rad for m in movers], np.float64),
        aimed_s=np.zeros(len(movers)),
    )
