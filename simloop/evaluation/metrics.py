"""The figures of a run, from the streams of truth and estimates; nothing of it enters the robot.

During the run only references to what the messages carry are kept (well under a microsecond a
message); all arithmetic, the shortest path included, comes after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from simloop.evaluation.health_account import account
from simloop.evaluation.provenance import versions
from simloop.evaluation.shortest_path import shortest_path
from simloop.geometry.se2 import wrap_angles
from simloop.messages import Estimate, FloatArray, Health, Plan
from simloop.scenario.scenario import Scenario
from simloop.truth import TrackTruth, Truth
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import FloorPlan
from simloop.worlds.outline_gap import least_clearance

Outcome = Literal["reached", "collision", "timeout", "stuck"]

_NEES_PERIOD_NS = 100_000_000


class RunMetrics:
    """Accumulates a run's messages (``offer``) and sums it up once it is over (``result``)."""

    def __init__(self, scenario: Scenario, floor: FloorPlan, body: Body) -> None:
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
        """Take note of a Truth (one a control tick), an Estimate or a Plan; ignore all else."""
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
        """Straight distance from the robot's true place to the goal."""
        if self._last is None:
            return math.dist(self._scenario.start[:2], self._goal)
        return math.dist(self._last.pose_xyyaw[:2], self._goal)

    def outcome(self) -> Outcome:
        """How the run ended, judged by the truth alone.

        ``collision``: anything but the ground was touched; ``reached``: base_link is within the
        goal's tolerance; ``timeout``: the time limit has passed; else ``stuck``: it gave up.
        """
        scenario = self._scenario
        if self._last is not None and self._last.contact_count > 0:
            return "collision"
        if self.distance_to_go_m() <= scenario.goal_tolerance_m:
            return "reached"
        if self._last is not None and self._last.t_ns * 1e-9 >= scenario.time_limit_s - 1e-9:
            return "timeout"
        return "stuck"

    def result(
        self,
        *,
        state_hash: str,
        wall_time_s: float,
        plan_ms: Sequence[float],
        outcome: str | None = None,
        goal: FloatArray | None = None,
    ) -> dict[str, Any]:
        """The figures that ``--json`` writes; None where a figure does not exist.

        shortest_path_m is that of a disc of the footprint's radius (0.25 m), in the true floor
        plan, from the start to within the goal's tolerance. With L the way to the goal itself,
        that is exactly L - tolerance: the way crosses the tolerance's circle there or before, and
        no point within the circle can be more than the tolerance nearer. path_length_m is that of
        the true path of base_link, at control ticks. spl = success x shortest / max(path,
        shortest) (Anderson et al. 2018).

        ate_rmse_m and yaw_rmse_rad compare estimate and truth in map at the estimates' instants,
        without any alignment: both start from the same, known pose. nees_mean is that of
        x, y, yaw at 10 Hz (3 for a consistent filter; Bar-Shalom et al. 2001, Sec. 5.4).
        health: what the robot said of its localisation, see ``health_account``.

        plan_ms: wall times of the planner's calls; replans: its calls after the first. outcome:
        where the loop knows better than the truth alone (``interrupted``, ``missed``). goal: (2,)
        where it is in the end, if it has moved: distance and shortest path are those to there.
        hit_count: touches by what moves while the robot stood, which contact_count leaves out.
        """
        if goal is not None:
            self._goal = (float(goal[0]), float(goal[1]))
        outcome = outcome or self.outcome()
        poses = np.array(self._true_poses).reshape(-1, 3)
        path_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
        shortest_m = self._shortest_m()
        spl = 0.0
        if outcome == "reached" and shortest_m is not None:
            spl = shortest_m / max(path_m, shortest_m) if shortest_m > 0.0 else 1.0
        sim_time_s = (self._true_ns[-1] if self._true_ns else 0) / 1e9
        clearance_m = least_clearance(self._floor, poses, self._body)
        return {
            "outcome": outcome,
            "sim_time_s": sim_time_s,
            "wall_time_s": wall_time_s,
            "real_time_factor": sim_time_s / wall_time_s if wall_time_s > 0.0 else None,
            "path_length_m": path_m,
            "shortest_path_m": shortest_m,
            "spl": spl,
            "min_clearance_m": clearance_m if math.isfinite(clearance_m) else None,
            "contact_count": self._last.contact_count if self._last else 0,
            "hit_count": self._last.hit_count if self._last else 0,
            **self._estimation_errors(poses),
            "distance_to_go_m": self.distance_to_go_m(),
            "replans": max(0, len(self._evaluations) - 1),
            "plan_ms_p50": float(np.percentile(plan_ms, 50)) if len(plan_ms) else None,
            "plan_ms_p99": float(np.percentile(plan_ms, 99)) if len(plan_ms) else None,
            "plan_evaluations": sum(self._evaluations),
            "energy_j": self._last.energy_j if self._last else 0.0,
            "shear_work_j": self._tracks.shear_work_j if self._tracks else 0.0,
            "state_hash": state_hash,
            "seed": self._scenario.seed,
            "scenario": self._scenario.name,
            "planner": self._scenario.config.planner.name,
            "versions": versions(),
        }

    def _shortest_m(self) -> float | None:
        scenario = self._scenario
        radius_m = self._body.footprint_radius_m
        length_m = _shortest_m(self._floor, scenario.start[:2], self._goal, radius_m)
        return None if length_m is None else max(0.0, length_m - scenario.goal_tolerance_m)

    def _estimation_errors(self, poses: FloatArray) -> dict[str, Any]:
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
            "health": account(self._health, np.array(self._estimate_ns), error, truth),
        }


@lru_cache(maxsize=8)
def _shortest_m(
    floor: FloorPlan, start: tuple[float, float], goal: tuple[float, float], radius_m: float
) -> float | None:
    """Length of the shortest way; among hundreds of things it takes seconds, and seeds share it."""
    way = shortest_path(floor, np.array(start), np.array(goal), radius_m)
    return None if way is None else way.length_m


def _at(t_ns: FloatArray, true_ns: FloatArray, poses: FloatArray) -> FloatArray:
    """Poses (N, 3) at other instants (M,), linearly between neighbours; yaw unwrapped."""
    x, y, yaw = poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])
    return np.stack([np.interp(t_ns, true_ns, column) for column in (x, y, yaw)], axis=1)
