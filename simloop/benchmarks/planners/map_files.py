"""Planning tasks from files: MovingAI maps with their scenarios, and images, dark where blocked.

Format: https://movingai.com/benchmarks/formats.html. A cell is `CELL_M` wide; the robot is a point
that keeps `SAFE_CELLS` of a cell, so that it passes where one cell is free. The planners get a
distance field four times as fine as the map (twice, if that is large), the judge the blocked cells
themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simloop.benchmarks.planners.scenes import Instance
from simloop.common.errors import InputError
from simloop.messages import FloatArray, WorldView

CELL_M = 0.2
SAFE_CELLS = 0.35
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")
TASKS = 10
"""How many of a scenario file's tasks are taken, evenly from the easiest to the hardest."""
_FINE = 4
_MOST_CELLS, _LARGE_CELLS = 2**20, 2**18
_MOST_BYTES = 2**26
_FREE, _BLOCKED = ".GS", "@OTW"
_DARK = 128

Blocked = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Errand:
    """One line of a scenario: start and goal as column, row; length: the octile optimum, cells."""

    start: tuple[int, int]
    goal: tuple[int, int]
    length: float


def is_map_file(name: str) -> bool:
    """Whether a scene's name looks like a file of one of the kinds read here."""
    return name.lower().endswith((".map", ".scen", *IMAGES))


