"""Read a map_server map (YAML and PGM) as a world. Its occupied cells become boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.common.map_server import read_cells
from simloop.worlds.layout import Layout, box

_MOST_BOXES = 5000


def read_map_world(yaml_file: Path) -> Layout:
    """Read a world from a map. Boxes cover exactly its occupied cells; unknown cells are free.

    Args:
        yaml_file: the map's YAML file.

    Returns:
        The map's bounds and the boxes.

    Raises:
        InputError: the file is not a map, or needs too many boxes. The text has one line.
    """
    step, origin, odds = read_cells(yaml_file)
    rows, columns = odds.shape
    x0, y0 = origin.tolist()
    found = tile_rectangles(odds > 0.0)
    if len(found) > _MOST_BOXES:
        raise InputError(
            f"{yaml_file}: {len(found):,} boxes would be needed, more than {_MOST_BOXES:,}: "
            "use a coarser or a cleaner picture"
        )
    boxes = [
        box(x0 + c0 * step, y0 + r0 * step, x0 + c1 * step, y0 + r1 * step)
        for r0, c0, r1, c1 in found
    ]
    return Layout((x0, y0, x0 + columns * step, y0 + rows * step), tuple(boxes))


def tile_rectangles(filled: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Cover the filled cells of a grid with rectangles that do not overlap.

    The method is greedy: each rectangle is as wide as its first row allows, then as high as
    possible.

    Args:
        filled: (rows, cols) which cells are filled.

    Returns:
        Row, column, row after the end and column after the end of each rectangle.
    """
    left = filled.copy()
    found = []
    for row, column in np.argwhere(filled).tolist():
        if not left[row, column]:
            continue
        free = np.flatnonzero(~left[row, column:])
        wide = int(free[0]) if free.size else left.shape[1] - column
        below = left[row:, column : column + wide].all(axis=1)
        open_rows = np.flatnonzero(~below)
        high = int(open_rows[0]) if open_rows.size else left.shape[0] - row
        left[row : row + high, column : column + wide] = False
        found.append((row, column, row + high, column + wide))
    return found
