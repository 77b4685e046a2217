"""``simloop bench planners``: every planner on every scene, and what can be said of it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from simloop.benchmarks.planners import judge
from simloop.benchmarks.planners.jobs import make_jobs, run_jobs
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
from simloop.config import PlannerConfig
from simloop.evaluation.provenance import machine, versions
from simloop.evaluation.statistics import compare
from simloop.planners import registry

LEAD = "tlbo"
BUDGET, SEEDS, FEW, LEARNERS = 5_000, 12, 3, 100
_LEAD_PLANS = {LEAD: judge.PLANS, PRECISE: judge.PLANS_PRECISE}


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be measured. seeds: at least so many plans a scene; None: `SEEDS` (`FEW` of
    what is slow), and the lead planner on its own scenes as often as its own table asks for."""

    scenes: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()
    budget: int = BUDGET
    seeds: int | None = None
    learners: int = LEARNERS
    workers: int = 0
    history: bool = False

    def check(self) -> None:
        """InputError, one line, for a name that nobody knows or a library that is missing."""
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
                "two looks at the first population"
            )


@dataclass(slots=True)
class Result:
    """All that was measured; ``interrupted`` if it is less than was asked for."""

    request: Request
    tasks: list[Task] = field(default_factory=list)
    trials: dict[str, list[Trial]] = field(default_factory=dict)
    ms: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    lead: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    interrupted: bool = False

    def of(self, scene: str, planner: str) -> list[Trial]:
        """A planner's trials on a scene, by instance and seed."""
        return [trial for trial in self.trials.get(scene, []) if trial.planner == planner]

    def best(self, scene: str) -> dict[str, float | None]:
        """Instance -> J* or the best known."""
        return {task.instance.name: task.best for task in self.tasks if task.scene == scene}

    def scenes(self) -> list[str]:
        """The scenes, in the order asked for."""
        return list(dict.fromkeys(task.scene for task in self.tasks))

    def planners(self, scene: str) -> list[str]:
        """Who has trials on a scene."""
        return list(dict.fromkeys(trial.planner for trial in self.trials.get(scene, [])))


def names(given: list[str] | None) -> tuple[str, ...]:
    """Names given one by one or with commas between them, each once."""
    split = [name.strip() for text in given or () for name in text.split(",")]
    return tuple(dict.fromkeys(name for name in split if name))


def planner_names() -> tuple[str, ...]:
    """The planners that can be compared."""
    return (*registry.available(), PRECISE)


def available_planners() -> tuple[str, ...]:
    """Those of them whose libraries are here."""
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
    """Whether a planner is one of those that the lead planner is to be first among."""
    return name not in (LEAD, PRECISE) and info_of(name).metaheuristic


def run(request: Request, console: Console | None = None) -> Result:
    """Measure. Ctrl-C ends it early: what is there by then is what is returned."""
    request.check()
    console = console or Console(stderr=True)
    result = Result(request)
    names = request.planners or available_planners()
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    with bar:
        try:
            _measure(result, names, bar)
        except KeyboardInterrupt:
            result.interrupted = True
    for scene, trials in result.trials.items():
        trials.sort(key=lambda trial: (trial.planner, trial.instance, trial.seed))
        mine = [task for task in result.tasks if task.scene == scene]
        known = {t.instance.name: t for t in with_best_known(mine, trials)}
        result.tasks = [known.get(t.instance.name, t) for t in result.tasks]
    return result


def _measure(result: Result, names: Sequence[str], bar: Progress) -> None:
    request = result.request
    step = bar.add_task("scenes", total=None)
    for name in request.scenes or scene_names():
        result.tasks += load_scene(name)
    jobs = make_jobs(
        result.tasks, names,
        seeds=request.seeds or SEEDS, budget=request.budget, learners=request.learners,
        history=request.history,
        few=FEW if request.seeds is None else None,
    )  # fmt: skip
    bar.update(step, description="plans", total=len(jobs), completed=0)
    workers = request.workers or os.cpu_count() or 1
    for job, trials in run_jobs(jobs, result.tasks, workers=workers):
        result.trials.setdefault(result.tasks[job.task].scene, []).extend(trials)
        bar.advance(step)
    _time(result, names, bar)


