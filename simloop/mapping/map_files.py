"""Maps as ROS's map_server keeps them, read: a YAML file and its grey picture (PGM).

As its loader reads them, ``trinary``, ``scale`` and ``raw``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from simloop.common.map_server import read_cells
from simloop.config import SlamConfig
from simloop.mapping.grid_map import GridMap


def load_map(yaml_file: Path, config: SlamConfig) -> GridMap:
    """The map in a file, with its own resolution. Raises InputError for what is no map."""
    resolution, origin, odds = read_cells(yaml_file)
    return GridMap.of(replace(config, resolution_m=resolution), origin, odds)
