"""Warm start: the part of the previous plan that still lies ahead of the robot."""

from __future__ import annotations

import math

import numpy as np

from simloop.messages import FloatArray, Plan
from simloop.planners.problem.clearance import Problem

_SAME_GOAL_M = 0.05


def way_ahead(problem: Problem, previous: Plan | None) -> FloatArray | None:
    """Return the part of the previous plan that still lies ahead.

    It does not check whether that part is still safe.

    Args:
        problem: The problem; only its start and goal are used.
        previous: The previous plan; None if there is none.

    Returns:
        (m, 2) waypoints from the start to the goal, m; None if there is no previous plan, if it was
        not safe, or if it leads elsewhere.
    """
    if previous is None or not previous.safe:
        return None
    old = previous.waypoints_m
    goal = np.array([problem.goal_x, problem.goal_y])
    if math.dist(old[-1], goal) > _SAME_GOAL_M:
        return None
    here = np.array([problem.start_x, problem.start_y])
    edges = old[1:] - old[:-1]
    squares = np.maximum((edges**2).sum(axis=1), 1e-18)
    t = np.clip(((here - old[:-1]) * edges).sum(axis=1) / squares, 0.0, 1.0)
    nearest = int(np.argmin(np.hypot(*(old[:-1] + t[:, None] * edges - here).T)))
    return np.vstack([here, old[nearest + 1 : -1], goal])
