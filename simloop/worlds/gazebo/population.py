"""Place the models of a ``<population>``, as far as their places are told.

Gazebo draws the places of the distributions ``random`` and ``uniform`` at each start.
"""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np

from simloop.common.errors import InputError
from simloop.common.limits import SHAPES, check_limit
from simloop.messages import FloatArray
from simloop.worlds.gazebo.values import child_numbers, name_of, pose_of, transform

_LINES = {"linear-x": 0, "linear-y": 1, "linear-z": 2}


def poses_of_population(where: str, population: Xml.Element) -> list[FloatArray]:
    """Compute the poses of a population's models, by the rules of Gazebo's Population class.

    Args:
        where: the file, for the error text.
        population: the element.

    Returns:
        (4, 4) poses in map; the models are not turned.

    Raises:
        InputError: the places are drawn by Gazebo, or a value is wrong. The text has one line.
    """
    where = f"{where}: population {name_of(population)}"
    pose = pose_of(where, population)
    spread = population.find("distribution")
    kind = "" if spread is None else (spread.findtext("type") or "").strip()
    if spread is not None and kind == "grid":
        corner, offsets = _grid(where, spread)
    elif kind in _LINES and population.find("box") is not None:
        corner, offsets = _line(where, population, _LINES[kind])
    else:
        raise InputError(
            f"{where}: distribution '{kind[:40]}': where its models stand cannot be told; "
            f"choices: grid, or in a box {', '.join(_LINES)}"
        )
    # Gazebo moves the corner along the world's axes, and turns the offsets with the pose.
    places = pose[:3, 3] - corner + offsets @ pose[:3, :3].T
    return [transform(place) for place in places]


def _grid(where: str, spread: Xml.Element) -> tuple[FloatArray, FloatArray]:
    """Compute corner (3,) and offsets (N, 3) of rows along x, one after another along y."""
    rows, columns = (_count(where, spread, tag) for tag in ("rows", "cols"))
    check_limit(rows * columns, SHAPES, f"{where}: models")
    step = np.array(child_numbers(where, spread, "step", 3))
    row, column = np.divmod(np.arange(rows * columns), columns)
    offsets = np.stack([column * step[0], row * step[1], 0.0 * row], axis=1)
    return 0.5 * step * [columns - 1, rows - 1, 0], offsets


def _line(where: str, population: Xml.Element, axis: int) -> tuple[FloatArray, FloatArray]:
    """Compute corner (3,) and offsets (N, 3) along an axis of the box, through its middle."""
    box = population.find("box")
    assert box is not None
    size = np.array(child_numbers(where, box, "size", 3))
    count = _count(where, population, "model_count")
    check_limit(count, SHAPES, f"{where}: models")
    offsets = np.tile(0.5 * size, (count, 1))
    offsets[:, axis] = size[axis] * np.arange(count) / count
    return 0.5 * size, offsets


def _count(where: str, element: Xml.Element, tag: str) -> int:
    (value,) = child_numbers(where, element, tag, 1)
    if value < 1.0 or value != round(value):
        raise InputError(f"{where}: {tag} {value:g}: must be a whole number of 1 or more")
    return int(value)
