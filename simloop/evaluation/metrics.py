"""Compute the metrics of a run from the ground truth and the robot's messages.

During the run only references to the messages' arrays are kept. This costs well under a
microsecond per message. All arithmetic, including the shortest path, is done after the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from simloop.evaluation.health_account import health_account
from simloop.evaluation.provenance import versions
from simloop.evaluation.referee import Outcome
from simloop.evaluation.shortest_path import TooManyCornersError, shortest_path
from simloop.geometry.se2 import wrap_angles
from simloop.messages import Estimate, FloatArray, Health, Plan
from simloop.scenario.scenario import Scenario
from simloop.truth import TrackTruth, Truth
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import FloorPlan
from simloop.worlds.outline_gap import least_clearance

_NEES_PERIOD_NS = 100_000_000


class RunMetrics:
    """Collects the messages of a run and computes its metrics after the run."""

    def __init__(self, scenario: Scenario, floor: FloorPlan, body: Body) -> None:
        """Prepare for one run.

        Args:
            scenario: The scenario of the run.
            floor: True floor plan, for clearance and shortest path.
            body: True outline of the vehicle.
        """
        self._scenario = scenario
        self._floor = floor
        self._body = body
        self._goal = scenario.goal
        self._last: Truth | None = None
        self._tracks: TrackTruth | None = None
        self._true_ns: list[int] = []
        self._true_poses: list[FloatArray] = []
        self._estimate_ns: list[int] = []
        self._states: list[FloatArray] = []
        self._covariances: list[tuple[int, FloatArray]] = []
        self._next_nees_ns = 0
        self._evaluations: list[int] = []
        self._health: list[Health] = []

    def offer(self, message: object) -> None:
        """Keep the parts of a message that the metrics need, and ignore other kinds.

        Args:
            message: Any message of the run. One ``Truth`` is expected in each control period.
        """
        if isinstance(message, Truth):
            self._last = message
            self._true_ns.append(message.t_ns)
            self._true_poses.append(message.pose_xyyaw)
        elif isinstance(message, Estimate):
            if message.t_ns >= self._next_nees_ns:
                self._next_nees_ns = message.t_ns + _NEES_PERIOD_NS
                self._covariances.append((len(self._states), message.covariance))
            self._estimate_ns.append(message.t_ns)
            self._states.append(message.state)
        elif isinstance(message, TrackTruth):
            self._tracks = message
        elif isinstance(message, Plan):
            self._evaluations.append(message.evaluations)
        elif isinstance(message, Health):
            self._health.append(message)

    def distance_to_go_m(self) -> float:
        """Measure the straight distance from the robot's true position to the goal.

        Returns:
            Distance of base_link, or of the start if the run has not begun, m.
        """
        if self._last is None:
            return math.dist(self._scenario.start[:2], self._goal)
        return math.dist(self._last.pose_xyyaw[:2], self._goal)

    def result(
        self,
        *,
        outcome: Outcome,
        state_hash: str,
        wall_time_s: float,
        plan_ms: Sequence[float],
        goal: FloatArray | None = None,
    ) -> dict[str, Any]:
        """Compute the metrics of the run.

        Args:
            outcome: The referee's decision.
            state_hash: Hash of the plant's final state.
            wall_time_s: Wall time of the run, s.
            plan_ms: Wall times of the planner's calls, ms.
            goal: (2,) final position in map of a goal that moved, m. Distance and shortest path
                are then measured to there.

        Returns:
            The metrics that ``simloop run --json`` writes; a metric that does not exist is None.
        """
        if goal is not None:
            self._goal = (float(goal[0]), float(goal[1]))
        scenario, last = self._scenario, self._last
        poses = np.array(self._true_poses).reshape(-1, 3)
        sim_time_s = (self._true_ns[-1] if self._true_ns else 0) / 1e9
        return {
            "outcome": outcome.value,
            "sim_time_s": sim_time_s,
            "wall_time_s": wall_time_s,
            "real_time_factor": sim_time_s / wall_time_s if wall_time_s > 0.0 else None,
            **self._path_figures(outcome, poses),
            "contact_count": last.contact_count if last else 0,
            "hit_count": last.hit_count if last else 0,
            **self._estimation_errors(poses),
            "distance_to_go_m": self.distance_to_go_m(),
            **self._planning_figures(plan_ms),
            "energy_j": last.energy_j if last else 0.0,
            "shear_work_j": self._tracks.shear_work_j if self._tracks else 0.0,
            "state_hash": state_hash,
            "seed": scenario.seed,
            "scenario": scenario.name,
            "planner": scenario.config.planner.name,
            "versions": versions(),
        }

    def _path_figures(self, outcome: Outcome, poses: FloatArray) -> dict[str, Any]:
        """Compute lengths, SPL and clearance of the true path (N, 3), one pose a control period.

        spl = success x shortest / max(path, shortest), after Anderson et al. 2018, "On Evaluation
        of Embodied Navigation Agents".
        """
        path_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
        spl: float | None = 0.0
        try:
            shortest_m = self._shortest_m()
        except TooManyCornersError:
            shortest_m, spl = None, None if outcome.success else 0.0
        if outcome.success and shortest_m is not None:
            spl = shortest_m / max(path_m, shortest_m) if shortest_m > 0.0 else 1.0
        clearance_m = least_clearance(self._floor, poses, self._body)
        return {
            "path_length_m": path_m,
            "shortest_path_m": shortest_m,
            "spl": spl,
            "min_clearance_m": clearance_m if math.isfinite(clearance_m) else None,
        }

    def _planning_figures(self, plan_ms: Sequence[float]) -> dict[str, Any]:
        """Compute number and cost of the planner's calls. The first plan is not a replan."""
        return {
            "replans": max(0, len(self._evaluations) - 1),
            "plan_ms_p50": float(np.percentile(plan_ms, 50)) if len(plan_ms) else None,
            "plan_ms_p99": float(np.percentile(plan_ms, 99)) if len(plan_ms) else None,
            "plan_evaluations": sum(self._evaluations),
        }

    def _shortest_m(self) -> float | None:
        """Compute the length, m, of the shortest safe path to the goal's tolerance.

        The path is that of a disc with the footprint's radius in the true floor plan. If L is the
        shortest path to the goal itself, the length is exactly L - tolerance. The path reaches the
        circle of the tolerance there or earlier, and no point of the circle can be nearer to the
        start by more than the tolerance.
        """
        scenario = self._scenario
        radius_m = self._body.footprint_radius_m
        length_m = _shortest_m(self._floor, scenario.start[:2], self._goal, radius_m)
        return None if length_m is None else max(0.0, length_m - scenario.goal_tolerance_m)

    def _estimation_errors(self, poses: FloatArray) -> dict[str, Any]:
        """Compute the errors of the estimates against the true poses (N, 3), without alignment.

        Both start from the same known pose in map. nees_mean is the mean over x, y, yaw at 10 Hz.
        It is 3 for a consistent filter (Bar-Shalom et al. 2001, Sec. 5.4).
        """
        if not self._states or not len(poses):
            return {"ate_rmse_m": None, "yaw_rmse_rad": None, "nees_mean": None, "health": None}
        states = np.array(self._states)
        truth = _at(np.array(self._estimate_ns), np.array(self._true_ns), poses)
        error = states[:, :3] - truth
        error[:, 2] = wrap_angles(error[:, 2])
        nees = [
            float(error[i] @ np.linalg.lstsq(covariance[:3, :3], error[i], rcond=None)[0])
            for i, covariance in self._covariances
        ]
        return {
            "ate_rmse_m": float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))),
            "yaw_rmse_rad": float(np.sqrt(np.mean(error[:, 2] ** 2))),
            "nees_mean": float(np.mean(nees)),
            "health": health_account(self._health, np.array(self._estimate_ns), error, truth),
        }


@lru_cache(maxsize=8)
def _shortest_m(
    floor: FloorPlan, start: tuple[float, float], goal: tuple[float, float], radius_m: float
) -> float | None:
    """Compute the length, m. Cached, because it may take seconds and seeds share it."""
    way = shortest_path(floor, np.array(start), np.array(goal), radius_m)
    return None if way is None else way.length_m


def _at(t_ns: FloatArray, true_ns: FloatArray, poses: FloatArray) -> FloatArray:
    """Interpolate poses (N, 3) at instants (M,); the yaw of the result is unwrapped."""
    x, y, yaw = poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])
    return np.stack([np.interp(t_ns, true_ns, column) for column in (x, y, yaw)], axis=1)
