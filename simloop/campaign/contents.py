"""Hash what a campaign runs, so that results of an edited scenario never mix with old ones."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from pathlib import Path

from simloop.common.errors import InputError
from simloop.scenario.load import load, read_toml, resolve
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import ARENA_FILES, Scenario

_CHUNK = 2**20
_MOST_TEXT = 64 * 2**20  # a larger file is hashed, but not searched for names of further files
_MOST_NAMES = 10_000
_TEXTS = (*ARENA_FILES, ".yml")
_LONGEST_NAME = 4096
_BETWEEN = re.compile(rb"[\s\"'<>=,\[\]{}]+")
_SUFFIX = re.compile(rb"\.[A-Za-z0-9]{1,5}\Z")
_FOLDER = re.compile(rb"(?:mesh|texture|asset)dir\s*=\s*[\"']([^\"']*)[\"']")


def scenario_digest(name: str) -> str:
    """Hash a scenario with all its settings.

    Args:
        name: A scenario's name or file.

    Returns:
        A hash of the effective settings. If the scenario is only usable with overrides, of the
        tables in its file. Comments and the order of keys do not change it.

    Raises:
        InputError: If there is no such scenario, or it is not TOML.
    """
    try:
        text = to_toml(load(name))
    except InputError:
        text = json.dumps(read_toml(resolve(name)), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def files_of(scenario: Scenario) -> list[str]:
    """List the files that a scenario names.

    Args:
        scenario: A scenario, with full paths.

    Returns:
        The arena's file, the robot's map and the pictures of friction and heights, if any.
    """
    config, terrain = scenario.config, scenario.terrain
    field = terrain.height_field if terrain is not None else None
    friction = config.tracks.friction_image
    named = [
        scenario.arena if scenario.arena.endswith(ARENA_FILES) else None,
        config.slam.prior_map or None,
        friction.file if friction is not None else None,
        field.image if field is not None else None,
    ]
    return [str(one) for one in named if one is not None]


def digests(scenarios: Iterable[Scenario]) -> dict[str, str]:
    """Hash all files that scenarios name, with the files that these name in turn.

    Args:
        scenarios: Scenarios.

    Returns:
        File -> hash of its bytes; only files that exist.
    """
    found: dict[str, str] = {}
    todo = list(dict.fromkeys(name for one in scenarios for name in files_of(one)))
    while todo:
        name = todo.pop()
        path = Path(name)
        if name not in found and path.is_file():
            found[name] = _digest(path)
            if path.suffix in _TEXTS and len(found) < _MOST_NAMES:
                todo += _named_in(path)
    return dict(sorted(found.items()))


def _digest(path: Path) -> str:
    whole = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                whole.update(chunk)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return whole.hexdigest()[:16]


def _named_in(path: Path) -> list[str]:
    """List the existing files that a world's description names: pictures, meshes, includes."""
    with path.open("rb") as file:
        text = file.read(_MOST_TEXT)
    folders = [path.parent]
    folders += [path.parent / one.decode("utf-8", "replace") for one in _FOLDER.findall(text)]
    words = (one for one in _BETWEEN.split(text) if 2 < len(one) <= _LONGEST_NAME)
    names = list(dict.fromkeys(one for one in words if _SUFFIX.search(one[-6:])))[:_MOST_NAMES]
    found = []
    for name in names:
        for folder in folders:
            try:
                one = (folder / name.decode("utf-8", "replace")).resolve()
                if one.is_file():
                    found.append(str(one))
            except (OSError, ValueError, RuntimeError):  # no possible name of a file
                continue
    return found
