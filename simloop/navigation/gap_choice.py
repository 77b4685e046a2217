"""Which gaps to go through: one planner for each distance from obstacles, and a choice.

A path that is shortest at the safety distance may lead through a gap that is only just wide
enough as far as has been seen: what is seen on arrival often closes it, and the way there and
back is lost. So a way with more room is taken where it costs little more; and where the way
round is long, a gap that is a little too narrow is taken after all.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from simloop.config import Config
from simloop.messages import FloatArray, Plan, WorldView
from simloop.navigation.bezier_smoother import Smoother
from simloop.planners.registry import make_planner

_LONG_WAY_ROUND_M = 0.3  # more than this saved is worth a squeeze
_HARD = 5000  # evaluations of a plan after which there is no time for a second one


class _Width:
    """A planner and a smoother that keep the same distance from obstacles, m."""

    def __init__(self, config: Config, safe_distance_m: float) -> None:
        planner = replace(config.planner, safe_distance_m=safe_distance_m)
        self.planner = make_planner(planner, config.vehicle)
        self.smoother = Smoother(config.smoother, config.vehicle, safe_distance_m)


class WidthPlanner:
    """Plans at the safety distance, and at another where that is promising."""

    def __init__(self, config: Config, rng: np.random.Generator) -> None:
        self._config, self._rng = config.planner, rng
        safe = config.planner.safe_distance_m
        self._squeezes = config.planner.squeeze_m > 0.0
        self._usual = _Width(config, safe)
        self._tight = _Width(config, safe - config.planner.squeeze_m)
        self._roomy = _Width(config, safe + config.planner.prefer_m)

    def distrust_tight_gaps(self) -> None:
        """The robot has got stuck: from now on no gap below the safety distance is tried."""
        self._squeezes = False

    def plan(
        self,
        view: WorldView,
        pose: FloatArray,
        goal: FloatArray,
        previous: Plan | None,
        reason: str,
    ) -> tuple[Plan, Smoother]:
        """The plan from ``pose`` (3,) to ``goal`` (2,), both in map, and the smoother that goes
        with it. The plan's evaluations are those of all that was tried."""
        spent = 0

        def plan_with(width: _Width) -> Plan:
            nonlocal spent
            found = width.planner.plan(
                view, pose, goal, self._rng, previous=previous, reason=reason
            )
            spent += found.evaluations
            return found

        config, plan = self._config, plan_with(self._usual)
        hoped = math.dist(pose[:2], goal) if previous is None else left_of(previous, pose)
        if not plan.safe or plan.length_m > hoped + _LONG_WAY_ROUND_M:
            if self._squeezes:
                tight = plan_with(self._tight)
                if tight.safe and (
                    not plan.safe or tight.length_m < plan.length_m - _LONG_WAY_ROUND_M
                ):
                    return replace(tight, evaluations=spent), self._tight.smoother
        elif config.prefer_m > 0.0 and plan.evaluations <= _HARD:
            roomy = plan_with(self._roomy)
            if roomy.safe and roomy.cost < plan.cost * (1.0 + config.prefer_share):
                return replace(roomy, evaluations=spent), self._roomy.smoother
        return replace(plan, evaluations=spent), self._usual.smoother


def left_of(plan: Plan, pose: FloatArray) -> float:
    """Length, m, of what is left of a plan from the waypoint nearest ahead of ``pose`` (3,)."""
    points = plan.waypoints_m
    legs = np.diff(points, axis=0)
    squares = np.maximum((legs**2).sum(axis=1), 1e-12)
    share = np.clip(((pose[:2] - points[:-1]) * legs).sum(axis=1) / squares, 0.0, 1.0)
    feet = points[:-1] + share[:, None] * legs
    k = int(np.argmin(np.hypot(*(feet - pose[:2]).T)))
    lengths = np.sqrt(squares)
    return float((1.0 - share[k]) * lengths[k] + lengths[k + 1 :].sum())
