"""Gap choice: plan at up to three safe distances, and choose between two of the plans.

The path that is shortest at the usual safe distance may lead through a gap that looks just wide
enough from afar. Such a gap often proves closed when the robot arrives, and the way there and back
is lost. A path with more room is therefore chosen if it costs little more. If the way round is
long, a gap that is a little too narrow is chosen instead.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from simloop.config import Config
from simloop.messages import FloatArray, Plan, WorldView
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner

_LONG_DETOUR_M = 0.3  # a detour longer than this justifies a gap that is a little too narrow
_HARD = 5000  # after a plan with more evaluations there is no time for a second plan


class GapChooser:
    """Plans at the usual safe distance, and at another one if that is promising.

    One planner serves all three distances, because planners keep no state between two calls.
    """

    def __init__(self, config: Config, rng: np.random.Generator) -> None:
        self._config, self._rng = config.planner, rng
        self._planner = make_planner(config.planner, config.vehicle)
        usual = config.planner.safe_distance_m
        self._usual_m = usual
        self._tight_m = usual - config.planner.squeeze_m
        self._roomy_m = usual + config.planner.prefer_m
        self._tries_tight_gaps = config.planner.squeeze_m > 0.0

    def stop_trying_tight_gaps(self) -> None:
        """Stop planning below the usual safe distance, because the robot has got stuck."""
        self._tries_tight_gaps = False

    def plan(
        self,
        view: WorldView,
        pose: FloatArray,
        goal: FloatArray,
        previous: Plan | None,
        reason: str,
    ) -> Plan:
        """Plan at the usual safe distance and, if that is promising, at another one.

        Args:
            view: What is known of the obstacles, in map.
            pose: (3,) x, y, yaw of base_link in map, m, m, rad.
            goal: (2,) x, y in map, m.
            previous: The plan that the robot follows now, if any.
            reason: Why the robot plans.

        Returns:
            The chosen plan, with the safe distance that it keeps. Its evaluations include those
            of the plans that were not chosen.
        """
        task = PlanningTask(view, pose, goal, self._usual_m, previous, reason)
        usual = self._planner.plan(task, self._rng)
        chosen, spent = usual, usual.evaluations
        hoped = math.dist(pose[:2], goal) if previous is None else remaining_length(previous, pose)
        if not usual.safe or usual.length_m > hoped + _LONG_DETOUR_M:
            if self._tries_tight_gaps:
                tight = self._planner.plan(self._at(task, self._tight_m), self._rng)
                spent += tight.evaluations
                shorter = tight.length_m < usual.length_m - _LONG_DETOUR_M
                if tight.safe and (shorter or not usual.safe):
                    chosen = tight
        elif self._config.prefer_m > 0.0 and usual.evaluations <= _HARD:
            roomy = self._planner.plan(self._at(task, self._roomy_m), self._rng)
            spent += roomy.evaluations
            dearest = usual.path_cost * (1.0 + self._config.prefer_share)
            if roomy.safe and roomy.path_cost < dearest:
                chosen = roomy
        return replace(chosen, evaluations=spent)

    @staticmethod
    def _at(task: PlanningTask, safe_distance_m: float) -> PlanningTask:
        """Return the same task with another safe distance."""
        return replace(task, safe_distance_m=safe_distance_m)


def remaining_length(plan: Plan, pose: FloatArray) -> float:
    """Compute how much of a plan lies ahead of a pose.

    Args:
        plan: The plan, with at least two waypoints.
        pose: (2,) or longer: x, y in map, m.

    Returns:
        Length of the polyline from its point nearest to the pose up to its end, m.
    """
    points = plan.waypoints_m
    legs = np.diff(points, axis=0)
    squares = np.maximum((legs**2).sum(axis=1), 1e-12)
    share = np.clip(((pose[:2] - points[:-1]) * legs).sum(axis=1) / squares, 0.0, 1.0)
    feet = points[:-1] + share[:, None] * legs
    k = int(np.argmin(np.hypot(*(feet - pose[:2]).T)))
    lengths = np.sqrt(squares)
    return float((1.0 - share[k]) * lengths[k] + lengths[k + 1 :].sum())
