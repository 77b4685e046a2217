"""List the files that a scenario is read from, so that no output replaces one of them.

The list may hold too many files: each existing file that is named in a file counts as read, whether
or not its reader would open it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from html import unescape
from pathlib import Path
from urllib.parse import unquote

from simloop.common.data_files import models_dir
from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.map_server import picture_of
from simloop.scenario.catalog import arena_files
from simloop.scenario.scenario import ARENA_FILES, Scenario
from simloop.worlds.gazebo.model_files import VARIABLES

_XML = (".xml", ".mjcf", ".sdf", ".world", ".urdf", ".config")
_YAML = (".yaml", ".yml")
_MOST_FILES = 2000
_QUOTED = r"""\s*=\s*(?:"([^"<]+)"|'([^'<]+)')"""
_NAMED = re.compile(rf"""\bfile\w*{_QUOTED}|<(?:uri|file\w*)>([^<>]+)</""")
_FOLDER = re.compile(rf"""\b(?:meshdir|texturedir|assetdir){_QUOTED}""")
_CDATA = re.compile(r"<!\[CDATA\[(.*?)\]\]>", re.DOTALL)
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_ENCODING = re.compile(rb"""(?:\xef\xbb\xbf)?\s*<\?xml[^>]*\bencoding\s*=\s*["']([\w.-]+)["']""")


def input_files(scenario: Scenario, source: Path | None = None) -> dict[Path, str]:
    """List every file that is read for a run.

    Args:
        scenario: The scenario.
        source: The scenario's own file; None if it has none.

    Returns:
        What each file is, for an error message. A file that cannot be read names no others.
    """
    return all_input_files([scenario], [] if source is None else [source])


def all_input_files(scenarios: Iterable[Scenario], sources: Iterable[Path]) -> dict[Path, str]:
    """List every file that is read for runs of some scenarios.

    Args:
        scenarios: The scenarios.
        sources: The scenarios' own files.

    Returns:
        What each file is, as from `input_files`.
    """
    every = list(scenarios)
    found = dict.fromkeys(sources, "the scenario itself") | named_files(every)
    arenas = arena_files()
    for name in dict.fromkeys(one.arena for one in every if one.arena in arenas):
        found |= files_behind(arenas[name], "the arena")
    return found | files_behind(models_dir() / "tracked_ugv.xml", "the vehicle's model")


def named_files(scenarios: Iterable[Scenario]) -> dict[Path, str]:
    """List the files that scenarios name, and those that these name, without the package's own.

    Args:
        scenarios: Scenarios, with full paths.

    Returns:
        What each file is, for an error message. Whether each exists is not checked.
    """
    tops: dict[tuple[Path, str, tuple[str, ...]], None] = {}  # each is searched only once
    found: dict[Path, str] = {}
    for one in scenarios:
        config = one.config
        relief = one.terrain.height_field if one.terrain is not None else None
        if one.arena.endswith(ARENA_FILES):
            tops[Path(one.arena), "the arena", tuple(one.model_path)] = None
        if config.slam.prior_map:
            tops[Path(config.slam.prior_map), "the prior map", ()] = None
        if config.tracks.friction_image is not None:
            found[Path(config.tracks.friction_image.file)] = "the image of the friction"
        if relief is not None and relief.image is not None:
            found[Path(relief.image)] = "the image of the height field"
    for top in tops:
        found |= files_behind(*top)
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
    folders = [""]  # of meshes and textures: one that a file names holds for all of them
    named: list[tuple[Path, list[str]]] = []
    while todo and len(found) < _MOST_FILES:
        one = todo.pop()
        names, more = _named_in(one)
        new = [folder for folder in more if folder not in folders]
        folders += new
        named.append((one.parent, names))
        # A folder that is named only now may hold what earlier files name.
        places = (
            place
            for folder, inside in (named if new else named[-1:])
            for name in inside
            for place in _places(name, (folder, path.parent), folders, model_path)
        )
        for other in (one for place in places for one in _existing(place)):
            if other not in found:
                found[other] = f"a file of {what}"
                todo.append(other)
    return found


def _named_in(path: Path) -> tuple[list[str], list[str]]:
    """Find the names of files in a file, and the folders in which meshes and textures are."""
    suffix = path.suffix.lower()
    try:
        if suffix in _YAML:
            return [str(picture_of(path).absolute())], []
        if suffix not in _XML:
            return [], []
        text = _CDATA.sub(r"\1", _decoded(read_bytes(path)))
    except InputError:
        return [], []  # its reader reports it
    return list(_texts(_NAMED, text)), list(_texts(_FOLDER, text))


def _decoded(data: bytes) -> str:
    """Decode an XML file in the encoding that it declares."""
    declared = _ENCODING.match(data)
    name = "utf-16" if data[:2] in _UTF_16 else declared[1].decode() if declared else "utf-8"
    try:
        return data.decode(name, "replace")
    except LookupError:
        return data.decode("utf-8", "replace")


def _texts(pattern: re.Pattern[str], text: str) -> Iterator[str]:
    """List the different texts that a pattern's groups find, as XML means them."""
    found = (next(filter(None, groups), "") for groups in pattern.findall(text))
    return iter(dict.fromkeys(unescape(one).strip() for one in found))


def _places(
    name: str, bases: tuple[Path, ...], folders: list[str], model_path: Sequence[str]
) -> Iterator[Path]:
    """List where a file may be, for each reader: relative, in a folder of models, or a URI."""
    scheme, separator, rest = name.partition("://")
    plain = unquote(rest) if separator else name
    if scheme in ("http", "https"):  # read from a folder of models, and not downloaded
        plain = plain.rstrip("/").rpartition("/")[2]
    paths = (os.environ.get(key, "") for key in VARIABLES)
    roots = [Path(one) for path in paths for one in path.split(os.pathsep) if one]
    roots += [Path(one) for one in model_path]
    for root in (*roots, *bases, *(base.parent for base in bases)):
        yield root / plain.lstrip("/")
    for base in bases:
        for folder in folders:
            yield base / folder / plain
            yield base / folder / Path(plain).name  # MuJoCo's strippath


def _existing(place: Path) -> Iterator[Path]:
    try:
        if place.is_file():
            yield place
        elif (place / "model.config").is_file():  # the folder of a Gazebo model
            yield place / "model.config"
            yield from sorted(place.glob("*.sdf"))
    except (OSError, ValueError):  # no name of a file
        return
