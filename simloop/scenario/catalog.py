"""List what can be selected by name, without slow imports such as MuJoCo."""

from __future__ import annotations

import tomllib
from pathlib import Path

from simloop.common import data_files as paths
from simloop.planners import registry


def scenario_files() -> dict[str, Path]:
    """List the scenarios of the package.

    Returns:
        Name -> file, in alphabetical order.
    """
    return {path.stem: path for path in sorted(paths.scenarios_dir().glob("*.toml"))}


def arena_files() -> dict[str, Path]:
    """List the arenas of the package.

    Returns:
        Name -> MJCF file, in alphabetical order.
    """
    return {path.stem: path for path in sorted((paths.models_dir() / "arenas").glob("*.xml"))}


def planner_names() -> tuple[str, ...]:
    """List the valid values of ``planner.name``.

    Returns:
        The names of the registered planners.
    """
    return registry.available()


def scenario_facts(path: Path) -> dict[str, str]:
    """Read the entry of one scenario for a list of scenarios.

    Args:
        path: a scenario file of the package.

    Returns:
        Its ``title``, ``description`` and ``arena``; "" for a key that it does not have.
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return {key: str(table.get(key, "")) for key in ("title", "description", "arena")}
