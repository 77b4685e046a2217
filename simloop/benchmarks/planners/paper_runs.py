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
_DRAWN, _CURVE_POINTS = 5, 60


@dataclass(frozen=True, slots=True)
class Panel:
    """Some paths of one algorithm on a paper's scene, to be drawn.

    Attributes:
        scene: Name of the scene.
        label: Name of the algorithm.
        paths_m: Paths (M, 2), m.
        safe: Whether each path is safe and reaches the goal.
    """

    scene: str
    label: str
    paths_m: list[FloatArray]
    safe: list[bool]


@dataclass(slots=True)
class Pictures:
    """What is drawn beside a table.

    Attributes:
        panels: Paths, one panel for each algorithm.
        curves: Algorithm -> (N, 2) evaluations and the median of the best J so far.
        samples: Name of a value -> algorithm -> (n,) the value in each run.
        note: What to know about the pictures.
    """

    panels: list[Panel] = field(default_factory=list)
    curves: dict[str, FloatArray] = field(default_factory=dict)
    samples: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    note: str = ""


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
        pictures: What is drawn beside the table.
    """

    title: str
    source: str
    columns: Sequence[str]
    printed: Sequence[Row]
    ours: list[Row] = field(default_factory=list)
    agrees: list[str] = field(default_factory=list)
    differs: list[str] = field(default_factory=list)
    pictures: Pictures = field(default_factory=Pictures)

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
        succeeded: (n,) whether each plan is safe and reaches the goal.
    """

    plans: list[Plan]
    score: FloatArray
    length: FloatArray
    turning: FloatArray
    seconds: FloatArray
    succeeded: np.ndarray

    @property
    def success(self) -> float:
        """Share of the plans that are safe and reach the goal, 0 to 1."""
        return float(np.mean(self.succeeded))

    @property
    def generations(self) -> np.ndarray:
        """Number of generations that each plan began, (n,)."""
        return np.array([plan.generations for plan in self.plans])

    def first(self, count: int) -> Runs:
        """Choose the first plans.

        Args:
            count: Number of plans.

        Returns:
            The plans of the seeds from 0 to ``count`` - 1, or all if there are fewer.
        """
        return Runs(
            self.plans[:count],
            self.score[:count],
            self.length[:count],
            self.turning[:count],
            self.seconds[:count],
            self.succeeded[:count],
        )

    def panel(self, scene: str, label: str) -> Panel:
        """Choose some paths to draw.

        Args:
            scene: Name of the scene.
            label: Name of the algorithm.

        Returns:
            The paths of the first seeds.
        """
        paths = [plan.waypoints_m for plan in self.plans[:_DRAWN]]
        return Panel(scene, label, paths, [bool(one) for one in self.succeeded[:_DRAWN]])

    def curve(self) -> FloatArray:
        """Compute how the best J falls with the evaluations.

        Returns:
            (N, 2) evaluations and the median, over the plans, of the best J so far; empty if the
            planner keeps no history.
        """
        histories = [plan.history for plan in self.plans if len(plan.history)]
        if not histories:
            return np.zeros((0, 2))
        first = max(history[0, 0] for history in histories)
        last = max(plan.evaluations for plan in self.plans)
        grid = np.geomspace(first, max(last, first + 1.0), _CURVE_POINTS)
        rows = [h[np.searchsorted(h[:, 0], grid, side="right") - 1, 1] for h in histories]
        return np.column_stack([grid, np.median(rows, axis=0)])


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
        np.array([v.success for v in verdicts]),
    )


def min_max_mean_std(values: FloatArray) -> tuple[float, float, float, float]:
    """Compute four columns that most of the tables have.

    Args:
        values: (n,) values.

    Returns:
        Minimum, maximum, mean and standard deviation.
    """
    return float(values.min()), float(values.max()), float(values.mean()), float(values.std())
