"""List the files that a scenario is read from, so that no output replaces one of them.

The list may hold too many files: each existing file that is named in a file counts as read, whether
or not its reader would open it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from simloop.common.data_files import models_dir
from simloop.common.errors import InputError
from simloop.common.input_files import read_text
from simloop.common.map_server import picture_of
from simloop.scenario.catalog import arena_files
from simloop.scenario.scenario import ARENA_FILES, Scenario
from simloop.worlds.gazebo.model_files import VARIABLES

_XML = (".xml", ".mjcf", ".sdf", ".world", ".urdf", ".config")
_MOST_FILES = 2000
_NAMED = re.compile(r"""\bfile\w*\s*=\s*["']([^"'<>]+)["']|<uri>\s*([^<>]+?)\s*</uri>""")
_FOLDER = re.compile(r"""\b(?:meshdir|texturedir|assetdir)\s*=\s*["']([^"'<>]+)["']""")
_WORD = re.compile(r"""[^\s"',\[\]{}]+""")


def input_files(scenario: Scenario, source: Path | None = None) -> dict[Path, str]:
    """List every file that is read for a run.

    Args:
        scenario: The scenario.
        source: The scenario's own file; None if it has none.

    Returns:
        What each file is, for an error message. A file that cannot be read names no others.
    """
    found = {} if source is None else {source: "the scenario itself"}
    arena = scenario.arena
    arena_file = Path(arena) if arena.endswith(ARENA_FILES) else arena_files().get(arena)
    if arena_file is not None:
        found |= files_behind(arena_file, "the arena", scenario.model_path)
    found |= files_behind(models_dir() / "tracked_ugv.xml", "the vehicle's model")
    config = scenario.config
    relief = scenario.terrain.height_field if scenario.terrain is not None else None
    if config.slam.prior_map:
        found |= files_behind(Path(config.slam.prior_map), "the prior map")
    if config.tracks.friction_image is not None:
        found[Path(config.tracks.friction_image.file)] = "the image of the friction"
    if relief is not None and relief.image is not None:
        found[Path(relief.image)] = "the image of the height field"
    return found


def files_behind(path: Path, what: str, model_path: Sequence[str] = ()) -> dict[Path, str]:
    """List a world's or a map's file and the files that it names, to any depth.

    Args:
        path: An MJCF file, a Gazebo world, or the YAML file of a map.
        what: What the file is.
        model_path: Folders in which models are looked for, besides those of the environment.

    Returns:
        The files, each with what it is. Only the first 2000 are listed.
    """
    found: dict[Path, str] = {path: what}
    todo = [path]
    while todo and len(found) < _MOST_FILES:
        for other in _named_in(todo.pop(), path.parent, model_path):
            if other not in found:
                found[other] = f"a file of {what}"
                todo.append(other)
    return found


def _named_in(path: Path, top: Path, model_path: Sequence[str]) -> Iterator[Path]:
    """Find the existing files that a file names, relative to itself or to the first file."""
    suffix = path.suffix.lower()
    if suffix not in (*_XML, ".yaml", ".yml"):
        return
    try:
        text = read_text(path)
    except InputError:
        return  # its reader reports it
    if suffix in _XML:
        names = [first or second for first, second in _NAMED.findall(text)]
        folders = ["", *_FOLDER.findall(text)]
    else:
        with suppress(InputError):  # its reader reports it
            yield from _existing(picture_of(path))
        names, folders = list(_yaml_names(text)), [""]
    for name in dict.fromkeys(names):
        for place in _places(name, (path.parent, top), folders, model_path):
            yield from _existing(place)


def _yaml_names(text: str) -> Iterator[str]:
    """List what may be a file's name in a small YAML file: each word, and each rest of a line."""
    for line in text.splitlines()[:1000]:
        yield line.partition(":")[2].partition(" #")[0].strip().strip("\"'")
        yield from (word.strip(":") for word in _WORD.findall(line))


def _places(
    name: str, bases: tuple[Path, ...], folders: list[str], model_path: Sequence[str]
) -> Iterator[Path]:
    scheme, separator, rest = name.partition("://")
    if separator and scheme in ("model", "package"):
        paths = (os.environ.get(key, "") for key in VARIABLES)
        roots = [Path(one) for path in paths for one in path.split(os.pathsep) if one]
        roots += [Path(one) for one in model_path]
        for root in (*roots, *bases, *(base.parent for base in bases)):
            yield root / rest
        return
    plain = rest if separator else name
    for base in bases:
        for folder in folders:
            yield base / folder / plain


def _existing(place: Path) -> Iterator[Path]:
    try:
        if place.is_file():
            yield place
        elif (place / "model.config").is_file():  # the folder of a Gazebo model
            yield place / "model.config"
            yield from sorted(place.glob("*.sdf"))
    except (OSError, ValueError):  # no name of a file
        return
