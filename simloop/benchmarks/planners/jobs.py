"""Many trials over several processes, which Ctrl-C ends early without losing what is done."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import active_children, get_context

from simloop.benchmarks.planners.scenes import Instance
from simloop.benchmarks.planners.tasks import Task
from simloop.benchmarks.planners.trials import (
    Trial,
    handles,
    info_of,
    settings,
    try_once,
)


@dataclass(frozen=True, slots=True)
class Job:
    """All the seeds of one planner on one task, given by its number."""

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
    """At least ``seeds`` plans a scene and planner, shared by its instances; one an instance
    for what knows no chance, ``few`` at most for what is slow. Where a planner has no answer for a
    kind of world there is no job."""
    count: dict[str, int] = {}
    for task in tasks:
        count[task.scene] = count.get(task.scene, 0) + 1
    jobs = []
    for number, task in enumerate(tasks):
        each = -(-seeds // count[task.scene])
        for name in planners:
            if handles(name, task.instance):
                most = few if few is not None and info_of(name).slow else each
                wanted = range(min(each, most) if info_of(name).stochastic else 1)
                jobs.append(Job(number, name, tuple(wanted), budget, learners, history))
    return jobs


def do_job(job: Job, one: Instance) -> list[Trial]:
    """The job's trials on its instance."""
    config = settings(job.planner, one, job.budget, job.learners)
    return [try_once(job.planner, one, seed, config, history=job.history) for seed in job.seeds]


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_jobs(
    jobs: Sequence[Job],
    tasks: Sequence[Task],
    *,
    workers: int,
    done: Callable[[Job], None] = lambda job: None,
) -> Iterator[tuple[Job, list[Trial]]]:
    """Each job with its trials, as they are finished; in order with one worker.

    On KeyboardInterrupt the jobs not yet begun are given up, and the interrupt goes on.
    """
    if workers <= 1:
        for job in jobs:
            yield job, do_job(job, tasks[job.task].instance)
            done(job)
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, _leave_interrupts_to_the_parent) as pool:
        futures: dict[Future[list[Trial]], Job] = {
            pool.submit(do_job, job, tasks[job.task].instance): job for job in jobs
        }
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
                done(futures[future])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise
