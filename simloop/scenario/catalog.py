"""What can be chosen by name, listed without slow imports such as MuJoCo."""

from __future__ import annotations

import tomllib
from pathlib import Path

from simloop.common import data_files as paths
from simloop.planners import registry


def scenario_files() -> dict[str, Path]:
    """The scenarios that come with the package.

    Returns:
        Name -> file, in alphabetical order.
    """
    return {path.stem: path for path in sorted(paths.scenarios_dir().glob("*.toml"))}


def arena_files() -> dict[str, Path]:
    """The arenas that come with the package.

    Returns:
        Name -> MJCF file, in alphabetical order.
    """
    return {path.stem: path for path in sorted((paths.models_dir() / "arenas").glob("*.xml"))}


def planner_names() -> tuple[str, ...]:
    """The names that ``planner.name`` may have.

    Returns:
        The names of the registered planners.
    """
    return registry.available()


def scenario_facts(path: Path) -> dict[str, str]:
    """What a list of scenarios shows of one.

    Args:
        path: a scenario file that comes with the package.

    Returns:
        Its ``title``, ``description`` and ``arena``; "" for what it does not say.
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return {key: str(table.get(key, "")) for key in ("title", "description", "arena")}
