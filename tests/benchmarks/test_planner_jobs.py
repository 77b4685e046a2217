"""The planner benchmark's jobs on several processes."""

from __future__ import annotations

import time
from multiprocessing import active_children, get_context

import pytest

from simloop.benchmarks.planners.jobs import make_jobs, run_jobs
from simloop.benchmarks.planners.tasks import load_scene


def test_an_interrupt_spares_the_callers_other_processes():
    bystander = get_context("spawn").Process(target=time.sleep, args=(120.0,))
    bystander.start()
    try:
        tasks = load_scene("S1")
        jobs = make_jobs(tasks, ["astar", "de", "ga"], seeds=2, budget=400, learners=100)
        done = run_jobs(jobs, tasks, workers=2)
        next(done)
        with pytest.raises(KeyboardInterrupt):
            done.throw(KeyboardInterrupt)
        until = time.monotonic() + 20.0
        while len(active_children()) > 1 and time.monotonic() < until:
            time.sleep(0.02)
        assert active_children() == [bystander]  # its own workers are gone, the other one is not
        assert bystander.is_alive()
    finally:
        bystander.kill()
        bystander.join()
