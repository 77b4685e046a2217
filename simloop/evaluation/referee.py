"""The referee: the only place that decides how a run ends."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from simloop.messages import FloatArray, RobotStatus
from simloop.truth import Truth

_STANDING_MPS = 0.01


class Outcome(StrEnum):
    """The end of a run. The value is the word in results and tables."""

    REACHED = "reached"
    """The robot reports arrival, stands, and is within the goal's tolerance."""
    COLLISION = "collision"
    """The robot touched something other than the ground."""
    STUCK = "stuck"
    """The robot gave up after too many failed recoveries."""
    UNREACHABLE = "unreachable"
    """The robot reports that known obstacles enclose the goal."""
    LOST = "lost"
    """The robot stopped because it did not find out where it is."""
    MISSED = "missed"
    """The robot reports arrival and stands, but outside the goal's tolerance."""
    TIMEOUT = "timeout"
    """The time limit of the scenario passed."""
    UNSTABLE = "unstable"
    """The physics engine failed, so nothing that followed can be judged."""
    INTERRUPTED = "interrupted"
    """The caller stopped the run."""

    @property
    def success(self) -> bool:
        """Whether the robot completed its task."""
        return self is Outcome.REACHED

    @property
    def description(self) -> str:
        """The outcome in words."""
        return _DESCRIPTIONS[self]


_DESCRIPTIONS = {
    Outcome.REACHED: "goal reached",
    Outcome.COLLISION: "collision",
    Outcome.STUCK: "stuck: the robot gave up",
    Outcome.UNREACHABLE: "unreachable: known obstacles enclose the goal",
    Outcome.LOST: "lost: the robot stopped because it does not know where it is",
    Outcome.MISSED: "missed: the robot stopped outside the goal's tolerance",
    Outcome.TIMEOUT: "out of time",
    Outcome.UNSTABLE: "physics unstable: the run proves nothing about the robot",
    Outcome.INTERRUPTED: "interrupted",
}
_REPORTED_FAILURES = {
    RobotStatus.LOST: Outcome.LOST,
    RobotStatus.UNREACHABLE: Outcome.UNREACHABLE,
    RobotStatus.GAVE_UP: Outcome.STUCK,
}


class Referee:
    """Decides after each control period, from the ground truth and the robot's report."""

    def __init__(self, goal_tolerance_m: float, time_limit_s: float, goal_moves: bool) -> None:
        """Set the rules of one run.

        Args:
            goal_tolerance_m: Largest distance of base_link from the goal that counts as reached.
            time_limit_s: Simulated time after which the run is over.
            goal_moves: Whether the goal moves. Then the robot need not stand at it.
        """
        self._tolerance_m = goal_tolerance_m
        self._limit_ns = round(time_limit_s * 1e9)
        self._goal_moves = goal_moves

    def judge(self, truth: Truth, status: RobotStatus, goal_m: FloatArray) -> Outcome | None:
        """Decide whether the run ends in this control period.

        Unstable physics has priority over a collision, a collision over the robot's report, and
        the report over the time limit. A robot that reports arrival while it still moves is not
        judged yet.

        Args:
            truth: Ground truth at the end of the period.
            status: What the robot reports about its mission.
            goal_m: (2,) true position of the goal in map, m.

        Returns:
            The outcome, or None while the run goes on.
        """
        if truth.unstable:
            return Outcome.UNSTABLE
        if truth.contact_count:
            return Outcome.COLLISION
        if status is RobotStatus.ARRIVED:
            if self._goal_moves or abs(truth.velocity_body[0]) < _STANDING_MPS:
                near = distance_to_go_m(truth, goal_m) <= self._tolerance_m
                return Outcome.REACHED if near else Outcome.MISSED
        elif status is not RobotStatus.DRIVING:
            return _REPORTED_FAILURES[status]
        return Outcome.TIMEOUT if truth.t_ns >= self._limit_ns else None


def distance_to_go_m(truth: Truth, goal_m: FloatArray) -> float:
    """Measure the straight distance from the robot's true position to the goal.

    Args:
        truth: Ground truth.
        goal_m: (2,) true position of the goal in map, m.

    Returns:
        Distance from base_link to the goal, m.
    """
    return float(np.hypot(*(truth.pose_xyyaw[:2] - goal_m)))
