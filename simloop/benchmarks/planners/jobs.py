"""Divide the planner benchmark into jobs and run them, on several processes if requested."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from simloop.benchmarks.planners.scenes import Instance
from simloop.benchmarks.planners.tasks import Task
from simloop.benchmarks.planners.trials import (
    Trial,
    handles,
    info_of,
    settings,
    try_once,
)
from simloop.common import pool


@dataclass(frozen=True, slots=True)
class Job:
    """All trials of one planner on one task.

    Attributes:
        task: The task's index in the benchmark's list of tasks.
        planner: The planner's name.
        seeds: The seed of each trial.
        budget: Number of evaluations of the objective that each plan may use.
        learners: The size of a population.
        history: Whether the best cost is stored as a function of the evaluations.
    """

    task: int
    planner: str
    seeds: tuple[int, ...]
    budget: int
    learners: int
    history: bool


def make_jobs(
    tasks: Sequence[Task],
    planners: Sequence[str],
    *,
    seeds: int,
    budget: int,
    learners: int,
    history: bool = False,
    few: int | None = None,
) -> list[Job]:
    """Make the jobs of a benchmark.

    A scene's plans are shared equally by its instances. A deterministic planner plans only once
    on each instance. A planner that cannot plan in a kind of world gets no job there.

    Args:
        tasks: The tasks: all instances of all scenes.
        planners: The planners' names.
        seeds: Least number of plans of each planner on each scene.
        budget: Number of evaluations of the objective that each plan may use.
        learners: The size of a population.
        history: Whether the trials store the best cost as a function of the evaluations.
        few: Largest number of plans of a slow planner on each instance. None: no limit.

    Returns:
        The jobs, task by task.
    """
    instances: dict[str, int] = {}
    for task in tasks:
        instances[task.scene] = instances.get(task.scene, 0) + 1
    jobs = []
    for number, task in enumerate(tasks):
        each = -(-seeds // instances[task.scene])
        for name in planners:
            if handles(name, task.instance):
                most = few if few is not None and info_of(name).slow else each
                wanted = range(min(each, most) if info_of(name).stochastic else 1)
                jobs.append(Job(number, name, tuple(wanted), budget, learners, history))
    return jobs


def left_out(tasks: Sequence[Task], planners: Sequence[str]) -> list[str]:
    """Describe the planners that get no job on a scene.

    Args:
        tasks: The tasks: all instances of all scenes.
        planners: The planners' names.

    Returns:
        A sentence for each scene in whose world some of the planners cannot plan.
    """
    said = []
    for scene in dict.fromkeys(task.scene for task in tasks):
        mine = [task.instance for task in tasks if task.scene == scene]
        names = [name for name in planners if not any(handles(name, one) for one in mine)]
        if names:
            said.append(f"{scene}: not for worlds of this kind, so left out: {', '.join(names)}")
    return said


def do_job(job: Job, one: Instance, stop: Callable[[], bool] = lambda: False) -> list[Trial]:
    """Run the trials of one job.

    Args:
        job: The job.
        one: The instance of the job's task.
        stop: Called before each trial. Once it returns True, no further trial begins.

    Returns:
        One trial for each of the job's seeds, up to a stop.
    """
    config = settings(job.planner, one, job.budget, job.learners)
    return [
        try_once(job.planner, one, seed, config, history=job.history)
        for seed in job.seeds
        if not stop()
    ]


def run_jobs(
    jobs: Sequence[Job],
    tasks: Sequence[Task],
    *,
    workers: int,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[Job, list[Trial]]]:
    """Run the jobs and yield the trials of each job as soon as it is finished.

    On a stop or a KeyboardInterrupt the unfinished jobs are dropped and the workers are ended.

    Args:
        jobs: The jobs.
        tasks: The tasks that the jobs refer to by index.
        workers: The number of processes. With 1, the jobs run in this process, in order.
        stop: Called several times a second, or before each plan in this process. Once it returns
            True, the jobs under way are dropped.

    Yields:
        Pairs of a job and its trials.

    Raises:
        RuntimeError: If a job's worker process died twice.
    """
    if workers <= 1:
        for job in jobs:
            trials = do_job(job, tasks[job.task].instance, stop)
            if stop():
                return
            yield job, trials
        return
    items = [(job, tasks[job.task].instance) for job in jobs]
    results = pool.run_all(
        items,
        _do_item,
        pool.local_workers(workers),
        when_lost=_raise_lost,
        stop=stop,
        finish_started=False,
    )
    with closing(results):
        for (job, _), trials in results:
            yield job, trials


def _do_item(item: tuple[Job, Instance]) -> list[Trial]:
    return do_job(*item)


def _raise_lost(item: tuple[Job, Instance]) -> list[Trial]:
    job, one = item
    raise RuntimeError(f"planner {job.planner} on {one.name}: its worker process died twice")
