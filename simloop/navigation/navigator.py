"""Navigation: when to plan, to which place, in which view of the world, and along which path.

reason -> goal -> view (map, movers) -> gap choice (planner) -> plan -> smoother -> path
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.geometry.se2 import about_face
from simloop.messages import (
    Estimate,
    Event,
    FloatArray,
    GoalReading,
    Message,
    MoverTracks,
    Plan,
    SmoothPath,
    WorldView,
)
from simloop.navigation.bezier_smoother import Smoother
from simloop.navigation.feasibility import Feasibility, stands_in_the_way
from simloop.navigation.gap_choice import GapChooser
from simloop.navigation.moving_goal import MovingGoal
from simloop.navigation.planner_world import add_predicted_movers, with_free_rim

_BLOCKED_SLACK_M = 0.02  # shortfall within the map's resolution; it does not block a path
_HOPELESS_NS = 500_000_000  # least time between replans for a blockage that cannot be avoided
_MOVERS_M = 3.0  # only a mover nearer than this makes an old plan doubtful
_MOVERS_NS = 600_000_000  # a plan older than this counts as old
_NEXT_M = 0.4  # distance along its path to the next place of a robot that must wait
_NOTHING = np.empty((0, 2))


class PlanReason(StrEnum):
    """Why the robot plans."""

    FIRST = "first"
    FRAME = "frame"
    BLOCKED = "blocked"
    MOVER = "mover"
    GOAL = "goal"
    RECOVERED = "recovered"
    STALE = "stale"


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What navigation receives in one period about the robot's surroundings.

    Attributes:
        new_scan: Whether a scan came in this period.
        movers: The tracked movers; None if no mover is known.
        standing_m: Obstacles that no scan shows, (k, 2) in map, m: first with all guesses about
            them, then without; ``[None]`` for a robot without a camera.
        view: Returns the map as a planner sees it, for a place (2,) that the view must cover and
            one item of ``standing_m``.
    """

    new_scan: bool
    movers: MoverTracks | None
    standing_m: Sequence[FloatArray | None]
    view: Callable[[FloatArray, FloatArray | None], WorldView]


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """How far the robot has moved along its path.

    Attributes:
        path: The path that the robot follows; None if there is none.
        next_sample: Index of the first sample of the path that lies ahead.
        is_old: Whether the watchdog considers the path too old.
        may_plan: Whether the robot may plan: it has a map, has not arrived and is not freeing
            itself.
    """

    path: SmoothPath | None
    next_sample: int
    is_old: bool
    may_plan: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    """A plan that becomes available when its planning time has passed."""

    due_ns: int
    plan: Plan
    view: WorldView


