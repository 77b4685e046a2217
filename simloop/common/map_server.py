"""Read maps in the format of ROS map_server: a YAML file and a picture.

The format is described at http://wiki.ros.org/map_server. PyYAML reads the YAML file. Transparent
pixels are unknown in the modes trinary and scale, as in navigation2's map_server of today. Older
ones take transparency in the mode trinary for a fourth colour, in which opaque black is not black.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from simloop.common.errors import InputError, did_you_mean, printable
from simloop.common.input_files import read_text
from simloop.common.limits import CELLS, MAP_YAML_BYTES, NESTING, check_limit
from simloop.common.pictures import Picture, read_picture
from simloop.messages import FloatArray

OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
"""Default thresholds of map_server: a cell is occupied above the first, free below the second."""

_SURE = 2.0  # log-odds of an occupied cell; a free cell has -_SURE
_NEEDS = ("image", "resolution", "origin")
_KEYS = (*_NEEDS, "negate", "mode", "occupied_thresh", "free_thresh")
_MODES = ("trinary", "scale", "raw")
_TRUE, _FALSE = ("true", "yes", "on", "y"), ("false", "no", "off", "n")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)
_NO_TURN_RAD = 1e-9
_FARTHEST = 1e4  # of an origin, m
_MOST_EVENTS = 10_000  # parts of a YAML file; a map's has about 30
_Document = dict[str, tuple[str | list[str], int]]
"""Text of each known key's value, or texts of its list, and line."""