def load_file(path: Path) -> list[Instance]:
    """The tasks of a .map (with its .map.scen, if that lies beside it), a .scen or an image.

    Raises InputError, one line, for whatever cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in IMAGES:
        return _instances(path, read_image(path), [])
    if suffix == ".scen":
        errands = parse_scenario(_text(path), path)
        beside = path.with_suffix("")
        if beside.suffix.lower() != ".map":
            beside = path.with_suffix(".map")
        return _instances(path, parse_map(_text(beside), beside), errands)
    blocked = parse_map(_text(path), path)
    scenario = Path(f"{path}.scen")
    errands = parse_scenario(_text(scenario), scenario) if scenario.is_file() else []
    return _instances(path, blocked, errands)


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: larger than {_MOST_BYTES >> 20} MB")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def _text(path: Path) -> str:
    return _bytes(path).decode("latin-1")


def parse_map(text: str, source: Path) -> Blocked:
    """(rows, cols) of a MovingAI map, row 0 on top: True where nothing may pass."""
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
    try:
        (word,) = words
        size = int(word)
    except ValueError:
        raise InputError(f"{source}: line {line}: expected one whole number") from None
    if not 1 <= size <= _MOST_CELLS:
        raise InputError(f"{source}: line {line}: {size} is not between 1 and {_MOST_CELLS}")
    return size


def parse_scenario(text: str, source: Path) -> list[Errand]:
    """The errands of a MovingAI .scen: bucket, map, width, height, start, goal, octile length."""
    lines = text.splitlines()
    if not lines or lines[0].split() not in (["version", "1"], ["version", "1.0"]):
        raise InputError(f"{source}: line 1: expected 'version 1'")
    errands = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        words = line.split("\t") if "\t" in line else line.split()
        if len(words) != 9:
            raise InputError(f"{source}: line {number}: {len(words)} columns, expected 9")
        try:
            x0, y0, x1, y1 = (int(word) for word in words[4:8])
            length = float(words[8])
        except ValueError:
            raise InputError(f"{source}: line {number}: columns 5 to 9 are to be numbers") from None
        if not np.isfinite(length) or length < 0.0 or min(x0, y0, x1, y1) < 0:
            raise InputError(f"{source}: line {number}: negative or not finite")
        errands.append(Errand((x0, y0), (x1, y1), length))
    if not errands:
        raise InputError(f"{source}: no task in it")
    return errands


def read_image(path: Path) -> Blocked:
    """(rows, cols): True where an image is dark (transparent counts as white)."""
    data = np.frombuffer(_bytes(path), dtype=np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None or image.size == 0:
        raise InputError(f"{path}: not an image that can be read")
    if image.shape[0] * image.shape[1] > _MOST_CELLS:
        raise InputError(f"{path}: more than {_MOST_CELLS} pixels")
    if image.dtype != np.uint8:
        most = 65535.0 if image.dtype == np.uint16 else 1.0
        image = np.clip(image / most * 255.0, 0, 255).astype(np.uint8)
    if image.ndim == 2:
        return np.asarray(image < _DARK)
    grey = image[..., :3].mean(axis=2)
    if image.shape[2] == 4:
        grey = 255.0 - (255.0 - grey) * (image[..., 3] / 255.0)
    return np.asarray(grey < _DARK)


def _instances(path: Path, blocked: Blocked, errands: list[Errand]) -> list[Instance]:
    """Tasks on a map: those given, else between the two ends of its largest open part."""
    rows, cols = blocked.shape
    world, boxes = _world(blocked), _boxes(blocked)
    if not errands:
        errands = [_furthest(blocked, path)]
    for errand in errands:
        for x, y in (errand.start, errand.goal):
            if x >= cols or y >= rows or blocked[y, x]:
                raise InputError(f"{path}: column {x}, row {y} is not a free cell of the map")
    errands = [e for e in errands if e.start != e.goal] or errands
    count = min(TASKS, len(errands))
    chosen = [errands[round(k)] for k in np.linspace(0, len(errands) - 1, count)]
    return [
        Instance(
            f"{path.stem}-{number}",
            world,
            np.array([*_centre(errand.start, rows), 0.0]),
            _centre(errand.goal, rows),
            SAFE_CELLS * CELL_M,
            boxes,
        )
        for number, errand in enumerate(chosen)
    ]


def _centre(cell: tuple[int, int], rows: int) -> FloatArray:
    """(2,) a cell's middle, x to the right and y up from the map's lower left corner, m."""
    return CELL_M * np.array([cell[0] + 0.5, rows - cell[1] - 0.5])


def _world(blocked: Blocked) -> WorldView:
    """The map, walled in, as a distance field."""
    parts = _FINE if blocked.size <= _LARGE_CELLS else _FINE // 2
    solid = np.flipud(np.pad(blocked, 1, constant_values=True))
    fine = np.kron(solid, np.ones((parts, parts), dtype=bool))
    resolution = CELL_M / parts
    # On a lattice of half cells, where a blocked cell has its border too, the nearest point of any
    # blocked cell is a lattice point: the distances at the cells' middles are exact.
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
    """(B, 4) the blocked cells and the wall about the map, runs of cells in a row as one box."""
    solid = np.flipud(np.pad(blocked, 1, constant_values=True))
    edge = np.diff(np.pad(solid.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edge > 0)
    _, last = np.nonzero(edge < 0)
    boxes: FloatArray = CELL_M * np.column_stack([first - 1, row - 1, last - 1, row]).astype(float)
    return boxes


def _furthest(blocked: Blocked, path: Path) -> Errand:
    """From one end of the map's largest open part to the other, by two sweeps of a wave."""
    parts, count = ndimage.label(~blocked)
    if count == 0:
        raise InputError(f"{path}: no free cell in it")
    part = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    begin = _last_reached(part, tuple(np.argwhere(part)[0]))
    end = _last_reached(part, begin)
    return Errand((begin[1], begin[0]), (end[1], end[0]), 0.0)


def _last_reached(part: Blocked, cell: tuple[int, ...]) -> tuple[int, int]:
    """Row and column of the cell to which a wave through four neighbours comes last."""
    wave = np.zeros_like(part)
    wave[cell] = True
    front = wave
    while True:
        spread = ndimage.binary_dilation(front) & part & ~wave
        if not spread.any():
            row, col = np.argwhere(front)[0]
            return int(row), int(col)
        front = spread
        wave |= spread
