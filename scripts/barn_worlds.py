"""Read the worlds of the BARN benchmark, with the paths that its organisers measure against."""

from __future__ import annotations

import gzip
import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.limits import SHAPES, TEXT_BYTES, check_limit
from simloop.evaluation.shortest_path import shortest_path
from simloop.messages import FloatArray
from simloop.scenario.build import build_world
from simloop.scenario.inputs import files_behind
from simloop.scenario.load import apply_override, from_table
from simloop.scenario.scenario import Scenario
from simloop.worlds.gazebo_world import read_sdf

LIMIT_S = 100.0
"""The challenge's time limit, s."""

ORGANISERS, SHORTEST = "organisers", "shortest"
"""The two yardsticks: the organisers' own path, or the shortest path for this robot."""

_HEIGHT_M = 0.6
_START, _GOAL = (-2.25, 3.0, 0.5 * math.pi), (-2.25, 13.0)
_RASTER_ORIGIN = np.array([-4.575, 5.075])  # origin of the cells of the organisers' paths, m
_MOST_CELLS = 100_000  # cells of a path; theirs have some 60
_DISC_M = 0.25  # radius of a disc as wide as the robot
# Where the worlds lie: beside each other, in the data set, and in the challenge's repository.
_WORLD_FOLDERS = (".", "world_files", "BARN", "worlds/BARN", "jackal_helper/worlds/BARN")
_PATH_FOLDERS = (".", "path_files", "../path_files")


@dataclass(frozen=True, slots=True)
class Course:
    """A BARN world.

    Attributes:
        name: Its number as text.
        cylinders_m: Centre x, y of each cylinder, m, map frame.
        radius_m: Radius of all cylinders, m.
        start: x, y, yaw, m and rad, map frame.
        goal: x, y, m, map frame.
        path_length_m: Length of the path that times are compared with, m.
        yardstick: `ORGANISERS` or `SHORTEST`: whose path that is.
    """

    name: str
    cylinders_m: tuple[tuple[float, float], ...]
    radius_m: float
    start: tuple[float, float, float]
    goal: tuple[float, float]
    path_length_m: float
    yardstick: str = ORGANISERS


def read_worlds(
    path: Path,
    names: Sequence[str] = (),
    paths: Path | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Course]:
    """Read BARN worlds.

    Args:
        path: A JSON file, plain or gzipped, or a folder: with files world_N.world, or one of the
            organisers' own, which holds them in a folder below.
        names: The worlds to read; empty: all. Nothing is computed for others.
        paths: Folder of the organisers' paths path_N.npy. None: beside the worlds, or in
            ``path_files`` there or beside their folder. Without a path, its length is that of the
            shortest path for this robot.
        progress: Called with the number of worlds read, and of all.

    Returns:
        Name -> world, in the order of ``names``, else of the file or by N.

    Raises:
        InputError: The worlds cannot be read, there are none, or a name is unknown.
    """
    known = _gazebo_files(path) if path.is_dir() else _json_tables(path)
    if not known:
        raise InputError(f"{path}: contains no worlds")
    for name in names:
        if name not in known:
            raise InputError(f"--indices {name}: no such world in {path}")
    found, wanted = {}, names or tuple(known)
    for name in wanted:
        source = known[name]
        if isinstance(source, Path):
            found[name] = _from_gazebo(name, source, paths)
        else:
            found[name] = _from_table(name, source, path)
        progress(len(found), len(wanted))
    return found


def files_read(path: Path, paths: Path | None = None) -> list[Path]:
    """List the files that `read_worlds` reads, for all worlds together.

    Args:
        path: As for `read_worlds`.
        paths: As for `read_worlds`.

    Returns:
        The file of the worlds; or for a folder each world, the files that it names, and each place
        where its path may be, whether or not there is one.

    Raises:
        InputError: The folder contains no worlds.
    """
    if not path.is_dir():
        return [path]
    found: list[Path] = []
    for name, file in _gazebo_files(path).items():
        found += files_behind(file, "a world")
        found += [folder / f"path_{name}.npy" for folder in _path_folders(file, paths)]
    return found


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
        "time_limit_s": 2.0 * LIMIT_S,
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


def _json_tables(path: Path) -> dict[str, Any]:
    raw = read_bytes(path, TEXT_BYTES)
    try:
        if path.suffix == ".gz":
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as packed:
                raw = packed.read(TEXT_BYTES + 1)
        check_limit(len(raw), TEXT_BYTES, f"{path}: size, unpacked", "bytes")
        table = json.loads(raw)
    except InputError:
        raise
    except (OSError, ValueError, EOFError, RecursionError) as error:
        raise InputError(f"{path}: not a file of BARN worlds: {error}") from None
    except Exception as error:  # zlib.error is no OSError
        raise InputError(f"{path}: not a file of BARN worlds: {error!r}") from None
    if not isinstance(table, dict):
        raise InputError(f"{path}: not a file of BARN worlds: not a table of worlds")
    return table


