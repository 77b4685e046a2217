"""Planning tasks from files: MovingAI maps and scenarios, and images with dark obstacles.

Format: https://movingai.com/benchmarks/formats.html. A cell is `CELL_M` wide. The robot is a point
that keeps a distance of `SAFE_CELLS` cells, so that it fits through a gap of one cell. The planners
receive a distance field with four times the map's resolution (twice on large maps). The judge
receives the blocked cells themselves.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from simloop.benchmarks.planners.scenes import Instance
from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.pictures import read_picture
from simloop.messages import FloatArray, WorldView

CELL_M = 0.2
SAFE_CELLS = 0.35
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")
TASKS = 10
"""Number of tasks from a scenario file, evenly spaced from the first (easiest) to the last."""
_FINE = 4  # cells of the distance field per side of a map cell
_MOST_CELLS, _LARGE_CELLS = 2**20, 2**18
_MAP_BYTES, _SCENARIO_BYTES = 2**22, 2**24
_MOST_TASKS = 100_000
_WHOLE = re.compile(r"\d{1,9}", re.ASCII)
_FREE, _BLOCKED = ".GS", "@OTW"
_DARK = 128  # grey value below which a pixel is blocked

Blocked = NDArray[np.bool_]
"""(rows, cols), row 0 at the top: True if a cell is blocked."""


@dataclass(frozen=True, slots=True)
class MapTask:
    """One line of a scenario file.

    Attributes:
        map_name: Name of the map's file, perhaps with folders.
        map_size: Columns and rows of the map.
        start: Column and row of the start cell.
        goal: Column and row of the goal cell.
        length: Length of the optimal path over an eight-connected grid, cells.
    """

    map_name: str
    map_size: tuple[int, int]
    start: tuple[int, int]
    goal: tuple[int, int]
    length: float


def is_map_file(name: str) -> bool:
    """Tell whether a scene's name is that of a file that this module can read.

    Args:
        name: Name of a scene, or path of a file.

    Returns:
        Whether its suffix is ``.map``, ``.scen`` or that of an image.
    """
    return name.lower().endswith((".map", ".scen", *IMAGES))


def load_file(path: Path) -> list[Instance]:
    """Read the tasks of a map, a scenario or an image.

    Args:
        path: A ``.map`` (its ``.map.scen`` is used if it is in the same folder), a ``.scen`` (its
            second column names the map) or an image.

    Returns:
        At most `TASKS` tasks. Without a scenario there is one, across the map's largest open area.

    Raises:
        InputError: A file cannot be read, or violates the format.
    """
    suffix = path.suffix.lower()
    if suffix in IMAGES:
        return _instances(path, read_image(path), [])
    if suffix == ".scen":
        tasks = parse_scenario(_text(path, _SCENARIO_BYTES), path)
        named = _map_of(path, tasks)
        blocked = parse_map(_text(named, _MAP_BYTES), named)
        _check_map_size(path, tasks, blocked)
        return _instances(path, blocked, tasks)
    blocked = parse_map(_text(path, _MAP_BYTES), path)
    scenario = Path(f"{path}.scen")
    if not scenario.exists():
        return _instances(path, blocked, [])
    tasks = parse_scenario(_text(scenario, _SCENARIO_BYTES), scenario)
    if _name_of(tasks[0]) != path.name:
        raise InputError(f"{scenario}: line 2: its tasks are on {tasks[0].map_name}, not on {path}")
    _check_map_size(scenario, tasks, blocked)
    return _instances(path, blocked, tasks)


def files_read(path: Path) -> list[Path]:
    """List the files that `load_file` reads.

    Args:
        path: As for `load_file`.

    Returns:
        The file itself; with a ``.scen`` the map that it names, and with a ``.map`` its scenario if
        there is one.

    Raises:
        InputError: The scenario cannot be read, violates the format, or its map is missing.
    """
    suffix = path.suffix.lower()
    if suffix == ".scen":
        return [path, _map_of(path, parse_scenario(_text(path, _SCENARIO_BYTES), path))]
    scenario = Path(f"{path}.scen")
    return [path, scenario] if suffix not in IMAGES and scenario.exists() else [path]


def _map_of(scenario: Path, tasks: list[MapTask]) -> Path:
    """Find the map that a scenario file names: relative to the file's folder, or just in it."""
    named = PurePosixPath(tasks[0].map_name.replace("\\", "/"))
    places = [scenario.parent / named.name]
    if not named.is_absolute() and ".." not in named.parts:
        places.insert(0, scenario.parent / named)
    for place in places:
        if named.name and place.is_file():
            return place
    raise InputError(
        f"{scenario}: its map {named} is neither at {' nor at '.join(map(str, places))}"
    )


def _name_of(task: MapTask) -> str:
    return PurePosixPath(task.map_name.replace("\\", "/")).name


