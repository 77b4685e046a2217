"""Read a map_server map (YAML and picture) as a world. Its occupied cells become boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.common.limits import SHAPES
from simloop.common.map_server import MapCells, read_cells
from simloop.worlds.floor_plan import check_floor
from simloop.worlds.layout import HEIGHT_M, Layout, box
from simloop.worlds.obstacles import Obstacle


def read_map_world(yaml_file: Path) -> Layout:
    """Read a world from a map. Boxes cover exactly its occupied cells; unknown cells are free.

    Args:
        yaml_file: the map's YAML file.

    Returns:
        The map's bounds and the boxes. Those of a map with a yaw are turned; the bounds are then
        the least that hold it, and what they hold beside it is free. A note tells if more than
        half of the map is unknown.

    Raises:
        InputError: the file is not a map, is too large, or needs too many boxes. The text has one
            line.
    """
    cells = read_cells(yaml_file)
    corners = cells.corners_m()
    bounds = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    try:
        check_floor(bounds)
    except InputError as error:
        raise InputError(f"{yaml_file}: {error}") from None
    found = tile_rectangles(cells.log_odds > 0.0, SHAPES + 1)
    if len(found) > SHAPES:
        raise InputError(
            f"{yaml_file}: more than {SHAPES:,} boxes would be needed: "
            "use a coarser or a cleaner picture"
        )
    if cells.yaw_rad == 0.0:
        step, (x0, y0) = cells.resolution_m, cells.origin_m.tolist()
        rows, columns = cells.log_odds.shape
        boxes = [
            box(x0 + c0 * step, y0 + r0 * step, x0 + c1 * step, y0 + r1 * step)
            for r0, c0, r1, c1 in found
        ]
        whole = (x0, y0, x0 + columns * step, y0 + rows * step)
        return Layout(whole, tuple(boxes), notes=_notes(yaml_file, cells))
    turned = tuple(_turned_box(cells, *one) for one in found)
    return Layout(bounds, turned, notes=_notes(yaml_file, cells))


def _notes(yaml_file: Path, cells: MapCells) -> tuple[str, ...]:
    """Tell how much of the map is assumed, if it is most of it."""
    unknown = cells.log_odds.size - np.count_nonzero(cells.log_odds)
    percent = 100 * unknown // cells.log_odds.size  # 100 only if nothing is known
    if 2 * unknown <= cells.log_odds.size:
        return ()
    return (f"{yaml_file.name}: {percent} % of the map is unknown: it counts as free",)


def _turned_box(cells: MapCells, row: int, column: int, end_row: int, end_column: int) -> Obstacle:
    step = cells.resolution_m
    middle = 0.5 * step * np.array([[column + end_column, row + end_row]])
    ((x, y),) = cells.place_m(middle).tolist()
    size = ((end_column - column) * step, (end_row - row) * step)
    return Obstacle("box", (x, y), size, cells.yaw_rad, HEIGHT_M)


def tile_rectangles(
    filled: NDArray[np.bool_], most: int = SHAPES
) -> list[tuple[int, int, int, int]]:
    """Cover the filled cells of a grid with rectangles that do not overlap.

    The method is greedy: each rectangle is as wide as its first row allows, then as high as
    possible.

    Args:
        filled: (rows, cols) which cells are filled.
        most: number of rectangles after which the search ends.

    Returns:
        Row, column, row after the end and column after the end of each rectangle, at most
        ``most``.
    """
    return [(r0, c0, r1, c1) for r0, c0, r1, c1 in _tile(filled.copy(), most).tolist()]


@njit(cache=True, nogil=True)
def _tile(left: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Find the rectangles (N, 4), and empty the cells ``left`` that they cover."""
    rows, columns = left.shape
    found = np.empty((most, 4), np.int64)
    count = 0
    for row in range(rows):
        for column in range(columns):
            if not left[row, column]:
                continue
            if count == most:
                return found
            wide = column
            while wide < columns and left[row, wide]:
                wide += 1
            high = row
            while high < rows and left[high, column:wide].all():
                high += 1
            left[row:high, column:wide] = False
            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = (
                row, column, high, wide,
            )  # fmt: skip
            count += 1
    return found[:count]
