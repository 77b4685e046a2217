"""A goal that may move: where it is, by what the robot has been told, and where to meet it."""

from __future__ import annotations

import numpy as np

from simloop.estimation.constant_velocity import ConstantVelocity
from simloop.messages import FloatArray, GoalReading, WorldView
from simloop.navigation.planner_world import meeting_time

_PLACE_STD_M, _SPEED_STD_MPS = 0.03, 0.3
_ACCELERATION_MPS2 = 0.3
_PACE_SHARE = 0.8  # of the robot's speed: turns and detours take their time
_LEAD_S = 3.0  # further ahead its way is anyone's guess
_LEADS = (1.0, 0.5, 0.25)  # of the way to the meeting: the first that has room
_OFF_M, _OFF_NS = 0.06, 400_000_000  # that the aim may have gone astray, and how soon it is asked


class MovingGoal:
    """Tracks the goal. It stands still until a reading says otherwise."""

    def __init__(self, goal: FloatArray) -> None:
        self._place = np.array(goal, np.float64)
        self._filter: ConstantVelocity | None = None
        self._aimed_ns = 0
        self._aim = self._place

    @property
    def moves(self) -> bool:
        """Whether it has ever been told of."""
        return self._filter is not None

    def update(self, reading: GoalReading) -> None:
        """Take news of the goal.

        Args:
            reading: Where it is.
        """
        if self._filter is None:
            self._filter = ConstantVelocity(
                reading.position_m,
                reading.t_ns,
                _PLACE_STD_M,
                _SPEED_STD_MPS,
                _ACCELERATION_MPS2,
            )
        else:
            self._filter.predict(reading.t_ns)
            self._filter.update(reading.position_m)

    def position_at(self, t_ns: int) -> FloatArray:
        """Predict where the goal is.

        Args:
            t_ns: The instant, ns.

        Returns:
            (2,) in map, m.
        """
        return self._place if self._filter is None else self._filter.place_at(t_ns)

    def aim(self, view: WorldView, pose: FloatArray, speed_mps: float, room_m: float) -> FloatArray:
        """Choose the place to plan to, so that the robot meets the goal.

        Args:
            view: What is known of the world.
            pose: (3,) of base_link in map, m, m, rad.
            speed_mps: Cruising speed of the robot, m/s.
            room_m: Distance that the place keeps from obstacles, m.

        Returns:
            (2,) in map, m.
        """
        here = self.position_at(view.t_ns)
        if self._filter is None:
            return here
        way = self._way_to_meeting(view.t_ns, pose, speed_mps)
        leads = (here + share * way for share in _LEADS)
        self._aim = next((at for at in leads if distance_to_obstacle(view, at) >= room_m), here)
        self._aimed_ns = view.t_ns
        return self._aim

    def is_out_of_date(self, t_ns: int, pose: FloatArray, speed_mps: float) -> bool:
        """Say whether the place of the last plan is out of date.

        Args:
            t_ns: The instant, ns.
            pose: (3,) of base_link in map, m, m, rad.
            speed_mps: Cruising speed of the robot, m/s.

        Returns:
            True if the goal is going to be met elsewhere.
        """
        if self._filter is None or t_ns - self._aimed_ns < _OFF_NS:
            return False
        aim = self.position_at(t_ns) + self._way_to_meeting(t_ns, pose, speed_mps)
        return bool(np.hypot(*(aim - self._aim)) > _OFF_M)

    def _way_to_meeting(self, t_ns: int, pose: FloatArray, speed_mps: float) -> FloatArray:
        """(2,) m that the goal goes until the robot, from ``pose`` (3,), can have reached it."""
        assert self._filter is not None
        velocity = self._filter.velocity
        when = meeting_time(self.position_at(t_ns), velocity, pose, _PACE_SHARE * speed_mps)
        return velocity * (_LEAD_S if when is None else min(when, _LEAD_S))


def distance_to_obstacle(view: WorldView, place: FloatArray) -> float:
    """Look up the distance from a place to the nearest obstacle.

    Args:
        view: What is known of the world.
        place: (2,) in map, m.

    Returns:
        Metres; infinite off the view's grid.
    """
    column, row = np.floor((place - view.origin_m) / view.resolution_m).astype(int)
    rows, columns = view.distance_m.shape
    if not (0 <= row < rows and 0 <= column < columns):
        return float("inf")
    return float(view.distance_m[row, column])
