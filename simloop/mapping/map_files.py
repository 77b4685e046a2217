"""Read and write maps in the format of ROS's map_server: a YAML file and a picture.

The modes ``trinary``, ``scale`` and ``raw`` are read in the same way as by map_server, and a map
with a yaw is turned. Maps are written in the mode ``trinary``, with a PGM picture.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from simloop.common.files import Batch, written_together
from simloop.common.map_server import FREE_BELOW, OCCUPIED_ABOVE, MapCells, known_cells
from simloop.config import SlamConfig
from simloop.mapping.grid_map import GridMap

OCCUPIED, UNKNOWN, FREE = 0, 205, 254


def load_map(yaml_file: Path, config: SlamConfig) -> GridMap:
    """Read a map.

    Args:
        yaml_file: The YAML file. Its image path is relative to the YAML file.
        config: Settings of the grid, except the resolution, which is read from the file.

    Returns:
        The map.

    Raises:
        InputError: A file is missing, truncated, or not a map, or it has more than
            ``max_cells`` cells between those that are known.
    """
    cells = known_cells(yaml_file, config.max_cells)
    upright, step = cells.upright(config.max_cells), cells.resolution_m
    grid = GridMap.of(replace(config, resolution_m=step), upright.origin_m, upright.log_odds)
    if upright is not cells:
        _put_in_place(grid, cells)
    return grid


def _put_in_place(grid: GridMap, cells: MapCells) -> None:
    """Move each surface from the middle of its cell to that of the turned cell it was read from.

    So a wall stays as thin and as straight as it was before it was sampled.
    """
    at, step = np.nonzero(grid.occupied), grid.resolution_m
    corners = np.column_stack(at[::-1]).astype(np.float64) * step
    turned = cells.cells_at(grid.origin_m + corners + 0.5 * step).astype(np.float64)
    offsets = cells.place_m((turned + 0.5) * step) - grid.origin_m
    # A surface belongs to the cell in which it lies.
    offsets = np.clip(offsets, corners + 0.01 * step, corners + 0.99 * step)
    grid.hits[at] = np.column_stack([offsets, np.ones(len(offsets))])
    grid.renew_fields()


def save_map(grid: GridMap, yaml_file: Path, files: Batch | None = None) -> None:
    """Write a map as a YAML file and an image of the same name beside it: both, or none.

    Args:
        grid: The map.
        yaml_file: The file to write; the image has the suffix ``.pgm``.
        files: Files that the map belongs to; None if it belongs to no others.

    Raises:
        InputError: A file cannot be written.
    """
    if files is None:
        with written_together() as both:
            save_map(grid, yaml_file, both)
        return
    picture = yaml_file.with_suffix(".pgm")
    values = np.full(grid.log_odds.shape, UNKNOWN, np.uint8)
    values[grid.log_odds < 0.0] = FREE
    values[grid.occupied] = OCCUPIED
    rows, columns = values.shape
    header = f"P5\n# simloop, {grid.resolution_m:.9g} m a cell\n{columns} {rows}\n255\n"
    files.write_bytes(
        picture, header.encode("ascii") + values[::-1].tobytes()
    )  # first row is at the top
    x, y = grid.origin_m.tolist()
    files.write_text(
        yaml_file,
        f"image: {picture.name}\nmode: trinary\nresolution: {grid.resolution_m!r}\n"
        f"origin: [{x!r}, {y!r}, 0.0]\nnegate: 0\n"
        f"occupied_thresh: {OCCUPIED_ABOVE}\nfree_thresh: {FREE_BELOW}\n",
    )