class Navigator:
    """Plans, and returns a new path when there is one.

    Attributes:
        messages: The messages to publish in this period; the caller clears them.
        path_ns: Time when the robot took up the last path, ns.
    """

    def __init__(
        self,
        config: Config,
        goal: FloatArray,
        goal_tolerance_m: float,
        rng: np.random.Generator,
        profiler: Profiler,
        has_camera: bool = False,
    ) -> None:
        """Create the navigator for a goal (2,) in map, m."""
        if has_camera:
            config = _with_camera(config)
        self._config = config
        self._goal = MovingGoal(goal)
        self._planner = GapChooser(config, rng)
        self._smoother = Smoother(config.smoother, config.vehicle)
        self._feasibility = Feasibility(goal_tolerance_m, config.vehicle.width_m)
        self._pace_mps = config.drive.max_speed_mps
        self._plan_ns = round(config.rates.plan_s * 1e9)
        self._offsets = np.array(config.vehicle.footprint_offsets_m)
        self._plan: Plan | None = None
        self._pending: _Pending | None = None
        self._unchecked: list[FloatArray] = []
        self._planned_ns = self.path_ns = 0
        self.messages: list[Message] = []
        self._time = {name: profiler.stage(name) for name in ("slam", "planner", "smoother")}

    @property
    def goal_is_closed_off(self) -> bool:
        """Whether the robot considers its goal unreachable."""
        return self._feasibility.hopeless

    @property
    def goal_moves(self) -> bool:
        """Whether the robot has ever had a reading of a moving goal."""
        return self._goal.moves

    def hear_goal(self, reading: GoalReading) -> None:
        """Update the goal with a reading.

        Args:
            reading: The measured position of the goal.
        """
        self._goal.update(reading)

    def goal_at(self, t_ns: int) -> FloatArray:
        """Predict where the goal is at a time.

        Args:
            t_ns: The time, ns.

        Returns:
            (2,) in map, m.
        """
        return self._goal.position_at(t_ns)

    def note_surfaces(self, surfaces_m: FloatArray) -> None:
        """Add new surfaces of the map, to be checked against the path.

        Args:
            surfaces_m: (k, 2) in map, m.
        """
        self._unchecked.append(surfaces_m)

    def forget(self) -> None:
        """Drop the plan, because the robot is not where it believed to be."""
        self._plan = self._pending = None
        self._unchecked.clear()

    def distrust_narrow_gaps(self) -> None:
        """Stop trying gaps below the safety distance, because the robot got stuck."""
        self._planner.stop_trying_tight_gaps()

    def is_due(self, t_ns: int) -> bool:
        """Say whether there is something to do even without news: a plan to make or to take up.

        Args:
            t_ns: The instant, ns.

        Returns:
            True if `step` must be called in this period.
        """
        return self._plan is None or self._pending is not None or t_ns % self._plan_ns == 0

    def step(self, estimate: Estimate, now: Surroundings, progress: Progress) -> Plan | None:
        """Plan if there is a reason to.

        Args:
            estimate: The present belief.
            now: The robot's surroundings.
            progress: How far the robot has moved along its path.

        Returns:
            The plan to follow from now on, if there is a new one; pass it on with `smooth`.
        """
        reason = self._reason_to_plan(estimate, now, progress)
        if reason is not None:
            self._replan(estimate, reason, now)
        if self._pending is None or estimate.t_ns < self._pending.due_ns:
            return None
        return self._pending.plan

    def smooth(self, estimate: Estimate, reverses: bool) -> SmoothPath:
        """Take up the plan that `step` returned and smooth it.

        Args:
            estimate: The present belief.
            reverses: Whether the robot drives rear first.

        Returns:
            The smooth path to follow.
        """
        assert self._pending is not None
        pending, self._pending = self._pending, None
        self._plan, self.path_ns = pending.plan, estimate.t_ns
        pose = about_face(estimate.pose) if reverses else estimate.pose
        with self._time["smoother"]:
            path = self._smoother.smooth(pending.plan, pending.view, pose)
        self.messages.append(path)
        if pending.plan.safe and not path.safe:
            text = "the smoothed path is closer to an obstacle than the safety distance"
            self.messages.append(Event(estimate.t_ns, "info", text))
        return path

    def next_place(self, pose: FloatArray, progress: Progress) -> FloatArray | None:
        """Find the first place of the path ahead that is not too near to the robot.

        Args:
            pose: (3,) of base_link in map, m, m, rad.
            progress: How far the robot has moved along its path.

        Returns:
            (2,) in map, m; None without a path.
        """
        if progress.path is None:
            return None
        ahead = progress.path.xy_m[progress.next_sample :]
        far = np.hypot(*(ahead - pose[:2]).T) > _NEXT_M
        return np.asarray(ahead[int(np.argmax(far)) if far.any() else -1])

    def _reason_to_plan(
        self, estimate: Estimate, now: Surroundings, progress: Progress
    ) -> PlanReason | None:
        """Return why to plan now; None if there is no reason to."""
        if not progress.may_plan or self._pending is not None:
            return None
        if self._plan is None:
            return PlanReason.FIRST
        if estimate.t_ns % self._plan_ns == 0:
            return PlanReason.FRAME
        if now.new_scan and self._is_blocked(estimate, progress):
            return PlanReason.BLOCKED
        if now.new_scan and self._is_near_movers(estimate, now.movers):
            return PlanReason.MOVER
        if now.new_scan and self._goal.is_out_of_date(estimate.t_ns, estimate.pose, self._pace_mps):
            return PlanReason.GOAL
        if progress.path is None:
            return PlanReason.RECOVERED
        return PlanReason.STALE if progress.is_old else None

    def _is_near_movers(self, estimate: Estimate, movers: MoverTracks | None) -> bool:
        """Whether a mover is so near that an older plan may lead into its way."""
        if movers is None or estimate.t_ns - self._planned_ns < _MOVERS_NS:
            return False
        return bool((np.hypot(*(movers.position_m - estimate.pose[:2]).T) < _MOVERS_M).any())

    def _is_blocked(self, estimate: Estimate, progress: Progress) -> bool:
        """Whether surfaces that are newer than the plan's view block the path."""
        path = progress.path
        if path is None or self._plan is None:
            return False
        hopeless = not (self._plan.safe and path.safe)
        if hopeless and estimate.t_ns - self._planned_ns < _HOPELESS_NS:
            return False
        limit = self._config.planner.safe_distance_m - _BLOCKED_SLACK_M
        with self._time["slam"]:
            surfaces = np.concatenate(self._unchecked or [_NOTHING])
            self._unchecked.clear()
            return stands_in_the_way(
                surfaces,
                path.xy_m,
                path.yaw_rad,
                path.clearance_m,
                progress.next_sample,
                self._offsets,
                limit,
                _BLOCKED_SLACK_M,
            )

    def _replan(self, estimate: Estimate, reason: PlanReason, now: Surroundings) -> None:
        """Plan with all guessed obstacles; if that gives no safe plan, plan without them."""
        self._unchecked.clear()
        pose, t_ns, spent = estimate.pose, estimate.t_ns, 0
        for standing in now.standing_m:
            with self._time["slam"]:
                still = now.view(self._goal.position_at(t_ns), standing)
            with self._time["planner"]:
                room = self._config.planner.safe_distance_m
                goal = self._goal.aim(still, pose, self._pace_mps, room)
                view = add_predicted_movers(still, now.movers, pose, self._pace_mps)
                plan, view = self._find_way(view, pose, goal, reason)
            spent += plan.evaluations
            if plan.safe:
                break
        plan = replace(plan, evaluations=spent)
        self._planned_ns = t_ns
        self._pending = _Pending(t_ns + self._latency_ns(plan), plan, view)
        self.messages += [plan, view]
        # A mover may close a way off and clear it again, so it is no reason to give the goal up.
        stands_still = now.movers is None
        if stands_still and self._feasibility.update(still, pose, goal, plan.safe):
            text = "the goal cannot be reached: known obstacles close it off"
            self.messages.append(Event(t_ns, "warning", text))
        if not plan.safe:
            text = "no safe path found; continuing with the best path"
            self.messages.append(Event(t_ns, "warning", text))

    def _find_way(
        self, view: WorldView, pose: FloatArray, goal: FloatArray, reason: PlanReason
    ) -> tuple[Plan, WorldView]:
        """Return the plan from ``pose`` (3,) to ``goal`` (2,), and the view that it was made in."""
        plan = self._planner.plan(view, pose, goal, self._plan, reason)
        if plan.safe or view.movers is not None:  # a mover will clear the way again
            return plan, view
        wider = with_free_rim(view)
        other = self._planner.plan(wider, pose, goal, self._plan, reason)
        spent = plan.evaluations + other.evaluations
        if other.safe:
            return replace(other, evaluations=spent), wider
        return replace(plan, evaluations=spent), view

    def _latency_ns(self, plan: Plan) -> int:
        """Return the simulated planning time, ns: it comes from the settings, not from a clock."""
        planner = self._config.planner
        runs = plan.evaluations if planner.latency == "per_evaluation" else 1
        period = round(self._config.rates.control_s * 1e9)
        return round(planner.latency_s * runs * 1e9 / period) * period


def plan_heading(plan: Plan) -> float:
    """Compute the heading at the start of a plan.

    Args:
        plan: The plan, with at least two waypoints.

    Returns:
        Heading of the plan's first leg, rad, in map.
    """
    ahead, aside = (plan.waypoints_m[1] - plan.waypoints_m[0]).tolist()
    return math.atan2(aside, ahead)


def _with_camera(config: Config) -> Config:
    """Return the settings for a robot with a camera, which turns on the spot at smaller angles."""
    smoother = config.smoother
    turn = min(smoother.lead_in_max_turn_rad, smoother.lead_in_max_turn_with_camera_rad)
    return replace(config, smoother=replace(smoother, lead_in_max_turn_rad=turn))
