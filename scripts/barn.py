"""The BARN benchmark (Perille et al. 2020): ten metres through an unknown field of cylinders.

    python scripts/barn.py --worlds barn_dev.json.gz --seeds 4 --workers 2 --json barn.json

The rules are those of the challenge. The clock starts when the robot has moved 0.1 m. The run
succeeds within 1 m of the goal. It fails at any contact, and after 100 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from barn_worlds import LIMIT_S, ORGANISERS, Course, files_read, read_worlds, scenario_of
from rich.console import Console

from simloop.campaign.sweeps import check_once
from simloop.cli.apart import check_apart
from simloop.cli.common import INTERRUPTED, NumberOfWorkers, check_json, write_json
from simloop.cli.main import run_command
from simloop.cli.stopping import leaving_at_once, stopping
from simloop.common import pool
from simloop.common.errors import InputError
from simloop.common.terminal import checking, counting, print_table
from simloop.loop import Simulation
from simloop.messages import Message
from simloop.scenario.build import World, build_world
from simloop.scenario.inputs import input_files
from simloop.truth import Truth

_MOVED_M, _NEAR_M = 0.1, 1.0
_TOP_MPS = 0.47  # top speed of this robot
_SCORE_MPS = 2.0  # the challenge's speed for the best time


@dataclass(frozen=True, slots=True)
class Run:
    """The result of one run.

    Attributes:
        world: Name of the world.
        seed: Seed of the run.
        outcome: reached, collision or timeout, or the robot's own reason for giving up.
        time_s: Time on BARN's clock, s.
        score: The challenge's score, 0 to 0.5.
        time_over_limit: ``time_s`` over the time for the organisers' path at top speed.
    """

    world: str
    seed: int
    outcome: str
    time_s: float
    score: float
    time_over_limit: float


class Referee:
    """Judges a run by BARN's rules from the true states. Only the first event counts.

    Attributes:
        outcome: reached, collision or timeout; empty while the run continues.
        time_s: Time on BARN's clock, s.
    """

    def __init__(self, course: Course) -> None:
        self._course = course
        self._began_ns: int | None = None
        self.outcome = ""
        self.time_s = 0.0

    def offer(self, message: Message) -> None:
        """Judge one message.

        Args:
            message: Any message of the loop; only a `Truth` is used.
        """
        if not isinstance(message, Truth) or self.outcome:
            return
        place = message.pose_xyyaw[:2]
        if self._began_ns is None and math.dist(place, self._course.start[:2]) >= _MOVED_M:
            self._began_ns = message.t_ns
        began = message.t_ns if self._began_ns is None else self._began_ns
        self.time_s = (message.t_ns - began) * 1e-9
        if message.contact_count:
            self.outcome = "collision"
        elif math.dist(place, self._course.goal) <= _NEAR_M:
            self.outcome = "reached"
        # A robot that never starts the clock must also end: after twice the time limit.
        elif self.time_s >= LIMIT_S or message.t_ns >= 2e9 * LIMIT_S:
            self.outcome = "timeout"


@lru_cache(maxsize=4)
def _world(course: Course, overrides: tuple[str, ...]) -> World:
    """Build the world, and keep it for the other seeds of the same course."""
    return build_world(scenario_of(course, overrides, 0))


def run_one(course: Course, overrides: tuple[str, ...], seed: int) -> Run:
    """Run a world once. The result is the same in any process.

    Args:
        course: The world.
        overrides: Settings as ``key=value``.
        seed: Seed of the run.

    Returns:
        The result of the run.
    """
    referee = Referee(course)
    scenario = scenario_of(course, overrides, seed)
    simulation = Simulation(scenario, listeners=[referee.offer], world=_world(course, overrides))
    result = simulation.run(lambda time_s, to_go_m: not referee.outcome)
    outcome = referee.outcome or result.outcome
    limit_s = course.path_length_m / _TOP_MPS
    score = 0.0
    if outcome == "reached":
        # The challenge limits the time to between two and eight times the best time.
        best_s = course.path_length_m / _SCORE_MPS
        score = best_s / float(np.clip(referee.time_s, 2.0 * best_s, 8.0 * best_s))
    return Run(course.name, seed, outcome, referee.time_s, score, referee.time_s / limit_s)


def figures(runs: Sequence[Run], courses: Sequence[Course] = ()) -> dict[str, Any]:
    """Summarise runs.

    Args:
        runs: At least one run.
        courses: Their worlds, to tell the yardstick of each.

    Returns:
        Rates over all runs, mean times over the runs that arrived, and the runs of each world.
    """
    arrived = [run for run in runs if run.outcome == "reached"]

    def rate(*outcomes: str) -> float:
        return sum(run.outcome in outcomes for run in runs) / len(runs)

    success, collision = rate("reached"), rate("collision")
    worlds = dict.fromkeys(run.world for run in runs)
    lengths = {one.name: (one.yardstick, one.path_length_m) for one in courses}
    return {
        "runs": len(runs),
        "success_rate": success,
        "collision_rate": collision,
        "timeout_rate": 1.0 - success - collision,
        "time_mean_s": _mean([run.time_s for run in arrived]),
        "score_official": _mean([run.score for run in runs]),
        "time_over_limit": _mean([run.time_over_limit for run in arrived]),
        "per_world": [
            {
                "world": world,
                **dict(zip(("yardstick", "path_length_m"), lengths.get(world, ()), strict=False)),
                "runs": [asdict(run) for run in runs if run.world == world],
            }
            for world in worlds
        ],
    }


def _mean(values: Sequence[float]) -> float | None:
    """Compute the mean of the values; None if there are none."""
    return float(np.mean(values)) if values else None


def yardsticks(courses: Sequence[Course]) -> list[str]:
    """Tell what the times of a run are compared with.

    Args:
        courses: The worlds.

    Returns:
        One or two lines.
    """
    lines, count = [], len(courses)
    own = [course.name for course in courses if course.yardstick == ORGANISERS]
    if own:
        lines.append(f"yardstick of {len(own)} of {count} worlds: the organisers' own paths")
    if len(own) < count:
        lines.append(
            f"yardstick of {count - len(own)} of {count} worlds: the shortest path for this robot, "
            "as there is no path_N.npy; scores are not comparable with the challenge's"
        )
    return lines


def run_all(
    courses: Sequence[Course],
    seeds: int,
    overrides: tuple[str, ...],
    workers: int,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Run]:
    """Run every world with every seed.

    Args:
        courses: The worlds.
        seeds: Number of runs of each world, with the seeds from 0 on.
        overrides: Settings as ``key=value``.
        workers: Number of processes.
        stop: Called several times a second. Once it returns True, no further run starts.

    Yields:
        The runs, in the order in which they are finished.
    """
    jobs = [(course, overrides, seed) for course in courses for seed in range(seeds)]
    done = pool.run_all(jobs, _do, pool.local_workers(workers), when_lost=_raise_lost, stop=stop)
    with closing(done):
        for _, run in done:
            yield run


def _do(job: tuple[Course, tuple[str, ...], int]) -> Run:
    return run_one(*job)


def _raise_lost(job: tuple[Course, tuple[str, ...], int]) -> Run:
    raise RuntimeError(f"world {job[0].name}, seed {job[2]}: its worker process died twice")


def main(
    worlds: Annotated[
        Path, typer.Option(help="A JSON file, or a folder of world_N.world, as the organisers'.")
    ],
    indices: Annotated[list[str] | None, typer.Option(help="Only these worlds.")] = None,
    paths: Annotated[
        Path | None, typer.Option(help="Folder of path_N.npy. Default: path_files at the worlds.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1)] = 4,
    workers: NumberOfWorkers = 1,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
) -> int:
    """Run BARN's worlds by BARN's rules.
    \f

    Args:
        worlds: A JSON file, plain or gzipped, or a folder of world_N.world.
        indices: Names of the worlds to run; None: all.
        paths: Folder of the organisers' paths; None: at the worlds.
        seeds: Number of runs of each world, with the seeds from 0 on.
        workers: Number of processes; 0: the number of cores.
        json_file: File for the results; None: no file.
        overrides: Settings as ``key=value``.

    Returns:
        Exit code 0, or 130 if it was stopped.

    Raises:
        InputError: The worlds cannot be read, or a name is unknown.
    """
    with leaving_at_once():
        check_json(json_file)
        check_once(indices or (), "--indices")
        if paths is not None and not paths.is_dir():
            raise InputError(f"--paths {paths}: no such folder")
        check_apart({"--json": json_file}, files_read(worlds, paths))
        notes = Console(stderr=True)
        with checking(notes) as said:
            reading = read_worlds(
                worlds, indices or (), paths, lambda done, count: said(f"of {count} worlds", done)
            )
        chosen = list(reading.values())
        check_apart({"--json": json_file}, input_files(scenario_of(chosen[0], overrides or (), 0)))
        for line in yardsticks(chosen):
            print(line)
        runs: list[Run] = []
        count = pool.processes(workers)
        note = "stopping: the runs under way are finished; once more to end at once"
        with counting(notes, "runs", len(chosen) * seeds) as show, stopping(note) as stop:
            for run in run_all(chosen, seeds, tuple(overrides or ()), count, stop):
                runs.append(run)
                show(len(runs))
            stopped = stop()
        if runs:
            _report(runs, chosen, json_file)
        return INTERRUPTED if stopped else 0


def _report(runs: list[Run], courses: Sequence[Course], json_file: Path | None) -> None:
    """Print the figures and write them as JSON."""
    order = {course.name: number for number, course in enumerate(courses)}
    runs.sort(key=lambda run: (order[run.world], run.seed))
    found = figures(runs, courses)
    rows = [[key, f"{value:.4g}"] for key, value in found.items() if isinstance(value, float | int)]
    print_table(Console(), "BARN", ["figure", "value"], rows)
    for run in runs:
        if run.outcome != "reached":
            print(f"  world {run.world}, seed {run.seed}: {run.outcome} after {run.time_s:.1f} s")
    write_json(json_file, found)


if __name__ == "__main__":
    run_command(main)
