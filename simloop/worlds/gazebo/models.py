"""Find the collision shapes of a Gazebo world, each with its pose in map.

Models are first read as a tree, so that poses can be relative to frames that come later in the
file. Then they are placed, with the poses of the saved state where there are some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from simloop.common.errors import InputError, printable
from simloop.common.limits import SHAPES, check_limit
from simloop.messages import FloatArray
from simloop.worlds.gazebo.frames import MODEL, WORLD, Scope
from simloop.worlds.gazebo.model_files import ModelFiles, plain_name
from simloop.worlds.gazebo.notes import Notes
from simloop.worlds.gazebo.population import poses_of_population
from simloop.worlds.gazebo.state import WorldState, read_state
from simloop.worlds.gazebo.values import inverse, is_true, name_of, pose_of, relative_to
from simloop.worlds.gazebo.xml_tree import read_tree

_DEEPEST = 16  # models in models, and includes in includes
_GROUND_PLANE = (
    '<model name="ground_plane"><static>1</static><link name="link"><collision name="collision">'
    "<geometry><plane><normal>0 0 1</normal></plane></geometry></collision></link></model>"
)
_OF_INCLUDE = ("uri", "name", "pose", "static", "placement_frame", "merge", "plugin")
_UNIT = (1.0, 1.0, 1.0)


class Collision(NamedTuple):
    """A collision shape.

    Attributes:
        where: file and model, for texts.
        model: name of the model.
        geometry: the element of the shape.
        pose: (4, 4) its pose in map.
        scale: factors along its x, y and z axis.
        folder: folder of the file that has it.
        can_move: whether its model is not static.
    """

    where: str
    model: str
    geometry: Xml.Element
    pose: FloatArray
    scale: tuple[float, float, float]
    folder: Path
    can_move: bool


@dataclass(slots=True)
class _Model:
    """A model that is read but not placed.

    Attributes:
        name: its name, or the one that its include gives it.
        where: file and model, for error texts.
        element: the model's element.
        folder: folder of its file.
        scope: its frames, of which the links are some.
        static: whether it cannot move.
        pose: (4, 4) its pose in the frame ``parent`` of the outer scope.
        parent: name of that frame.
        inner: nested and included models.
    """

    name: str
    where: str
    element: Xml.Element
    folder: Path
    scope: Scope
    static: bool
    pose: FloatArray
    parent: str
    inner: list[_Model] = field(default_factory=list)


def root_of(file: Path) -> Xml.Element:
    """Read an SDF file.

    Args:
        file: the file.

    Returns:
        The root element, which has a world or a model.

    Raises:
        InputError: the file is not SDF. The text has one line.
    """
    # A default namespace is an attribute here, and prefixes belong to the tags, as in Gazebo.
    root = read_tree(file)
    if root.tag == "gazebo":
        raise InputError(f"{file}: SDF of version 1.2 or older; convert it with 'gz sdf --convert'")
    if root.tag != "sdf" or (root.find("world") is None and root.find("model") is None):
        raise InputError(f"{file}: not a Gazebo world (no <sdf> with a <world> or <model>)")
    return root


class WorldReader:
    """Read the models of one world file."""

    def __init__(self, file: Path, files: ModelFiles, notes: Notes) -> None:
        """Set what to read.

        Args:
            file: the SDF file.
            files: finds included models.
            notes: gets what is left out.
        """
        self._file, self._files, self._notes = file, files, notes
        self._read: dict[Path, Xml.Element] = {}
        self._count = 0

    def collisions(self) -> Iterator[Collision]:
        """Read the world.

        Yields:
            Its collision shapes.

        Raises:
            InputError: the file is not SDF or has content that is not supported.
        """
        root = root_of(self._file)
        worlds = root.findall("world")
        for other in worlds[1:]:
            self._notes.add("only the first world of the file is read, not", name_of(other))
        world = worlds[0] if worlds else root
        where = str(self._file)
        state = read_state(where, world)
        for actor in world.findall("actor"):
            self._notes.add("actors are left out", name_of(actor))
        scope = Scope(where, WORLD)
        models = self._inner(where, world, self._file.parent, scope, False, 0)
        for element in state.inserted:
            models.append(self._model(where, element, self._file.parent, False, 0))
        check_limit(len(world.findall("frame")), SHAPES, f"{where}: frames")
        _add_frames(where, world, scope)
        known = {model.name for model in models} | {"sun", "ground_plane"}
        for name in sorted(state.models - known):
            self._notes.add("the saved state has models that are not there", name)
        for model in models:
            if model.name not in state.deleted:
                place = scope.pose(model.parent) @ model.pose
                yield from self._placed(model, model.name, place, state)
        yield from self._populations(world, where)

    def _populations(self, world: Xml.Element, where: str) -> Iterator[Collision]:
        for population in world.findall("population"):
            element = population.find("model")
            if element is None:
                raise InputError(f"{where}: population {name_of(population)}: has no model")
            for number, place in enumerate(poses_of_population(where, population)):
                model = self._model(where, element, self._file.parent, False, 0)
                name = f"{model.name}_clone_{number}"
                yield from self._placed(model, name, place, WorldState())

    def _inner(
        self, where: str, holder: Xml.Element, folder: Path, scope: Scope, static: bool, depth: int
    ) -> list[_Model]:
        """Read the nested and included models of a world or model, and add their frames."""
        check_limit(depth, _DEEPEST, f"{where}: depth of models in models")
        models = [
            self._model(where, element, folder, static, depth)
            for element in holder.findall("model")
        ]
        for include in holder.findall("include"):
            model = self._included(where, include, folder, static, depth)
            if model is not None:
                models.append(model)
        for model in models:
            scope.add(model.name, model.pose, model.parent, model.scope)
            if is_true(where, "merge", model.element.get("merge"), False):
                scope.expose(model.name)
        return models

    def _model(
        self, where: str, element: Xml.Element, folder: Path, static: bool, depth: int
    ) -> _Model:
        """Read a model and all models in it."""
        self._count += 1
        name = name_of(element)
        where = f"{where}: model {name}" if depth == 0 else f"{where}::{name}"
        static = static or is_true(where, "static", element.findtext("static"), False)
        scope = Scope(where, MODEL)
        self._count += sum(len(element.findall(tag)) for tag in ("link", "frame", "joint"))
        check_limit(self._count, SHAPES, f"{self._file}: models, links, frames and joints")
        for link in element.findall("link"):
            scope.add(name_of(link), pose_of(where, link), relative_to(link))
        inner = self._inner(where, element, folder, scope, static, depth + 1)
        _add_frames(where, element, scope)
        for joint in element.findall("joint"):
            child = (joint.findtext("child") or "").strip()
            scope.add(name_of(joint), pose_of(where, joint), relative_to(joint) or child)
        pose, parent = pose_of(where, element), relative_to(element)
        model = _Model(name, where, element, folder, scope, static, pose, parent, inner)
        frame = (element.get("placement_frame") or "").strip()
        if frame:
            model.pose = pose @ inverse(scope.pose(frame))
        return model

    def _included(
        self, where: str, include: Xml.Element, folder: Path, static: bool, depth: int
    ) -> _Model | None:
        """Read an included model; None for the sun."""
        uri = (include.findtext("uri") or "").strip()
        plain = plain_name(uri)
        if plain is not None:
            self._notes.add("light and a flat floor are here anyway; left out", plain)
            if plain == "sun":
                return None
            # The plane tells the height of the floor, and so of all that stands on it.
            plane = _overridden(Xml.fromstring(_GROUND_PLANE), include)
            return self._model(where, plane, folder, static, depth)
        named = (include.findtext("name") or uri.rstrip("/").rpartition("/")[2]).strip()
        for part in include:
            if part.tag not in _OF_INCLUDE:
                self._notes.add(f"<{printable(part.tag, 40)}> of an <include> is not used", named)
        file = self._files.model(where, uri, folder)
        if file not in self._read:
            self._read[file] = root_of(file)
        element = self._read[file].find("model")
        if element is None:
            raise InputError(f"{where} includes {uri}: {file} has no <model>")
        model = self._model(where, _overridden(element, include), file.parent, static, depth)
        return model

    def _placed(
        self, model: _Model, path: str, place: FloatArray, state: WorldState
    ) -> Iterator[Collision]:
        """List the collision shapes of a model at a pose (4, 4), unless its state moves it."""
        place = state.poses.get(path, place)
        scale = state.scales.get(path, _UNIT)
        shapes = 0
        for link in model.element.findall("link"):
            at = place @ model.scope.pose(name_of(link))
            at = state.poses.get(f"{path}::{name_of(link)}", at)
            for collision in link.findall("collision"):
                shapes += 1
                frame, pose = relative_to(collision), pose_of(model.where, collision)
                pose = place @ model.scope.pose(frame) @ pose if frame else at @ pose
                found = self._shape(model, collision, pose, scale)
                if found is not None:
                    yield found
        if not shapes and any(
            link.find("visual") is not None for link in model.element.findall("link")
        ):
            self._notes.add("models without a collision shape are left out", path)
        for inner in model.inner:
            at = place @ model.scope.pose(inner.parent) @ inner.pose
            yield from self._placed(inner, f"{path}::{inner.name}", at, state)

    def _shape(
        self,
        model: _Model,
        collision: Xml.Element,
        pose: FloatArray,
        scale: tuple[float, float, float],
    ) -> Collision | None:
        """Read a collision; None if nothing can touch it."""
        self._count += 1
        check_limit(self._count, SHAPES, f"{self._file}: models, links and shapes")
        geometry = collision.find("geometry")
        shapes = [] if geometry is None else [one for one in geometry if ":" not in one.tag]
        if not shapes or shapes[0].tag == "empty":
            return None
        if _is_intangible(model.where, collision):
            self._notes.add(
                "shapes that touch nothing (by their <contact>) are left out", model.name
            )
            return None
        assert geometry is not None
        return Collision(
            model.where, model.name, geometry, pose, scale, model.folder, not model.static
        )


def _add_frames(where: str, holder: Xml.Element, scope: Scope) -> None:
    for frame in holder.findall("frame"):
        attached = (frame.get("attached_to") or "").strip()
        scope.add(name_of(frame), pose_of(where, frame), relative_to(frame) or attached)


def _overridden(model: Xml.Element, include: Xml.Element) -> Xml.Element:
    """Make a copy of a model's element with the name, pose and so on of its include."""
    own = Xml.Element(model.tag, dict(model.attrib))
    replaced = {tag for tag in ("pose", "static") if include.find(tag) is not None}
    own.extend(child for child in model if child.tag not in replaced)
    own.extend(child for child in include if child.tag in replaced)
    name = (include.findtext("name") or "").strip()
    if name:
        own.set("name", name)
    for key in ("placement_frame", "merge"):
        value = include.findtext(key) or include.get(key)
        if value:
            own.set(key, value.strip())
    return own


def _is_intangible(where: str, collision: Xml.Element) -> bool:
    """Tell whether a collision shape makes no contact with anything."""
    contact = collision.find("surface/contact")
    if contact is None:
        return False
    if is_true(where, "contact", contact.findtext("collide_without_contact"), False):
        return True
    mask = (contact.findtext("collide_bitmask") or "1").strip()
    try:
        return int(mask[:20], 0) == 0
    except ValueError:
        return False
