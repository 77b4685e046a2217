"""A map_server map (YAML with PGM or PNG) as a world: what is occupied there stands here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.common.map_server import read_cells
from simloop.worlds.layout import Layout, box

_MOST_BOXES = 5000


def read_map_world(yaml_file: Path) -> Layout:
    """Boxes that cover the occupied cells exactly; unknown is free. Raises InputError."""
    step, origin, odds = read_cells(yaml_file)
    rows, columns = odds.shape
    x0, y0 = origin.tolist()
    found = tile_rectangles(odds > 0.0)
    if len(found) > _MOST_BOXES:
        raise InputError(
            f"{yaml_file}: {len(found):,} boxes would be needed, more than {_MOST_BOXES:,}: "
            "a coarser picture, or a cleaner one"
        )
    boxes = [
        box(x0 + c0 * step, y0 + r0 * step, x0 + c1 * step, y0 + r1 * step)
        for r0, c0, r1, c1 in found
    ]
    return Layout((x0, y0, x0 + columns * step, y0 + rows * step), tuple(boxes))


def tile_rectangles(filled: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """(row, column, beyond row, beyond column) of tile_rectangles that tile the filled cells.

    Greedy: each as wide as its row allows, then as high as the rows below it are filled.
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
