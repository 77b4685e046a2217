"""Read Gazebo worlds (SDF) of upright cylinders and boxes.

Only the collision shapes of models are read. The poses of model, link and collision are nested.
Meshes, includes and other shapes raise an error that names the model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from simloop.common.errors import InputError
from simloop.geometry.se2 import compose
from simloop.messages import FloatArray
from simloop.worlds.layout import Bounds, Layout
from simloop.worlds.obstacles import Obstacle, ShapeName

_MOST_BYTES = 50_000_000
_ROOM_M = 2.0  # free floor around all obstacles
_TILT_RAD = 1e-3  # largest roll or pitch of an upright model
_FLAT = ("plane",)


def read_sdf(file: Path, bounds: Bounds | None = None) -> Layout:
    """Read a world from an SDF file.

    Args:
        file: the SDF file.
        bounds: x_min, y_min, x_max, y_max of the floor, m; None: 2 m around all obstacles.

    Returns:
        The bounds and the obstacles.

    Raises:
        InputError: the file is not SDF, or has unsupported content. The text has one line.
    """
    obstacles = tuple(_things(file, _parse(file)))
    if bounds is None:
        outlines = [s for one in obstacles for s in one.sections()]
        if not outlines:
            raise InputError(f"{file}: the world has no obstacles; give bounds_m")
        low = np.min([s.vertices_m.min(axis=0) - s.radius_m for s in outlines], axis=0) - _ROOM_M
        high = np.max([s.vertices_m.max(axis=0) + s.radius_m for s in outlines], axis=0) + _ROOM_M
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return Layout(bounds, obstacles)


def _parse(file: Path) -> Xml.Element:
    """Parse an SDF file that is small and defines no entities, which could expand it."""
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}") from None
    if len(data) > _MOST_BYTES or b"<!ENTITY" in data or b"<!DOCTYPE" in data:
        raise InputError(f"{file}: too large, or defines its own entities")
    try:
        root = Xml.fromstring(data)
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{file}: not XML: {error}") from None
    if root.tag != "sdf" or (root.find("world") is None and root.find("model") is None):
        raise InputError(f"{file}: not a Gazebo world (no <sdf> with a <world> or <model>)")
    return root


def _things(file: Path, root: Xml.Element) -> Iterator[Obstacle]:
    for holder in [*root.findall("world"), root]:
        for include in holder.findall("include"):
            raise _included(f"{file}:", include)
        for model in holder.findall("model"):
            yield from _model(file, model, np.zeros(3))


def _model(file: Path, model: Xml.Element, outer: FloatArray) -> Iterator[Obstacle]:
    name = f"{file}: model {model.get('name', '?')}"
    place = compose(outer, _pose(name, model))
    for include in model.findall("include"):
        raise _included(name, include)
    for inner in model.findall("model"):
        yield from _model(file, inner, place)
    for link in model.findall("link"):
        at = compose(place, _pose(name, link))
        for collision in link.findall("collision"):
            found = _shape(name, collision, compose(at, _pose(name, collision)))
            if found is not None:
                yield found


def _included(name: str, include: Xml.Element) -> InputError:
    uri = include.findtext("uri", "?")
    return InputError(f"{name} includes {uri}: only what is in this file is supported")


def _pose(name: str, element: Xml.Element) -> FloatArray:
    """Read an element's own pose (3,) x, y, yaw. Its height is not used: all is on the floor."""
    pose = element.find("pose")
    if pose is None:
        return np.zeros(3)
    if pose.get("relative_to") or pose.get("frame"):
        raise InputError(f"{name}: a pose relative to a named frame is not supported")
    x, y, _, roll, pitch, yaw = _numbers(name, "pose", pose.text, 6)
    if abs(roll) > _TILT_RAD or abs(pitch) > _TILT_RAD:
        raise InputError(f"{name}: is tilted; only upright models are supported")
    return np.array([x, y, yaw])


def _shape(name: str, collision: Xml.Element, at: FloatArray) -> Obstacle | None:
    """Read the obstacle of a collision with the pose ``at`` (3,); None for the floor."""
    geometry = collision.find("geometry")
    kinds = [] if geometry is None else [child for child in geometry if child.tag != "empty"]
    if not kinds:
        return None
    shape, where = kinds[0], (float(at[0]), float(at[1]))
    if shape.tag in _FLAT:
        return None
    if shape.tag == "cylinder":
        (radius,), (length,) = (
            _numbers(name, key, shape.findtext(key), 1) for key in ("radius", "length")
        )
        kind: ShapeName = "cylinder"
        size: tuple[float, ...] = (2.0 * radius,)
        yaw, height = 0.0, length
    elif shape.tag == "box":
        x, y, height = _numbers(name, "size", shape.findtext("size"), 3)
        kind, size, yaw = "box", (x, y), float(at[2])
    else:
        what = f"{name}: a {shape.tag} {shape.findtext('uri', '')}".rstrip()
        raise InputError(f"{what}: only cylinders and boxes are supported")
    try:
        return Obstacle(kind, where, size, yaw, min(height, 3.0))
    except ValueError:
        raise InputError(f"{name}: a {shape.tag} of an impossible size or place") from None


def _numbers(name: str, what: str, text: str | None, count: int) -> list[float]:
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(f"{name}: {what} '{(text or '').strip()[:40]}': not {count} numbers")
    return values