def _from_table(name: str, world: Any, path: Path) -> Course:
    where = f"{path}: not a file of BARN worlds: world {name}"
    try:
        cylinders, radius = world["cyl"], float(world["radius"])
        check_limit(len(cylinders), SHAPES, f"{path}: world {name}: cylinders")
        course = Course(
            name,
            tuple((float(x), float(y)) for x, y in cylinders),
            radius,
            tuple(map(float, world["start"])),  # type: ignore[arg-type]
            tuple(map(float, world["goal"])),  # type: ignore[arg-type]
            float(world["path_len"]),
        )
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise InputError(f"{where}: {error!r}") from None
    places = [x for place in (*course.cylinders_m, course.start, course.goal) for x in place]
    if len(course.start) != 3 or len(course.goal) != 2 or not all(map(math.isfinite, places)):
        raise InputError(f"{where}: start is x, y, yaw and goal is x, y, finite as all places")
    if not (0.0 < radius < math.inf and 0.0 < course.path_length_m < math.inf):
        raise InputError(f"{where}: radius and path_len must be above 0")
    return course


def _gazebo_files(folder: Path) -> dict[str, Path]:
    """Find the files world_N.world in a folder of the organisers, by N, ascending."""
    for below in _WORLD_FOLDERS:
        files = (folder / below).glob("world_*.world")
        found = sorted(files, key=lambda file: (len(file.stem), file.stem))
        if found:
            return {file.stem.removeprefix("world_"): file for file in found}
    raise InputError(f"{folder}: contains no world_N.world, nor does world_files in it")


def _from_gazebo(name: str, file: Path, paths: Path | None) -> Course:
    """Read a world in Gazebo's format. InputError if it is not a BARN world."""
    obstacles = read_sdf(file).obstacles
    if any(one.shape != "cylinder" for one in obstacles) or not obstacles:
        raise InputError(f"{file}: a BARN world consists of cylinders only")
    sizes = {one.size_m[0] for one in obstacles}
    if len(sizes) > 1:
        raise InputError(f"{file}: cylinders of {len(sizes)} sizes; in a BARN world all are equal")
    places = tuple(one.position_m for one in obstacles)
    course = Course(name, places, 0.5 * sizes.pop(), _START, _GOAL, 0.0)
    for folder in _path_folders(file, paths):
        if (folder / f"path_{name}.npy").exists():
            length_m = _organisers_length_m(course, folder / f"path_{name}.npy")
            return replace(course, path_length_m=length_m)
    return replace(course, path_length_m=_shortest_length_m(course), yardstick=SHORTEST)


def _path_folders(file: Path, paths: Path | None) -> list[Path]:
    """List the folders in which the organisers' path of a world may be."""
    return [paths] if paths is not None else [file.parent / below for below in _PATH_FOLDERS]


def _organisers_length_m(course: Course, file: Path) -> float:
    """Compute the length of the organisers' path, m: cells of a raster; the ends are added."""
    inner = 2.0 * course.radius_m * _read_cells(file) + _RASTER_ORIGIN
    path = np.vstack([course.start[:2], inner, course.goal])
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _read_cells(file: Path) -> FloatArray:
    """Read the cells (N, 2) of a path. InputError if the file is not such an array."""
    data = io.BytesIO(read_bytes(file))
    try:
        version = np.lib.format.read_magic(data)
        if version == (1, 0):
            shape, _, kind = np.lib.format.read_array_header_1_0(data)
        else:
            shape, _, kind = np.lib.format.read_array_header_2_0(data)
        # The header is believed only within limits: numpy takes the memory before it reads.
        if kind.kind not in "iuf" or math.prod(shape) > _MOST_CELLS or math.prod(shape) % 2:
            raise ValueError("not pairs of numbers")
        data.seek(0)
        cells = np.asarray(np.load(data, allow_pickle=False), dtype=float).reshape(-1, 2)
    except (OSError, ValueError, EOFError, TypeError, SyntaxError, RecursionError) as error:
        raise InputError(f"{file}: not an array of cells: {error}") from None
    if not (np.abs(cells) <= _MOST_CELLS).all():
        raise InputError(f"{file}: not an array of cells: a number is not finite or too large")
    return cells


def _shortest_length_m(course: Course) -> float:
    """Compute the length of the shortest path of a disc as wide as the robot, m."""
    floor = build_world(scenario_of(course, (), 0)).floor
    start, goal = np.array(course.start[:2]), np.array(course.goal)
    shortest = shortest_path(floor, start, goal, _DISC_M)
    if shortest is None:
        raise InputError(f"world {course.name}: no path from start to goal")
    return shortest.length_m
