"""A goal that may move: its position from the readings, and the place where the robot meets it."""

from __future__ import annotations

import numpy as np

from simloop.estimation.constant_velocity import ConstantVelocity
from simloop.messages import FloatArray, GoalReading, WorldView
from simloop.navigation.planner_world import meeting_time

_PLACE_STD_M, _SPEED_STD_MPS = 0.03, 0.3
_ACCELERATION_MPS2 = 0.3
_PACE_SHARE = 0.8  # share of the robot's speed that is assumed: turns and detours take time
_LEAD_S = 3.0  # the goal's motion is not predicted farther ahead than this
_LEADS = (1.0, 0.5, 0.25)  # shares of the way to the meeting; the first with enough room is used
_OFF_M, _OFF_NS = 0.06, 400_000_000  # aim error that calls for a new plan; the old one's least age


class MovingGoal:
    """Tracks the goal. The goal stands still until the first reading."""

    def __init__(self, goal: FloatArray) -> None:
        self._place = np.array(goal, np.float64)
        self._filter: ConstantVelocity | None = None
        self._aimed_ns = 0
        self._aim = self._place

    @property
    def moves(self) -> bool:
        """Whether the goal has ever had a reading."""
        return self._filter is not None

    def update(self, reading: GoalReading) -> None:
        """Update the goal with a reading.

        Args:
            reading: The measured position of the goal.
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
            t_ns: The time, ns.

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
            room_m: Distance that the place must keep from obstacles, m.

        Returns:
            (2,) in map, m; the goal's present position if no meeting place has enough room.
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
        """Tell whether the place of the last plan is out of date.

        Args:
            t_ns: The time, ns.
            pose: (3,) of base_link in map, m, m, rad.
            speed_mps: Cruising speed of the robot, m/s.

        Returns:
            True if the robot will meet the goal at another place.
        """
        if self._filter is None or t_ns - self._aimed_ns < _OFF_NS:
            return False
        aim = self.position_at(t_ns) + self._way_to_meeting(t_ns, pose, speed_mps)
        return bool(np.hypot(*(aim - self._aim)) > _OFF_M)

    def _way_to_meeting(self, t_ns: int, pose: FloatArray, speed_mps: float) -> FloatArray:
        """Return how far the goal moves, (2,) m, until a robot at ``pose`` (3,) can reach it."""
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
        Distance, m; infinite outside the view's grid.
    """
    column, row = np.floor((place - view.origin_m) / view.resolution_m).astype(int)
    rows, columns = view.distance_m.shape
    if not (0 <= row < rows and 0 <= column < columns):
        return float("inf")
    return float(view.distance_m[row, column])