def _check_map_size(scenario: Path, tasks: list[MapTask], blocked: Blocked) -> None:
    """Raise InputError if the tasks are on a map of another size, e.g. on a scaled one."""
    rows, cols = blocked.shape
    for number, task in enumerate(tasks, start=1):
        if task.map_size != (cols, rows):
            width, height = task.map_size
            raise InputError(
                f"{scenario}: task {number} is on a map of {width} x {height} cells, but "
                f"{_name_of(task)} has {cols} x {rows}"
            )


def _text(path: Path, most_bytes: int) -> str:
    return read_bytes(path, most_bytes).decode("latin-1")


def parse_map(text: str, source: Path) -> Blocked:
    """Read a MovingAI map.

    Args:
        text: The file's content.
        source: Its path, for error messages.

    Returns:
        (rows, cols), row 0 at the top: True if a cell is blocked.

    Raises:
        InputError: The text violates the format; the message names the line.
    """
    lines = text.splitlines()
    sizes: dict[str, int] = {}
    for number, wanted in enumerate(("type", "height", "width", "map")):
        words = lines[number].split() if number < len(lines) else []
        if not words or words[0] != wanted:
            given = lines[number][:20] if number < len(lines) else "the end"
            raise InputError(f"{source}: line {number + 1}: expected '{wanted}', found {given!r}")
        if wanted in ("height", "width"):
            sizes[wanted] = _size(words[1:], number + 1, source)
    height, width = sizes["height"], sizes["width"]
    if height * width > _MOST_CELLS:
        raise InputError(f"{source}: {height} x {width} cells are more than {_MOST_CELLS}")
    rows = lines[4 : 4 + height]
    if len(rows) < height:
        raise InputError(f"{source}: {len(rows)} rows, but its height is {height}")
    for number, row in enumerate(rows, start=5):
        if len(row) != width:
            raise InputError(f"{source}: line {number}: {len(row)} cells, but the width is {width}")
        strange = set(row) - set(_FREE + _BLOCKED)
        if strange:
            raise InputError(
                f"{source}: line {number}: unknown cell {min(strange)!r}; "
                f"free are {', '.join(_FREE)}, blocked {', '.join(_BLOCKED)}"
            )
    cells = np.array([list(row) for row in rows])
    return np.isin(cells, list(_BLOCKED))


def _size(words: list[str], line: int, source: Path) -> int:
    """Read a height or width from a line of the header."""
    try:
        (word,) = words
        size = int(word)
    except ValueError:
        raise InputError(f"{source}: line {line}: expected one whole number") from None
    if not 1 <= size <= _MOST_CELLS:
        raise InputError(f"{source}: line {line}: {size} is not between 1 and {_MOST_CELLS}")
    return size


def parse_scenario(text: str, source: Path) -> list[MapTask]:
    """Read a MovingAI scenario.

    Each line has nine columns: bucket, map, its width and height, column and row of the start and
    of the goal, optimal octile length. All lines are on the same map.

    Args:
        text: The file's content.
        source: Its path, for error messages.

    Returns:
        The tasks in the order of the file; at least one.

    Raises:
        InputError: The text violates the format; the message names the line.
    """
    lines = text.splitlines()
    if not lines or lines[0].split() not in (["version", "1"], ["version", "1.0"]):
        raise InputError(f"{source}: line 1: expected 'version 1'")
    tasks: list[MapTask] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        where = f"{source}: line {number}"
        words = line.split("\t") if "\t" in line else line.split()
        if len(words) != 9:
            raise InputError(f"{where}: {len(words)} columns, expected 9")
        task = _task(words, where)
        if tasks and task.map_name != tasks[0].map_name:
            raise InputError(
                f"{where}: is on {task.map_name}, the ones before on {tasks[0].map_name}"
            )
        tasks.append(task)
        if len(tasks) > _MOST_TASKS:
            raise InputError(f"{where}: more than {_MOST_TASKS:,} tasks")
    if not tasks:
        raise InputError(f"{source}: contains no task")
    return tasks


def _task(words: list[str], where: str) -> MapTask:
    """Read the columns of one line."""
    if not all(_WHOLE.fullmatch(word.strip()) for word in words[2:8]):
        raise InputError(f"{where}: columns 3 to 8 must be whole numbers of at most nine digits")
    width, height, x0, y0, x1, y1 = (int(word) for word in words[2:8])
    try:
        length = float(words[8])
    except ValueError:
        length = math.nan
    if not math.isfinite(length) or length < 0.0:
        raise InputError(f"{where}: column 9 must be a length, 0 or more")
    return MapTask(words[1].strip(), (width, height), (x0, y0), (x1, y1), length)


