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


class Pursuit:
    """goal: (2,) in map, where it is at first. It stands still until a reading says otherwise."""

    def __init__(self, goal: FloatArray) -> None:
        self._place = np.array(goal, np.float64)
        self._filter: ConstantVelocity | None = None
        self._aimed_ns = 0
        self._aim = self._place

    @property
    def moves(self) -> bool:
        """Whether it has ever been told of."""
        return self._filter is not None

    def hear(self, reading: GoalReading) -> None:
        """Take what the robot is told of the goal."""
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

    def place(self, t_ns: int) -> FloatArray:
        """(2,) where it is at an instant."""
        return self._place if self._filter is None else self._filter.place_at(t_ns)

    def aim(self, view: WorldView, pose: FloatArray, speed_mps: float, room_m: float) -> FloatArray:
        """(2,) where to go from ``pose`` (3,) to meet it, ``room_m`` from all that is known."""
        here = self.place(view.t_ns)
        if self._filter is None:
            return here
        way = self._way_to_meeting(view.t_ns, pose, speed_mps)
        leads = (here + share * way for share in _LEADS)
        self._aim = next((at for at in leads if room_at(view, at) >= room_m), here)
        self._aimed_ns = view.t_ns
        return self._aim

    def strays(self, t_ns: int, pose: FloatArray, speed_mps: float) -> bool:
        """Whether a plan to where it was to be met is out of date."""
        if self._filter is None or t_ns - self._aimed_ns < _OFF_NS:
            return False
        aim = self.place(t_ns) + self._way_to_meeting(t_ns, pose, speed_mps)
        return bool(np.hypot(*(aim - self._aim)) > _OFF_M)

    def _way_to_meeting(self, t_ns: int, pose: FloatArray, speed_mps: float) -> FloatArray:
        """(2,) m that the goal goes until the robot, from ``pose`` (3,), can have reached it."""
        assert self._filter is not None
        velocity = self._filter.velocity
        when = meeting_time(self.place(t_ns), velocity, pose, _PACE_SHARE * speed_mps)
        return velocity * (_LEAD_S if when is None else min(when, _LEAD_S))


def room_at(view: WorldView, place: FloatArray) -> float:
    """m from a place (2,) to the nearest obstacle that the view knows; inf off its grid."""
    column, row = np.floor((place - view.origin_m) / view.resolution_m).astype(int)
    rows, columns = view.distance_m.shape
    if not (0 <= row < rows and 0 <= column < columns):
        return float("inf")
    return float(view.distance_m[row, column])