def _time(result: Result, names: Sequence[str], bar: Progress) -> None:
    """Milliseconds, with nothing else running: the first instance of each scene stands for it. The
    lead planner on its own scenes is measured at length instead."""
    pairs = [(scene, name) for scene in result.scenes() for name in names]
    step = bar.add_task("timing", total=len(pairs))
    for scene, name in pairs:
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
    """The JSON: scenes -> planner -> figures, then who is better and by what right."""
    request = result.request
    scenes: dict[str, dict[str, Any]] = {}
    for scene in (name for name in result.scenes() if result.planners(name)):
        scenes[scene] = {name: summary(result, scene, name) for name in result.planners(scene)}
    return {
        "scenes": scenes,
        "comparison": comparison(result),
        "best": {scene: result.best(scene) for scene in result.scenes()},
        "budget": request.budget,
        "learners": request.learners,
        "seeds": request.seeds or SEEDS,
        "interrupted": result.interrupted,
        "machine": machine(),
        "versions": versions(),
    }


def summary(result: Result, scene: str, name: str) -> dict[str, float | int | None]:
    """One planner on one scene. Milliseconds; gaps in percent of the best J, of the score, which
    prices what a path lacks; None where nothing is known to compare with."""
    trials, best = result.of(scene, name), result.best(scene)
    gaps = gaps_of(trials, best)
    spread: dict[str, list[float]] = {}
    for trial in trials:
        spread.setdefault(trial.instance, []).append(trial.verdict.score)
    ms = result.ms.get((scene, name), [])
    found: dict[str, float | int | None] = {
        "ms_p50": float(np.percentile(ms, 50)) if ms else None,
        "ms_p99": float(np.percentile(ms, 99)) if ms else None,
        "gap_p50": float(np.percentile(gaps, 50)) if gaps else None,
        "gap_p95": float(np.percentile(gaps, 95)) if gaps else None,
        "safe": float(np.mean([trial.verdict.safe for trial in trials])),
        "success": float(np.mean([trial.verdict.success for trial in trials])),
        "std": float(np.mean([np.std(scores) for scores in spread.values()])),
        "evaluations": float(np.mean([trial.evaluations for trial in trials])),
        "length": float(np.median([trial.verdict.length_m for trial in trials])),
        "turning": float(np.median([trial.verdict.turning_rad for trial in trials])),
        "plans": len(trials),
        "timed": len(ms),
    }
    at_length = result.lead.get((scene, name))
    if at_length is not None:
        found |= {**at_length, "timed": int(at_length["plans"])}
    return found


def gaps_of(trials: Sequence[Trial], best: dict[str, float | None]) -> list[float]:
    """Gap of each trial's score, %, where there is a best J."""
    found = []
    for trial in trials:
        least = best[trial.instance]
        if least is not None:
            found.append(100.0 * (trial.verdict.score / least - 1.0))
    return found


def comparison(result: Result) -> dict[str, dict[str, Any]]:
    """Scene -> rival -> the lead planner's gaps against it, paired by instance and seed; with
    ``S1-S4`` over all of the project's own scenes at once."""
    gaps: dict[str, dict[str, dict[tuple[str, int], float]]] = {}
    for scene in result.scenes():
        best = result.best(scene)
        for name in result.planners(scene):
            if name == LEAD or is_metaheuristic(name):
                trials = [t for t in result.of(scene, name) if best[t.instance] is not None]
                values = gaps_of(trials, best)
                keyed = {
                    (trial.instance, trial.seed): gap
                    for trial, gap in zip(trials, values, strict=True)
                }
                gaps.setdefault(scene, {})[name] = keyed
                if scene in SCENE_NAMES:
                    pooled = gaps.setdefault("S1-S4", {}).setdefault(name, {})
                    pooled.update(keyed)
    return {scene: _compare(named) for scene, named in gaps.items() if len(named) > 1}


def _compare(named: dict[str, dict[tuple[str, int], float]]) -> dict[str, Any]:
    lead = named.get(LEAD, {})
    pairs = {
        name: [(lead[key], gap) for key, gap in keyed.items() if key in lead]
        for name, keyed in named.items()
        if name != LEAD
    }
    keys = sorted(set(lead).intersection(*[set(keyed) for keyed in named.values()]))
    if not keys or not pairs:
        return {}
    found = compare(
        [lead[key] for key in keys],
        {name: [named[name][key] for key in keys] for name in pairs},
    )
    return {name: asdict(one) for name, one in found.items()}


def print_figures(console: Console, found: dict[str, Any]) -> None:
    """The figures as tables for the terminal."""
    from simloop.common.terminal import print_table

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
        print_table(console, f"{scene}: cold plans, on {found['machine']['cpu']}", header, rows)


def rank(at: dict[str, Any]) -> tuple[float, float]:
    """What a planner's figures are sorted by: success, then the median gap."""
    gap = at["gap_p50"]
    return (-at["success"], np.inf if gap is None else gap)


def _show(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