def read_image(path: Path) -> Blocked:
    """Read an image as a map, as a viewer shows it: turned by its EXIF orientation, on white.

    Args:
        path: The image; transparent pixels count as white.

    Returns:
        (rows, cols), row 0 at the top: True if a pixel is dark.

    Raises:
        InputError: The file is not an image, is damaged, or is too large.
    """
    picture = read_picture(path, _MOST_CELLS)
    grey = picture.levels * (255.0 / picture.white)
    if picture.opacity is not None:
        grey = 255.0 - (255.0 - grey) * (picture.opacity / 255.0)
    return np.asarray(grey < _DARK)


def _instances(path: Path, blocked: Blocked, tasks: list[MapTask]) -> list[Instance]:
    """Make instances on a map, for the given tasks or for one across its largest open area."""
    rows, cols = blocked.shape
    world, boxes = _world(blocked), _boxes(blocked)
    if not tasks:
        tasks = [_furthest(blocked, path)]
    for task in tasks:
        for x, y in (task.start, task.goal):
            if x >= cols or y >= rows or blocked[y, x]:
                raise InputError(f"{path}: column {x}, row {y} is not a free cell of the map")
    tasks = [e for e in tasks if e.start != e.goal] or tasks
    count = min(TASKS, len(tasks))
    chosen = [tasks[round(k)] for k in np.linspace(0, len(tasks) - 1, count)]
    return [
        Instance(
            f"{path.stem}-{number}",
            world,
            np.array([*_centre(task.start, rows), 0.0]),
            _centre(task.goal, rows),
            SAFE_CELLS * CELL_M,
            boxes,
        )
        for number, task in enumerate(chosen)
    ]


def _centre(cell: tuple[int, int], rows: int) -> FloatArray:
    """Compute the centre (2,) of a cell, m, x right and y up from the map's lower left corner."""
    return CELL_M * np.array([cell[0] + 0.5, rows - cell[1] - 0.5])


def _world(blocked: Blocked) -> WorldView:
    """Make a view of the map with a wall around it, as a distance field."""
    parts = _FINE if blocked.size <= _LARGE_CELLS else _FINE // 2
    solid = np.flipud(np.pad(blocked, 1, constant_values=True))
    fine = np.kron(solid, np.ones((parts, parts), dtype=bool))
    resolution = CELL_M / parts
    # The lattice of half cells also has nodes on the borders of cells, so the nearest point of
    # every blocked cell is a node. The distances at the cells' centres are exact.
    half = np.zeros((2 * fine.shape[0] + 1, 2 * fine.shape[1] + 1), dtype=bool)
    for i in range(3):
        for j in range(3):
            half[i : i + 2 * fine.shape[0] : 2, j : j + 2 * fine.shape[1] : 2] |= fine
    distance = ndimage.distance_transform_edt(~half, sampling=0.5 * resolution)[1::2, 1::2]
    rows, cols = blocked.shape
    return WorldView(
        t_ns=0,
        origin_m=np.array([-CELL_M, -CELL_M]),
        resolution_m=resolution,
        distance_m=distance.astype(np.float32),
        discs_xyr_m=np.zeros((0, 3)),
        bounds_m=CELL_M * np.array([0.0, 0.0, cols, rows]),
    )


def _boxes(blocked: Blocked) -> FloatArray:
    """Make boxes (B, 4) of the blocked cells and the outer wall, one per run of cells in a row."""
    solid = np.flipud(np.pad(blocked, 1, constant_values=True))
    edge = np.diff(np.pad(solid.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edge > 0)
    _, last = np.nonzero(edge < 0)
    boxes: FloatArray = CELL_M * np.column_stack([first - 1, row - 1, last - 1, row]).astype(float)
    return boxes


def _furthest(blocked: Blocked, path: Path) -> MapTask:
    """Find the task between two far ends of the largest open area, by two breadth-first waves."""
    parts, count = ndimage.label(~blocked)
    if count == 0:
        raise InputError(f"{path}: contains no free cell")
    part = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    begin = _last_reached(part, *map(int, np.argwhere(part)[0]))
    end = _last_reached(part, *begin)
    return MapTask(path.name, blocked.shape[::-1], (begin[1], begin[0]), (end[1], end[0]), 0.0)


@njit(cache=True)
def _last_reached(part: Blocked, row: int, column: int) -> tuple[int, int]:
    """Find the cell (row, column) that a wave over four neighbours reaches last."""
    rows, columns = part.shape
    steps = np.full(part.shape, -1, np.int64)
    queue = np.empty((part.size, 2), np.int64)
    steps[row, column], queue[0, 0], queue[0, 1] = 0, row, column
    first, last = 0, 1
    while first < last:
        r, c = queue[first]
        first += 1
        for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            r1, c1 = r + dr, c + dc
            inside = 0 <= r1 < rows and 0 <= c1 < columns
            if inside and part[r1, c1] and steps[r1, c1] < 0:
                steps[r1, c1] = steps[r, c] + 1
                queue[last, 0], queue[last, 1] = r1, c1
                last += 1
    most = int(np.argmax(steps))
    return most // columns, most % columns
