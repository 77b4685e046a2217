"""Read maps in the format of ROS map_server: a YAML file and a PGM image.

The format is described at http://wiki.ros.org/map_server.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.messages import FloatArray

OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
"""Default thresholds of map_server: a cell is occupied above the first, free below the second."""

_SURE = 2.0  # log-odds of an occupied cell; a free cell has -_SURE
_MOST_CELLS = 400_000_000  # most cells that a map can have
_NEEDS = ("image", "resolution", "origin")
_MODES = ("trinary", "scale", "raw")


def read_cells(yaml_file: Path) -> tuple[float, FloatArray, NDArray[np.float32]]:
    """Read a map.

    Args:
        yaml_file: The map's YAML file. It names the image, which must be a PGM file.

    Returns:
        The side of a cell, m; the position (2,) in map of the corner with the smallest x and y, m;
        and the log-odds (rows, columns) of the cells, indexed [iy, ix]: positive if occupied,
        negative if free, 0 if unknown.

    Raises:
        InputError: If a file cannot be read or is not a map.
    """
    facts = _read_yaml(yaml_file)
    for key in _NEEDS:
        if key not in facts:
            raise InputError(f"{yaml_file}: {key} is missing; required: {', '.join(_NEEDS)}")
    resolution = _number(yaml_file, facts, "resolution")
    origin = _numbers(yaml_file, facts["origin"])
    if not 0.005 <= resolution <= 1.0:
        raise InputError(f"{yaml_file}: resolution {resolution:g} m is not between 0.005 and 1 m")
    if len(origin) == 3 and origin[2] != 0.0:
        raise InputError(
            f"{yaml_file}: origin has a yaw of {origin[2]:g} rad; only 0 is supported, so turn "
            "the image instead"
        )
    mode = facts.get("mode", "trinary")
    if mode not in _MODES:
        raise InputError(f"{yaml_file}: unknown mode '{mode}'; choices: {', '.join(_MODES)}")
    above = _number(yaml_file, facts, "occupied_thresh", OCCUPIED_ABOVE)
    below = _number(yaml_file, facts, "free_thresh", FREE_BELOW)
    grey = read_pgm(yaml_file.parent / facts["image"].strip("'\""))
    negate = facts.get("negate", "0").lower() not in ("0", "false", "no")
    odds = _log_odds(grey, mode, negate, above, below)[::-1]
    return resolution, np.array(origin[:2]), odds


def _log_odds(
    grey: NDArray[np.uint8], mode: str, negate: bool, above: float, below: float
) -> NDArray[np.float32]:
    """Compute the log-odds (rows, columns) of an image's cells by map_server's rules."""
    if mode == "raw":
        # In mode raw a pixel is an occupancy of 0 to 100 %. Greater values are unknown.
        occupied, free = (grey >= 100 * above) & (grey <= 100), grey <= 100 * below
    else:
        chance = grey / 255.0 if negate else (255.0 - grey) / 255.0
        occupied, free = chance > above, chance < below
    odds = np.zeros(grey.shape, np.float32)
    odds[free], odds[occupied] = -_SURE, _SURE
    if mode == "scale":  # the occupancy is linear between the thresholds
        between = ~(free | occupied)
        share = np.clip((chance[between] - below) / max(1e-9, above - below), 0.02, 0.98)
        odds[between] = np.log(share / (1.0 - share))
    return odds


def read_pgm(path: Path) -> NDArray[np.uint8]:
    """Read a PGM image.

    Args:
        path: The file: binary (P5) or plain (P2), with 8 bits per pixel.

    Returns:
        (rows, columns) brightness, scaled to 0 to 255. Row 0 is the upper edge.

    Raises:
        InputError: If the file cannot be read or is not such an image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    head = re.match(rb"P([25])((?:\s+|#[^\n]*\n)+(\d+))((?:\s+|#[^\n]*\n)+(\d+))"
                    rb"((?:\s+|#[^\n]*\n)+(\d+))\s", data)  # fmt: skip
    if head is None:
        raise InputError(f"{path}: not a PGM image (P5 or P2)")
    columns, rows, most = int(head[3]), int(head[5]), int(head[7])
    if not (0 < most < 256 and 0 < columns * rows <= _MOST_CELLS):
        raise InputError(
            f"{path}: {columns} x {rows} pixels of 0 to {most}; a map has 1 to {_MOST_CELLS:,} "
            "pixels of 8 bits"
        )
    body = data[head.end() :]
    try:
        if head[1] == b"5":
            flat = np.frombuffer(body, np.uint8, columns * rows).astype(np.float64)
        else:
            flat = np.array(body.split()[: columns * rows], np.int64).astype(np.float64)
    except (ValueError, OverflowError):
        flat = np.empty(0)
    if flat.size != columns * rows or flat.max() > most or flat.min() < 0:
        raise InputError(
            f"{path}: cut off, or values that are not {columns} x {rows} numbers of 0 to {most}"
        )
    values = np.round(flat * (255.0 / most)).astype(np.uint8)
    return values.reshape(rows, columns)


def _read_yaml(path: Path) -> dict[str, str]:
    """Read the ``key: value`` lines of a flat YAML file. List items may be lines ``- item``."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise InputError(f"{path}: {reason}") from None
    facts: dict[str, str] = {}
    key = ""
    for number, line in enumerate(lines, 1):
        text = line.split(" #")[0].strip()
        if not text or text.startswith("#") or text == "---":
            continue
        if text.startswith("- ") and key:
            facts[key] = f"{facts[key]} {text[2:]}".strip()
            continue
        key, colon, value = text.partition(":")
        if not colon:
            raise InputError(f"{path}, line {number}: expected 'key: value'")
        key = key.strip()
        facts[key] = value.strip()
    return facts


def _number(path: Path, facts: dict[str, str], key: str, otherwise: float = math.nan) -> float:
    try:
        value = float(facts[key]) if key in facts else otherwise
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}: {key}: '{facts.get(key, '')}' is not a number")
    return value


def _numbers(path: Path, text: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in re.split(r"[\[\],\s]+", text) if word])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (2, 3) or not np.isfinite(values).all():
        raise InputError(f"{path}: origin: '{text}' is not [x, y, yaw] in m and rad")
    return values
