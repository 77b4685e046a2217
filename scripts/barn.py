"""The BARN benchmark (Perille et al. 2020): ten metres through an unknown field of cylinders.

    python scripts/barn.py --worlds barn_dev.json.gz --seeds 4 --workers 2 --json barn.json

The rules are those of the challenge. The clock starts when the robot has moved 0.1 m. The run
succeeds within 1 m of the goal. It fails at any contact, and after 100 s.
"""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from simloop.cli.common import check_json, write_json
from simloop.cli.main import run_command
from simloop.common.errors import InputError
from simloop.common.terminal import counting, print_table
from simloop.evaluation.shortest_path import shortest_path
from simloop.loop import Simulation
from simloop.messages import Message
from simloop.scenario.build import World, build_world
from simloop.scenario.load import apply_override, from_table
from simloop.scenario.scenario import Scenario
from simloop.truth import Truth
from simloop.worlds.gazebo_world import read_sdf

_MOVED_M, _NEAR_M, _LIMIT_S = 0.1, 1.0, 100.0
_TOP_MPS = 0.47  # top speed of this robot
_SCORE_MPS = 2.0  # the challenge's speed for the best time
_HEIGHT_M = 0.6
_START, _GOAL = (-2.25, 3.0, 0.5 * math.pi), (-2.25, 13.0)
_RASTER_ORIGIN = np.array([-4.575, 5.075])  # origin of the cells of the organisers' paths, m
_DISC_M = 0.25  # radius of a disc as wide as the robot


@dataclass(frozen=True, slots=True)
class Course:
    """A BARN world.

    Attributes:
        name: Its number as text.
        cylinders_m: Centre x, y of each cylinder, m, map frame.
        radius_m: Radius of all cylinders, m.
        start: x, y, yaw, m and rad, map frame.
        goal: x, y, m, map frame.
        path_length_m: Length of the organisers' own path from start to goal, m.
    """

    name: str
    cylinders_m: tuple[tuple[float, float], ...]
    radius_m: float
    start: tuple[float, float, float]
    goal: tuple[float, float]
    path_length_m: float


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
        elif self.time_s >= _LIMIT_S or message.t_ns >= 2e9 * _LIMIT_S:
            self.outcome = "timeout"


def read_worlds(path: Path) -> dict[str, Course]:
    """Read BARN worlds.

    Args:
        path: A JSON file, plain or gzipped, or a folder with files world_N.world.

    Returns:
        Name -> world, in the order of the file or by N.

    Raises:
        InputError: The worlds cannot be read.
    """
    if path.is_dir():
        return read_folder(path)
    try:
        raw = path.read_bytes()
        table = json.loads(gzip.decompress(raw) if path.suffix == ".gz" else raw)
        return {
            name: Course(
                name,
                tuple((float(x), float(y)) for x, y in world["cyl"]),
                float(world["radius"]),
                tuple(map(float, world["start"])),  # type: ignore[arg-type]
                tuple(map(float, world["goal"])),  # type: ignore[arg-type]
                float(world["path_len"]),
            )
            for name, world in table.items()
        }
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, EOFError, AttributeError) as error:
        raise InputError(f"{path}: not a file of BARN worlds: {error!r}") from None


def read_folder(folder: Path) -> dict[str, Course]:
    """Read BARN's Gazebo worlds.

    Args:
        folder: Folder with files world_N.world and, optionally, the organisers' paths path_N.npy.
            Without these, the length of the shortest path for this robot is used.

    Returns:
        N -> world, ascending.

    Raises:
        InputError: There are no worlds, or one is not a BARN world.
    """
    files = sorted(folder.glob("world_*.world"), key=lambda file: (len(file.stem), file.stem))
    if not files:
        raise InputError(f"{folder}: contains no world_N.world")
    return {(name := file.stem.removeprefix("world_")): _from_gazebo(name, file) for file in files}


def _from_gazebo(name: str, file: Path) -> Course:
    """Read a world in Gazebo's format. InputError if it is not a BARN world."""
    obstacles = read_sdf(file).obstacles
    if any(one.shape != "cylinder" for one in obstacles) or not obstacles:
        raise InputError(f"{file}: a BARN world consists of cylinders only")
    sizes = {one.size_m[0] for one in obstacles}
    if len(sizes) > 1:
        raise InputError(f"{file}: cylinders of {len(sizes)} sizes; in a BARN world all are equal")
    places = tuple(one.position_m for one in obstacles)
    course = Course(name, places, 0.5 * sizes.pop(), _START, _GOAL, 0.0)
    return replace(course, path_length_m=_path_length(course, file.with_name(f"path_{name}.npy")))


