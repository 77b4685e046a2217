"""Find the files that a Gazebo world names: models, and meshes.

A model is a folder with a ``model.config``, in one of the folders that the user has named. Nothing
is downloaded, and no file is read that is in none of these folders, nor in the world's own.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

from simloop.common.errors import InputError
from simloop.worlds.gazebo.xml_tree import read_tree

VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
"""The environment variables in which Gazebo looks for folders of models."""

_NAMED = ("model", "package")  # schemes of URIs that begin with the name of a model's folder
_PLAIN = {"sun": "sun", "ground_plane": "ground_plane", "ground plane": "ground_plane"}


def folders_of(environment: Mapping[str, str]) -> list[Path]:
    """List the folders of models that Gazebo's environment variables name.

    Args:
        environment: the environment, as ``os.environ``.

    Returns:
        The folders that exist, in order, each once.
    """
    names = [name for key in VARIABLES for name in environment.get(key, "").split(os.pathsep)]
    try:
        found = [Path(name).absolute() for name in names if name and Path(name).is_dir()]
    except (OSError, ValueError):
        return []
    return list(dict.fromkeys(found))


def plain_name(uri: str) -> str | None:
    """Tell whether a URI names a model that every world has here: the sun or the ground plane.

    Args:
        uri: the URI of an include.

    Returns:
        ``sun`` or ``ground_plane``; None for all other models.
    """
    return _PLAIN.get(unquote(uri).rstrip("/").rpartition("/")[2].strip().lower())


class ModelFiles:
    """Find files by the URIs of a world."""

    def __init__(self, world: Path, folders: Sequence[Path]) -> None:
        """Set where to look.

        Args:
            world: the file of the world.
            folders: folders of models, in the order in which they are searched.
        """
        self._folders = [Path(os.path.abspath(folder)) for folder in folders]
        self._allowed = [Path(os.path.abspath(world.parent)), *self._folders]

    def model(self, where: str, uri: str, folder: Path) -> Path:
        """Find the SDF file of a model.

        Args:
            where: file and model that include it, for the error text.
            uri: the URI of the include.
            folder: folder of the including file, for a relative URI.

        Returns:
            The SDF file: of several in a ``model.config``, the one with the highest version.

        Raises:
            InputError: there is no such model. The text has one line.
        """
        found = self._find(f"{where} includes {uri}", uri, folder)
        if found.is_file():
            return found
        config = found / "model.config"
        if not config.is_file():
            return found / "model.sdf"
        listed = read_tree(config).findall("sdf")
        if not listed:
            raise InputError(f"{config}: names no <sdf> file")
        name = max(listed, key=lambda one: _version(one.get("version", "0"))).text or ""
        return self._within(f"{config}: sdf {name}", found / name.strip())

    def file(self, where: str, uri: str, folder: Path) -> Path:
        """Find a file, such as a mesh.

        Args:
            where: file and model that name it, for the error text.
            uri: its URI.
            folder: folder of the naming file, for a relative URI.

        Returns:
            The file.

        Raises:
            InputError: there is no such file. The text has one line.
        """
        found = self._find(f"{where}: {uri}", uri, folder)
        if not found.is_file():
            raise InputError(f"{where}: {uri}: not a file")
        return found

    def _find(self, what: str, uri: str, folder: Path) -> Path:
        """Find the file or folder of a URI."""
        uri = uri.strip()
        try:
            parts = urlsplit(uri)
            path = unquote(f"{parts.netloc}{parts.path}")
        except ValueError:
            raise InputError(f"{what}: not a URI") from None
        if "\0" in path or not path.strip("/"):
            raise InputError(f"{what}: names no file")
        if parts.scheme in ("http", "https"):
            path, places = path.rstrip("/").rpartition("/")[2], self._folders
        elif parts.scheme in _NAMED:
            path, places = path.lstrip("/"), [*self._folders, self._allowed[0]]
            # A file in the folder of a model may name that model.
            own = [one for one in (folder, self._allowed[0]) if one.name == path.partition("/")[0]]
            places += [one.parent for one in own]
        elif parts.scheme in ("", "file"):
            places = [folder, self._allowed[0], *self._folders]
        else:
            raise InputError(f"{what}: '{parts.scheme}:' is not supported; use model:// or file://")
        for place in places:
            found = self._within(what, place / path)
            if _exists(found):
                return found
        if parts.scheme in ("http", "https"):
            raise InputError(f"{what}: not downloaded; name a folder that has it: --model-path DIR")
        raise InputError(f"{what}: not found; name the folder that has it: --model-path DIR")

    def _within(self, what: str, path: Path) -> Path:
        """Check that a file is in the world's folder or in a folder of models."""
        # Links are not resolved: folders of models are often made of links.
        path = Path(os.path.abspath(path))
        if not any(path.is_relative_to(folder) for folder in self._allowed):
            raise InputError(
                f"{what}: outside the world's folder; name its folder to read it: --model-path DIR"
            )
        return path


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name that is too long
        return False


def _version(text: str) -> tuple[int, ...]:
    """Make the parts of a version, ``1.10`` after ``1.9``."""
    return tuple(int(part) for part in re.findall(r"\d{1,9}", text))