@dataclass(frozen=True, slots=True, eq=False)
class MapCells:
    """The cells of a map.

    Attributes:
        resolution_m: Side of a cell, m.
        origin_m: (2,) position in map of the outer corner of the first cell, m.
        yaw_rad: Direction of the rows in map, rad: the whole map is turned about its origin.
        log_odds: (rows, columns) float32, [iy, ix]: positive if occupied, negative if free, 0 if
            unknown.
    """

    resolution_m: float
    origin_m: FloatArray
    yaw_rad: float
    log_odds: NDArray[np.float32]

    def corners_m(self) -> FloatArray:
        """Compute the corners of the map.

        Returns:
            (4, 2) x, y in map, m, counter-clockwise from the origin.
        """
        rows, columns = self.log_odds.shape
        local = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) * self.resolution_m
        return self.origin_m + local @ self._turn()

    def place_m(self, local_m: FloatArray) -> FloatArray:
        """Transform points from the map's own axes to the frame map.

        Args:
            local_m: (N, 2) distances from the origin along the rows and the columns, m.

        Returns:
            (N, 2) x, y in map, m.
        """
        return self.origin_m + local_m @ self._turn()

    def cells_at(self, points_m: FloatArray) -> NDArray[np.int64]:
        """Find the cells in which points lie.

        Args:
            points_m: (N, 2) x, y in map, m.

        Returns:
            (N, 2) column and row; beyond the shape of ``log_odds`` outside of the map.
        """
        local = (points_m - self.origin_m) @ self._turn().T
        return np.floor(local / self.resolution_m).astype(np.int64)

    def upright(self, most: int = CELLS) -> MapCells:
        """Sample a turned map on a grid along the axes of the frame map.

        Args:
            most: The largest number of cells.

        Returns:
            The map with a yaw of 0. Each of its cells is as the cell in which its centre lies;
            those outside of the turned map are unknown.

        Raises:
            InputError: If the grid would have too many cells.
        """
        if self.yaw_rad == 0.0:
            return self
        step, corners = self.resolution_m, self.corners_m()
        low, high = corners.min(axis=0), corners.max(axis=0)
        columns, rows = np.maximum(1, np.ceil((high - low) / step - 1e-6)).astype(int).tolist()
        check_limit(rows * columns, most, "the turned map: cells")
        odds = np.zeros((rows, columns), np.float32)
        x = low[0] + (np.arange(columns) + 0.5) * step
        for row in range(rows):  # one by one, to need little memory
            centres = np.column_stack([x, np.full(columns, low[1] + (row + 0.5) * step)])
            i, j = self.cells_at(centres).T
            inside = (i >= 0) & (j >= 0) & (i < self.log_odds.shape[1])
            inside &= j < self.log_odds.shape[0]
            odds[row, inside] = self.log_odds[j[inside], i[inside]]
        return MapCells(step, low, 0.0, odds)

    def cropped(self) -> MapCells:
        """Cut off the rows and columns at the borders in which every cell is unknown.

        Returns:
            The map, of at least one cell.
        """
        bounds = []
        for axis in (0, 1):
            known = np.flatnonzero(np.any(self.log_odds, axis=1 - axis))
            bounds.append(slice(known[0], known[-1] + 1) if len(known) else slice(0, 1))
        corner = self.resolution_m * np.array([[bounds[1].start, bounds[0].start]], np.float64)
        odds = self.log_odds[bounds[0], bounds[1]].copy()
        return MapCells(self.resolution_m, self.place_m(corner)[0], self.yaw_rad, odds)

    def _turn(self) -> FloatArray:
        """Compute the matrix that turns rows of x, y from the map's own axes to the frame map."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[cos, sin], [-sin, cos]])


def read_cells(yaml_file: Path) -> MapCells:
    """Read a map.

    Args:
        yaml_file: The map's YAML file. It names the picture, relative to itself.

    Returns:
        The cells.

    Raises:
        InputError: If a file cannot be read or is not a map.
    """
    facts = _read_yaml(yaml_file)
    resolution = _number(yaml_file, facts, "resolution")
    if not 0.005 <= resolution <= 1.0:
        raise InputError(f"{yaml_file}: resolution {resolution:g} m is not between 0.005 and 1 m")
    x, y, yaw = _origin(yaml_file, facts)
    mode = _text(yaml_file, facts, "mode", "trinary").lower()
    if mode not in _MODES:
        raise InputError(f"{yaml_file}: unknown mode '{mode}'; choices: {', '.join(_MODES)}")
    above = _number(yaml_file, facts, "occupied_thresh", OCCUPIED_ABOVE)
    below = _number(yaml_file, facts, "free_thresh", FREE_BELOW)
    if not 0.0 <= below <= above <= 1.0:
        raise InputError(
            f"{yaml_file}: free_thresh {below:g} and occupied_thresh {above:g} must be 0 to 1, the "
            "first not above the second"
        )
    negate = _switch(yaml_file, facts, "negate")
    picture = read_picture(_picture_of(yaml_file, facts), CELLS, as_shown=False)
    odds = _log_odds(picture, mode, negate, above, below)[::-1]
    return MapCells(resolution, np.array([x, y]), yaw, odds)


def known_cells(yaml_file: Path, most: int) -> MapCells:
    """Read a map for a grid that takes far more memory for each cell than the picture.

    Args:
        yaml_file: The map's YAML file.
        most: The largest number of cells.

    Returns:
        The cells. A map that has too many is cut down to those that are known: mappers often write
        pictures that are much larger than what they have seen.

    Raises:
        InputError: If a file cannot be read or is not a map, or if too many cells are left.
    """
    cells = read_cells(yaml_file)
    if cells.log_odds.size > most:
        cells = cells.cropped()
    check_limit(cells.log_odds.size, most, f"{yaml_file}: cells of a known map (slam.max_cells)")
    return cells


def picture_of(yaml_file: Path) -> Path:
    """Find the picture that a map's YAML file names.

    Args:
        yaml_file: The YAML file.

    Returns:
        The picture's path. Whether it exists is not checked.

    Raises:
        InputError: If the YAML file cannot be read or names no picture.
    """
    return _picture_of(yaml_file, _read_yaml(yaml_file, ("image",)))


def _log_odds(
    picture: Picture, mode: str, negate: bool, above: float, below: float
) -> NDArray[np.float32]:
    """Compute the log-odds (rows, columns) of a picture's cells by map_server's rules."""
    white = float(picture.white)
    level = np.arange(picture.white + 1, dtype=np.float64)
    if mode == "raw":
        # A pixel is an occupancy of 0 to 100 %, out of 255. Greater values are unknown.
        value = np.round(level / white * 255.0)
        occupied, free = (value >= 100 * above) & (value <= 100), value <= 100 * below
    else:
        chance = level / white if negate else (white - level) / white
        occupied, free = chance > above, chance < below
    odds = np.zeros(len(level), np.float32)
    odds[free], odds[occupied] = -_SURE, _SURE
    if mode == "scale":  # the occupancy is linear between the thresholds
        between = ~(free | occupied)
        share = np.clip((chance[between] - below) / max(1e-9, above - below), 0.02, 0.98)
        # A cell between the thresholds is never surer than one beyond them.
        odds[between] = np.clip(np.log(share / (1.0 - share)), -_SURE, _SURE)
    cells = odds[picture.levels]
    if picture.opacity is not None and mode != "raw":
        cells[picture.opacity < 255] = 0.0
    return cells


def _read_yaml(path: Path, needs: tuple[str, ...] = _NEEDS) -> _Document:
    """Read the known keys of a YAML file. What stands under other keys is not even built."""
    text = read_text(path, MAP_YAML_BYTES)
    try:
        _check_depth(path, yaml.parse(text, yaml.SafeLoader))
        root = yaml.compose(text, yaml.SafeLoader)
        if not isinstance(root, yaml.MappingNode):
            raise InputError(f"{path}: no 'key: value' of a map; required: {', '.join(needs)}")
        facts = _known(path, root)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        reason = getattr(error, "problem", None) or str(error)
        raise InputError(f"{path}{where}: not YAML: {reason}") from None
    for key in needs:
        if key not in facts:
            raise InputError(f"{path}: {key} is missing; required: {', '.join(needs)}")
    return facts


def _check_depth(path: Path, events: Iterator[yaml.Event]) -> None:
    """Raise InputError for a long or deeply nested file, before anything is made of it."""
    depth = 0
    for number, event in enumerate(events):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        check_limit(depth, NESTING, f"{path}: depth of nested values")
        check_limit(number, _MOST_EVENTS, f"{path}: number of values")


def _known(path: Path, root: yaml.MappingNode) -> _Document:
    """Read the known keys. Refuse what map_server could understand otherwise, or not at all."""
    facts: _Document = {}
    others = []
    for key_node, node in root.value:
        key = key_node.value if isinstance(key_node, yaml.ScalarNode) else ""
        line = node.start_mark.line + 1
        if key in facts:
            raise InputError(f"{path}, line {line}: {key} is given twice")
        if key == "<<":
            raise InputError(f"{path}, line {line}: << is not supported; give each key itself")
        if key in _KEYS:
            # The texts themselves are used, as YAML 1.1 takes 010 for 8, 1:30 for 90, and 5e-2 for
            # a text.
            parts = node.value if isinstance(node, yaml.SequenceNode) else [node]
            if not all(isinstance(one, yaml.ScalarNode) for one in parts):
                raise InputError(f"{path}, line {line}: {key}: nested values have no meaning here")
            texts = [one.value.strip() for one in parts]
            facts[key] = (texts if parts is node.value else texts[0], line)
        elif isinstance(node, yaml.ScalarNode):
            others.append(key)
    for key in others:
        hint = did_you_mean(key, [one for one in _KEYS if one not in facts])
        if "did you mean" in hint:
            raise InputError(f"{path}: unknown key '{key}'{hint}")
    return facts


def _wrong(path: Path, facts: _Document, key: str, wanted: str) -> InputError:
    value, line = facts[key]
    text = value if isinstance(value, str) else f"[{', '.join(value)}]"
    return InputError(f"{path}, line {line}: {key}: '{printable(text, 60)}' is not {wanted}")


def _number(path: Path, facts: _Document, key: str, otherwise: float = math.nan) -> float:
    if key not in facts:
        return otherwise
    number = _as_number(facts[key][0])
    if not math.isfinite(number):
        raise _wrong(path, facts, key, "a number")
    return number


def _as_number(text: str | list[str]) -> float:
    """Convert a text to a number; NaN if it is none."""
    return float(text) if isinstance(text, str) and _NUMBER.fullmatch(text) else math.nan


def _switch(path: Path, facts: _Document, key: str) -> bool:
    """Read a value that is on or off in any of the ways in which people write it."""
    value = facts.get(key, ("0", 0))[0]
    word = value.lower() if isinstance(value, str) else ""
    number = _as_number(value)
    if word in _TRUE or number == 1.0:
        return True
    if word in _FALSE or number == 0.0:
        return False
    raise _wrong(path, facts, key, "0 or 1")


def _text(path: Path, facts: _Document, key: str, otherwise: str = "") -> str:
    value = facts.get(key, (otherwise, 0))[0]
    if not isinstance(value, str) or not value:
        raise _wrong(path, facts, key, "a text")
    return value


def _origin(path: Path, facts: _Document) -> tuple[float, float, float]:
    value = facts["origin"][0]
    numbers = [_as_number(one) for one in value] if isinstance(value, list) else []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise _wrong(path, facts, "origin", "[x, y, yaw] in m and rad")
    for number in numbers:
        check_limit(abs(number), _FARTHEST, f"{path}: origin")
    yaw = math.remainder(numbers[2], 2.0 * math.pi) if len(numbers) == 3 else 0.0
    return numbers[0], numbers[1], yaw if abs(yaw) > _NO_TURN_RAD else 0.0


def _picture_of(path: Path, facts: _Document) -> Path:
    return path.parent / _text(path, facts, "image")
