"""Hash what a campaign runs, so that results of an edited scenario never mix with old ones."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from simloop.common.data_files import models_dir, scenarios_dir
from simloop.common.errors import InputError
from simloop.scenario.inputs import named_files
from simloop.scenario.load import load, read_toml, resolve
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import Scenario

_CHUNK = 2**20


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


def digests(scenarios: Iterable[Scenario]) -> dict[str, str]:
    """Hash all files that scenarios are read from.

    Args:
        scenarios: Scenarios.

    Returns:
        File -> hash of its bytes; only files that exist. The name of one of simloop's own files
        begins with its folder there, so that it is the same for every installation.
    """
    files = [path for path in named_files(scenarios) if path.is_file()]
    return dict(sorted((_name_of(path), _digest(path)) for path in files))


def _name_of(path: Path) -> str:
    """Name a file by its full path, or by its place among simloop's own files."""
    real = path.resolve()
    for folder in (models_dir(), scenarios_dir()):
        if real.is_relative_to(folder.resolve()):
            return f"{folder.name}/{real.relative_to(folder.resolve())}"
    return str(real)


def _digest(path: Path) -> str:
    whole = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                whole.update(chunk)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return whole.hexdigest()[:16]
