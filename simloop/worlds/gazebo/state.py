"""Read the saved state of a Gazebo world. It is where Gazebo puts its models on loading.

A world that is saved from Gazebo's window keeps the original pose in each model, and the pose at
the time of saving in ``<state>``. All poses of a state are in the world's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree import ElementTree as Xml

from simloop.common.limits import SHAPES, check_limit
from simloop.messages import FloatArray
from simloop.worlds.gazebo.values import child_numbers, name_of, pose_of

_NO_SCALE = (1.0, 1.0, 1.0)


@dataclass(slots=True)
class WorldState:
    """The poses and scales that win over those of the models.

    Names of nested models and links follow that of the outer model after ``::``.

    Attributes:
        poses: name of a model or link -> (4, 4) pose in map.
        scales: name of a model -> factors along x, y, z for the sizes of its collision shapes.
        deleted: names of models that are no longer there.
        inserted: models that are in the state only.
        models: names of the models that the state has.
    """

    poses: dict[str, FloatArray] = field(default_factory=dict)
    scales: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    deleted: set[str] = field(default_factory=set)
    inserted: list[Xml.Element] = field(default_factory=list)
    models: set[str] = field(default_factory=set)


def read_state(where: str, world: Xml.Element) -> WorldState:
    """Read the states of a world. A later state wins over an earlier one.

    Args:
        where: the file, for the error text.
        world: the element of the world.

    Returns:
        The state; empty if the world has none.

    Raises:
        InputError: a pose or scale is wrong. The text has one line.
    """
    found = WorldState()
    for state in world.findall("state"):
        for insertions in state.findall("insertions"):
            found.inserted += insertions.findall("model")
        for deletions in state.findall("deletions"):
            found.deleted |= {(name.text or "").strip() for name in deletions.findall("name")}
        for model in state.findall("model"):
            found.models.add(name_of(model))
            _read_model(f"{where}: state of model {name_of(model)}", model, name_of(model), found)
    return found


def _read_model(where: str, model: Xml.Element, path: str, found: WorldState) -> None:
    check_limit(len(found.poses), SHAPES, f"{where}: poses up to here")
    if model.find("pose") is not None:
        found.poses[path] = pose_of(where, model)
    if model.find("scale") is not None:
        x, y, z = child_numbers(where, model, "scale", 3)
        found.scales[path] = (x, y, z) if min(x, y, z) >= 0.0 else _NO_SCALE
    for link in model.findall("link"):
        if link.find("pose") is not None:
            found.poses[f"{path}::{name_of(link)}"] = pose_of(where, link)
    for inner in model.findall("model"):
        _read_model(where, inner, f"{path}::{name_of(inner)}", found)
