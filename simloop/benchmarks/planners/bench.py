"""``simloop bench planners``: run every planner on every scene and compare them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from simloop.benchmarks.planners import judge
from simloop.benchmarks.planners.bench_figures import (
    Gaps,
    compare_with_lead,
    gaps_of,
    rank,
    summary,
)
from simloop.benchmarks.planners.jobs import left_out, make_jobs, run_jobs
from simloop.benchmarks.planners.scenes import SCENE_NAMES
from simloop.benchmarks.planners.tasks import (
    Task,
    check_scene,
    load_scene,
    scene_names,
    with_best_known,
)
from simloop.benchmarks.planners.trials import (
    PRECISE,
    Trial,
    handles,
    info_of,
    prepare,
    settings,
    time_plans,
)
from simloop.common.errors import InputError, did_you_mean
from simloop.common.pool import processes
from simloop.common.terminal import print_lines, print_table
from simloop.config import PlannerConfig
from simloop.evaluation.provenance import machine, versions
from simloop.planners import registry

LEAD = "tlbo"
BUDGET, LEARNERS = 5_000, 100
SEEDS, SEEDS_SLOW = 12, 3
_POOLED = "S1-S4"
_LEAD_PLANS = {LEAD: judge.PLANS, PRECISE: judge.PLANS_PRECISE}


@dataclass(frozen=True, slots=True)
class Request:
    """Settings of a comparison.

    Attributes:
        scenes: Names of scenes or map files; empty: all built-in scenes.
        planners: Names of planners; empty: all whose libraries are installed.
        budget: Largest number of evaluations per plan.
        seeds: Least number of plans for each planner and scene. None: `SEEDS`, or `SEEDS_SLOW` for
            slow planners, and the lead planner is measured on S1 to S4 by `judge.measure`.
        learners: Size of the first population.
        workers: Number of processes; 0: one for each core.
        history: Whether planners without a history are run again with smaller budgets to get one.
    """

    scenes: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()
    budget: int = BUDGET
    seeds: int | None = None
    learners: int = LEARNERS
    workers: int = 0
    history: bool = False

    def check(self) -> None:
        """Check the request before anything is measured.

        Raises:
            InputError: A name is unknown, a library is missing or the budget is too small.
        """
        for name in self.scenes:
            check_scene(name)
        for name in self.planners:
            if name not in planner_names():
                raise InputError(f"--planners {name}: unknown{did_you_mean(name, planner_names())}")
            if name != PRECISE:
                prepare(PlannerConfig(name=name))
        if self.budget <= 2 * self.learners:
            raise InputError(
                f"--budget {self.budget}: must be more than {2 * self.learners}, "
                "two evaluations of the first population"
            )


@dataclass(slots=True)
class Result:
    """Everything that was measured.

    Attributes:
        request: The settings of the comparison.
        tasks: The tasks of all scenes.
        trials: Scene -> trials of all planners.
        ms: Scene and planner -> planning times, ms.
        lead: Scene and planner -> figures of `judge.measure`.
        interrupted: Whether the measurement was stopped early.
    """

    request: Request
    tasks: list[Task] = field(default_factory=list)
    trials: dict[str, list[Trial]] = field(default_factory=dict)
    ms: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    lead: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    interrupted: bool = False

    def trials_of(self, scene: str, planner: str) -> list[Trial]:
        """Collect a planner's trials on a scene.

        Args:
            scene: Name of the scene.
            planner: Name of the planner.

        Returns:
            The trials, ordered by instance and seed.
        """
        return [trial for trial in self.trials.get(scene, []) if trial.planner == planner]

    def best_costs(self, scene: str) -> dict[str, float | None]:
        """Collect the best known J of each instance of a scene.

        Args:
            scene: Name of the scene.

        Returns:
            Instance -> J* or the best known J; None if nothing is known.
        """
        return {task.instance.name: task.best for task in self.tasks if task.scene == scene}

    def scenes(self) -> list[str]:
        """List the scenes in the order of the request.

        Returns:
            Names of the scenes.
        """
        return list(dict.fromkeys(task.scene for task in self.tasks))

    def planners(self, scene: str) -> list[str]:
        """List the planners that have trials on a scene.

        Args:
            scene: Name of the scene.

        Returns:
            Names of the planners.
        """
        return list(dict.fromkeys(trial.planner for trial in self.trials.get(scene, [])))


def names(given: list[str] | None) -> tuple[str, ...]:
    """Split names that are given one by one or separated by commas.

    Args:
        given: Values of a command line option; None if it was not used.

    Returns:
        Each name once, in order.
    """
    split = [name.strip() for text in given or () for name in text.split(",")]
    return tuple(dict.fromkeys(name for name in split if name))


def planner_names() -> tuple[str, ...]:
    """List the planners that can be compared.

    Returns:
        Names, whether or not their libraries are installed.
    """
    return (*registry.available(), PRECISE)


def available_planners() -> tuple[str, ...]:
    """List the planners whose libraries are installed.

    Returns:
        Their names.
    """
    found = []
    for name in planner_names():
        try:
            if name != PRECISE:
                prepare(PlannerConfig(name=name))
        except InputError:
            continue
        found.append(name)
    return tuple(found)


def is_metaheuristic(name: str) -> bool:
    """Tell whether a planner is a metaheuristic that the lead planner is compared with.

    Args:
        name: Name of the planner.

    Returns:
        Whether it is.
    """
    return name not in (LEAD, PRECISE) and info_of(name).metaheuristic


def run(
    request: Request, console: Console | None = None, stop: Callable[[], bool] = lambda: False
) -> Result:
    """Measure everything in a request.

    Args:
        request: Settings of the comparison.
        console: Console for the progress; None: the standard error stream.
        stop: Called several times a second. Once it returns True, the measurement ends.

    Returns:
        The measurements, up to a stop or a KeyboardInterrupt if there is one.

    Raises:
        InputError: The request is wrong.
    """
    request.check()
    console = console or Console(stderr=True)
    result = Result(request)
    chosen = request.planners or available_planners()
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    with bar:
        try:
            _measure(result, chosen, bar, stop)
            result.interrupted = stop()
        except KeyboardInterrupt:
            result.interrupted = True
    for scene, trials in result.trials.items():
        trials.sort(key=lambda trial: (trial.planner, trial.instance, trial.seed))
        mine = [task for task in result.tasks if task.scene == scene]
        known = {t.instance.name: t for t in with_best_known(mine, trials)}
        result.tasks = [known.get(t.instance.name, t) for t in result.tasks]
    return result


def _measure(
    result: Result, planners: Sequence[str], bar: Progress, stop: Callable[[], bool]
) -> None:
    """Load the scenes, run all trials in processes, then time the planners one by one."""
    request = result.request
    step = bar.add_task("scenes", total=None)
    for name in request.scenes or scene_names():
        result.tasks += load_scene(name)
    jobs = make_jobs(
        result.tasks, planners,
        seeds=request.seeds or SEEDS, budget=request.budget, learners=request.learners,
        history=request.history,
        few=SEEDS_SLOW if request.seeds is None else None,
    )  # fmt: skip
    print_lines(bar.console, left_out(result.tasks, planners), "note: ")
    if not jobs:
        raise InputError("--planners: none of these can plan in the worlds of these --scenes")
    bar.update(step, description="plans", total=len(jobs), completed=0)
    workers = processes(request.workers)
    for job, trials in run_jobs(jobs, result.tasks, workers=workers, stop=stop):
        result.trials.setdefault(result.tasks[job.task].scene, []).extend(trials)
        bar.advance(step)
    _time(result, planners, bar, stop)


def _time(result: Result, planners: Sequence[str], bar: Progress, stop: Callable[[], bool]) -> None:
    """Time the planners with nothing else running, on the first instance of each scene.

    By default the lead planner is measured on S1 to S4 with many plans instead.
    """
    pairs = [(scene, name) for scene in result.scenes() for name in planners]
    step = bar.add_task("timing", total=len(pairs))
    for scene, name in pairs:
        if stop():
            return
        bar.advance(step)
        tasks = [task for task in result.tasks if task.scene == scene]
        if result.request.seeds is None and name in _LEAD_PLANS and scene in SCENE_NAMES:
            todo = [(task.instance, task.best) for task in tasks if task.best is not None]
            config = PlannerConfig(name=LEAD, precise=name == PRECISE)
            result.lead[scene, name] = judge.measure(todo, config, _LEAD_PLANS[name])
            continue
        one = tasks[0].instance
        if handles(name, one):
            config = settings(name, one, result.request.budget, result.request.learners)
            result.ms[scene, name] = time_plans(name, one, config)


def figures(result: Result) -> dict[str, Any]:
    """Compute the figures of a comparison.

    Args:
        result: The measurements.

    Returns:
        What ``simloop bench planners --json`` writes: scene -> planner -> figures, the comparison
        with the lead planner, and the conditions of the measurement.
    """
    request = result.request
    scenes: dict[str, dict[str, Any]] = {}
    for scene in (name for name in result.scenes() if result.planners(name)):
        best = result.best_costs(scene)
        scenes[scene] = {
            name: summary(
                result.trials_of(scene, name),
                best,
                result.ms.get((scene, name), []),
                result.lead.get((scene, name)),
            )
            for name in result.planners(scene)
        }
    return {
        "scenes": scenes,
        "comparison": comparison(result),
        "best": {scene: result.best_costs(scene) for scene in result.scenes()},
        "budget": request.budget,
        "learners": request.learners,
        "seeds": request.seeds or SEEDS,
        "interrupted": result.interrupted,
        "machine": machine(),
        "versions": versions(),
    }


def comparison(result: Result) -> dict[str, dict[str, Any]]:
    """Compare the lead planner with the other metaheuristics, paired by instance and seed.

    Args:
        result: The measurements.

    Returns:
        Scene -> rival -> test of the difference. The scene ``S1-S4`` pools the project's scenes.
    """
    gaps: dict[str, dict[str, Gaps]] = {}
    for scene in result.scenes():
        best = result.best_costs(scene)
        for name in result.planners(scene):
            if name == LEAD or is_metaheuristic(name):
                trials = [t for t in result.trials_of(scene, name) if best[t.instance] is not None]
                values = gaps_of(trials, best)
                keyed = {
                    (trial.instance, trial.seed): gap
                    for trial, gap in zip(trials, values, strict=True)
                }
                gaps.setdefault(scene, {})[name] = keyed
                if scene in SCENE_NAMES:
                    pooled = gaps.setdefault(_POOLED, {}).setdefault(name, {})
                    pooled.update(keyed)
    return {
        scene: compare_with_lead(named, LEAD) for scene, named in gaps.items() if len(named) > 1
    }


def print_figures(console: Console, found: dict[str, Any]) -> None:
    """Print one table for each scene, the best planner first.

    Args:
        console: Console to print to.
        found: The figures from `figures`.
    """
    header = [
        "planner",
        "ms p50",
        "p99",
        "gap % p50",
        "p95",
        "safe %",
        "success %",
        "std",
        "trials",
    ]
    for scene, named in found["scenes"].items():
        order = sorted(named, key=lambda name: rank(named[name]))
        rows = [
            [
                name, _show(at["ms_p50"], 2), _show(at["ms_p99"], 2), _show(at["gap_p50"], 3),
                _show(at["gap_p95"], 3), f"{100.0 * at['safe']:.1f}",
                _show(None if "success" not in at else 100.0 * at["success"], 1),
                _show(at["std"], 4), f"{at['evaluations']:.0f}",
            ]
            for name, at in ((name, named[name]) for name in order)
        ]  # fmt: skip
        print_table(
            console,
            f"{scene}: plans without a previous plan, on {found['machine']['cpu']}",
            header,
            rows,
        )


def _show(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
