"""Tables of the papers beside our own measurements, and repeated plans of one planner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from simloop.benchmarks.planners.judge import judge
from simloop.benchmarks.planners.paper_scenes import paper_scene
from simloop.benchmarks.planners.trials import plan_once, plan_timed, prepare
from simloop.config import PlannerConfig
from simloop.messages import FloatArray, Plan

Row = Sequence[str | float]


@dataclass(slots=True)
class PaperTable:
    """A printed table beside the same table measured here.

    Attributes:
        title: Subject of the table.
        source: Paper and number of the table.
        columns: Headings.
        printed: Rows as printed.
        ours: Rows measured here, under the same headings.
        agrees: Remarks on which both sides agree.
        differs: Remarks on which they differ.
    """

    title: str
    source: str
    columns: Sequence[str]
    printed: Sequence[Row]
    ours: list[Row] = field(default_factory=list)
    agrees: list[str] = field(default_factory=list)
    differs: list[str] = field(default_factory=list)

    def note(self, holds: bool, text: str) -> None:
        """Add a remark.

        Args:
            holds: Whether both sides agree on it.
            text: The remark.
        """
        (self.agrees if holds else self.differs).append(text)

    def note_least(self, what: str, values: dict[str, float], expected: str) -> None:
        """Add a remark on which algorithm has the least value.

        Args:
            what: Name of the value.
            values: Algorithm -> value measured here.
            expected: The algorithm that has the least value in print.
        """
        order = sorted(values, key=values.__getitem__)
        shown = ", ".join(f"{name} {values[name]:.4g}" for name in order)
        self.note(
            order[0] == expected, f"Least {what}: {expected} in print; in order here: {shown}."
        )


@dataclass(frozen=True, slots=True)
class Runs:
    """Plans of one planner on one scene, from n seeds.

    Attributes:
        plans: The n plans.
        score: (n,) the judge's score of each plan.
        length: (n,) length, m.
        turning: (n,) turning, rad.
        seconds: (n,) planning time, s.
        success: Share of plans that are safe and reach the goal.
    """

    plans: list[Plan]
    score: FloatArray
    length: FloatArray
    turning: FloatArray
    seconds: FloatArray
    success: float

    @property
    def generations(self) -> np.ndarray:
        """Number of generations that each plan began, (n,)."""
        return np.array([plan.generations for plan in self.plans])


def run_many(scene: str, config: PlannerConfig, runs: int) -> Runs:
    """Plan several times on a paper's scene.

    Args:
        scene: One of `paper_scenes.PAPER_SCENES`.
        config: The planner's settings.
        runs: Number of plans, with the seeds from 0 on.

    Returns:
        The plans and the judge's ratings.
    """
    one = paper_scene(scene)
    planner = prepare(config)
    plan_once(planner, one, 0)  # compiles the kernels, so that the timed plans do not
    plans, verdicts, seconds = [], [], []
    for seed in range(runs):
        plan, took = plan_timed(planner, one, seed)
        plans.append(plan)
        seconds.append(took)
        verdicts.append(judge(one, plans[-1].waypoints_m))
    return Runs(
        plans,
        np.array([v.score for v in verdicts]),
        np.array([v.length_m for v in verdicts]),
        np.array([v.turning_rad for v in verdicts]),
        np.array(seconds),
        float(np.mean([v.success for v in verdicts])),
    )


def min_max_mean_std(values: FloatArray) -> tuple[float, float, float, float]:
    """Compute four columns that most of the tables have.

    Args:
        values: (n,) values.

    Returns:
        Minimum, maximum, mean and standard deviation.
    """
    return float(values.min()), float(values.max()), float(values.mean()), float(values.std())
