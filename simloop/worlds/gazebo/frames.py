"""The named frames of a world or a model, and the poses that are given relative to them.

The meaning of frames is described at http://sdformat.org/tutorials?tut=pose_frame_semantics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray

WORLD, MODEL = "world", "__model__"
_JOIN = "::"  # between the name of a model and a name inside it


class _Frame(NamedTuple):
    """A frame by its pose (4, 4) in another frame of the same scope."""

    pose: FloatArray
    parent: str


class Scope:
    """The frames that can be named at one place: in the world, or in one model."""

    def __init__(self, where: str, root: str) -> None:
        """Make a scope that has only its root.

        Args:
            where: file and model, for error texts.
            root: name of the scope's own frame: ``WORLD`` or ``MODEL``.
        """
        self._where, self._root = where, root
        self._frames: dict[str, _Frame] = {}
        self._inner: dict[str, Scope] = {}
        self._known: dict[str, FloatArray] = {root: np.eye(4), "": np.eye(4)}

    def add(self, name: str, pose: FloatArray, parent: str, inner: Scope | None = None) -> None:
        """Add a frame. The first of several with one name counts.

        Args:
            name: name of the frame.
            pose: (4, 4) its pose in the parent frame.
            parent: name of the parent frame; "": the scope's root. It may be added later.
            inner: the scope of a model, whose names follow ``name::``.
        """
        if name not in self._frames and name != self._root:
            self._frames[name] = _Frame(pose, parent)
            if inner is not None:
                self._inner[name] = inner

    def expose(self, name: str) -> None:
        """Let the names inside a model be used without the model's name: it is merged.

        Args:
            name: name of the model.
        """
        for inside in list(self._inner[name]._frames):
            self.add(inside, np.eye(4), f"{name}{_JOIN}{inside}")

    def pose(self, name: str) -> FloatArray:
        """Compute the pose of a frame.

        Args:
            name: name of the frame; ``model::frame`` for one inside a model; "": the root.

        Returns:
            (4, 4) the pose in the scope's root.

        Raises:
            InputError: there is no such frame, or frames are relative to each other in a circle.
        """
        way: list[tuple[str, FloatArray]] = []
        seen: set[str] = set()
        while name not in self._known:
            if name in seen:
                raise InputError(f"{self._where}: frame '{name}' is relative to itself")
            seen.add(name)
            frame = self._find(name)
            way.append((name, frame.pose))
            name = frame.parent
        pose = self._known[name]
        for name, step in reversed(way):
            pose = pose @ step
            self._known[name] = pose
        return pose

    def _find(self, name: str) -> _Frame:
        if name in self._frames:
            return self._frames[name]
        model, _, inside = name.partition(_JOIN)
        if inside and model in self._inner:
            return _Frame(self._inner[model].pose(inside), model)
        raise InputError(
            f"{self._where}: a pose is relative to '{name}', a frame that is not there"
        )