def _path_length(course: Course, file: Path) -> float:
    """Compute the length of the organisers' path, m.

    Their file holds cells of a raster; start and goal are added. Without a file, it is the length
    of the shortest path of a disc as wide as the robot.
    """
    ends = np.array([course.start[:2], course.goal])
    if file.exists():
        try:
            cells = np.load(file, allow_pickle=False).reshape(-1, 2)
        except (OSError, ValueError):
            raise InputError(f"{file}: not an array of cells") from None
        inner = 2.0 * course.radius_m * cells + _RASTER_ORIGIN
        path = np.vstack([ends[:1], inner, ends[1:]])
        return float(np.hypot(*np.diff(path, axis=0).T).sum())
    floor = _world(course, ()).floor
    shortest = shortest_path(floor, ends[0], ends[1], _DISC_M)
    if shortest is None:
        raise InputError(f"world {course.name}: no path from start to goal")
    return shortest.length_m


def scenario_of(course: Course, overrides: Sequence[str], seed: int) -> Scenario:
    """Make a scenario of a world.

    Args:
        course: The world.
        overrides: Settings as ``key=value``.
        seed: Seed of the scenario.

    Returns:
        The scenario. Its time limit leaves the decision to the referee.

    Raises:
        InputError: An override is wrong.
    """
    table: dict[str, Any] = {
        "name": f"barn_{course.name}",
        "title": f"BARN world {course.name}",
        "arena": "field",
        "start": list(course.start),
        "goal": list(course.goal),
        "time_limit_s": 2.0 * _LIMIT_S,
        "seed": seed,
        "obstacles": [
            {
                "shape": "cylinder",
                "position_m": [x, y],
                "size_m": [2.0 * course.radius_m],
                "height_m": _HEIGHT_M,
            }
            for x, y in course.cylinders_m
        ],
    }
    for text in overrides:
        apply_override(table, text)
    return from_table(table, source=f"world {course.name}")


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


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """Summarise runs.

    Args:
        runs: At least one run.

    Returns:
        Rates over all runs, mean times over the runs that arrived, and the runs of each world.
    """
    arrived = [run for run in runs if run.outcome == "reached"]

    def rate(*outcomes: str) -> float:
        return sum(run.outcome in outcomes for run in runs) / len(runs)

    success, collision = rate("reached"), rate("collision")
    worlds = dict.fromkeys(run.world for run in runs)
    return {
        "runs": len(runs),
        "success_rate": success,
        "collision_rate": collision,
        "timeout_rate": 1.0 - success - collision,
        "time_mean_s": _mean([run.time_s for run in arrived]),
        "score_official": _mean([run.score for run in runs]),
        "time_over_limit": _mean([run.time_over_limit for run in arrived]),
        "per_world": [
            {"world": world, "runs": [asdict(run) for run in runs if run.world == world]}
            for world in worlds
        ],
    }


def _mean(values: Sequence[float]) -> float | None:
    """Compute the mean of the values; None if there are none."""
    return float(np.mean(values)) if values else None


def run_all(
    courses: Sequence[Course], seeds: int, overrides: tuple[str, ...], pool: Executor
) -> Iterator[Run]:
    """Run every world with every seed.

    Args:
        courses: The worlds.
        seeds: Number of runs of each world, with the seeds from 0 on.
        overrides: Settings as ``key=value``.
        pool: Executor of the runs.

    Yields:
        The runs, world by world and by seed.
    """
    jobs = list(product(courses, range(seeds)))
    yield from pool.map(
        run_one, [c for c, _ in jobs], [overrides] * len(jobs), [s for _, s in jobs]
    )


def main(
    worlds: Annotated[Path, typer.Option(help="A JSON file, or a folder of world_N.world.")],
    indices: Annotated[list[str] | None, typer.Option(help="Only these worlds.")] = None,
    seeds: Annotated[int, typer.Option(min=1)] = 4,
    workers: Annotated[int, typer.Option(min=1)] = 1,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
) -> int:
    """Run BARN's worlds by BARN's rules.
    \f

    Args:
        worlds: A JSON file, plain or gzipped, or a folder of world_N.world.
        indices: Names of the worlds to run; None: all.
        seeds: Number of runs of each world, with the seeds from 0 on.
        workers: Number of processes.
        json_file: File for the results; None: no file.
        overrides: Settings as ``key=value``.

    Returns:
        Exit code 0.

    Raises:
        InputError: The worlds cannot be read, or a name is unknown.
    """
    check_json(json_file)
    known = read_worlds(worlds)
    if not known:
        raise InputError(f"{worlds}: contains no worlds")
    for index in indices or ():
        if index not in known:
            raise InputError(f"--indices {index}: no such world in {worlds}")
    chosen = [known[index] for index in indices or known]
    runs: list[Run] = []
    bar = counting(Console(stderr=True), "runs", len(chosen) * seeds)
    with ProcessPoolExecutor(workers) as pool, bar as show:
        for run in run_all(chosen, seeds, tuple(overrides or ()), pool):
            runs.append(run)
            show(len(runs))
    found = figures(runs)
    rows = [[key, f"{value:.4g}"] for key, value in found.items() if isinstance(value, float | int)]
    print_table(Console(), "BARN", ["figure", "value"], rows)
    for run in runs:
        if run.outcome != "reached":
            print(f"  world {run.world}, seed {run.seed}: {run.outcome} after {run.time_s:.1f} s")
    write_json(json_file, found)
    return 0


if __name__ == "__main__":
    run_command(main)
