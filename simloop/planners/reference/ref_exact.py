"""The exact optimum among discs as a planner; see `simloop.planners.reference.exact`."""

from __future__ import annotations

import numpy as np

from simloop.messages import FloatArray, WorldView
from simloop.planners.problem.clearance import Problem
from simloop.planners.reference.exact import exact_path
from simloop.planners.reference.reference import Reference

_ARC_STEP_RAD = 0.01


class Exact(Reference):
    """Tangent graph and Dijkstra's algorithm, with arcs sampled as chords.

    A chord cuts into its circle by the sag R step^2 / 8. The discs are grown by the largest sag,
    so that the chords keep the safe distance.
    """

    name = "exact"

    def route(self, world: WorldView, p: Problem, rng: np.random.Generator) -> FloatArray | None:
        """Find the path of least J; it counts as one trial, because the search is not random.

        Args:
            world: The world view.
            p: The planning problem in that view.
            rng: Not used.

        Returns:
            (n, 2) waypoints from start to goal, m, map frame; None if no path exists.
        """
        p.trials[0] += 1
        discs = p.discs.T.copy()
        widest = float(p.discs[2].max()) + p.safe_m if len(discs) else 0.0
        best = exact_path(
            discs,
            np.array([p.low_x, p.low_y, p.high_x, p.high_y]),
            np.array([p.start_x, p.start_y]),
            np.array([p.goal_x, p.goal_y]),
            safe_m=p.safe_m + widest * _ARC_STEP_RAD**2 / 8.0,
            length_weight=p.length_weight,
            turning_weight=p.turning_weight,
            arc_step_rad=_ARC_STEP_RAD,
        )
        return None if best is None else best.points_m
