"""Load scenarios from TOML files and from overrides on the command line."""

from __future__ import annotations

import json
import os
import re
import stat
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from simloop.common.errors import InputError, did_you_mean
from simloop.common.input_files import read_bytes
from simloop.common.limits import (
    INTEGER_BITS,
    NAME_CHARACTERS,
    NESTING,
    SCENARIO_BYTES,
    TEXT_CHARACTERS,
    check_limit,
)
from simloop.common.map_server import known_cells
from simloop.config import MOVED_KEYS, REMOVED_KEYS, Config
from simloop.planners import registry
from simloop.scenario.catalog import arena_files, planner_names, scenario_files
from simloop.scenario.explain import one_line, short_value, shorten
from simloop.scenario.scenario import ARENA_FILES, GAZEBO_FILES, Scenario
from simloop.scenario.toml_text import parse_toml
from simloop.worlds.gazebo.model_files import folders_of

_BARE_WORD = re.compile(r"[A-Za-z_./][A-Za-z0-9_\-./]*\Z")
_FILE_KEYS = (("tracks", "friction_image", "file"), ("terrain", "height_field", "image"))


def load(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    *,
    seed: int | None = None,
    planner: str | None = None,
    model_path: Sequence[str | Path] = (),
) -> Scenario:
    """Read a scenario, apply overrides and validate the result.

    Args:
        name_or_path: name of a scenario of the package, or a file.
        overrides: ``key=value`` texts with dotted keys; values as in TOML, or a bare word.
        seed: replaces the scenario's seed.
        planner: replaces the name of the planner.
        model_path: folders of models that a Gazebo world includes; they are searched first.

    Returns:
        The scenario, with full paths of all its files.

    Raises:
        InputError: the file, an override or the result is wrong. The text has one line.
    """
    file = resolve(name_or_path)
    table = read_toml(file)
    # A file's name may have bytes that are no characters.
    stem = file.stem.encode("utf-8", "replace").decode("utf-8")
    table.setdefault("name", stem[:NAME_CHARACTERS])
    _move_old_keys(table, str(name_or_path))
    _make_paths_full(table, file.parent)
    for text in overrides:
        apply_override(table, text)
    _make_paths_full(table, Path.cwd())  # files in overrides are relative to the current directory
    if seed is not None:
        table["seed"] = seed
    if planner is not None:
        apply_override(table, f"planner.name={json.dumps(planner)}")
    _add_model_folders(table, model_path)
    scenario = from_table(table, source=str(name_or_path))
    _check_names(scenario, source=str(name_or_path))
    return scenario


def _move_old_keys(table: dict[str, Any], source: str) -> None:
    """Move the values of old keys to the present keys and drop keys without effect, in place."""
    for old, new in MOVED_KEYS.items():
        section, _, key = old.partition(".")
        holder = table.get(section)
        if not isinstance(holder, dict) or key not in holder:
            continue
        new_section, _, new_key = new.partition(".")
        target = table.setdefault(new_section, {})
        if not isinstance(target, dict) or new_key in target:
            raise InputError(f"{source}: {old} is now {new}: give only one of them")
        target[new_key] = holder.pop(key)
    for old in REMOVED_KEYS:
        section, _, key = old.partition(".")
        holder = table.get(section)
        if isinstance(holder, dict):
            holder.pop(key, None)


def _make_paths_full(table: dict[str, Any], folder: Path) -> None:
    """Turn the file names in the tables into full paths, in place. Full paths are kept."""
    arena = table.get("arena")
    if isinstance(arena, str) and arena.endswith(ARENA_FILES):
        table["arena"] = _full_path(folder, arena)
    folders = table.get("model_path")
    if isinstance(folders, list) and all(isinstance(one, str) for one in folders):
        table["model_path"] = [_full_path(folder, one) for one in folders]
    slam = table.get("slam")
    if isinstance(slam, dict) and slam.get("prior_map") and isinstance(slam["prior_map"], str):
        slam["prior_map"] = _full_path(folder, slam["prior_map"])
    for section, part, key in _FILE_KEYS:
        holder = table.get(section)
        holder = holder.get(part) if isinstance(holder, dict) else None
        if isinstance(holder, dict) and isinstance(holder.get(key), str):
            holder[key] = _full_path(folder, holder[key])


def _add_model_folders(table: dict[str, Any], first: Sequence[str | Path]) -> None:
    """Add folders of models, and those of Gazebo's environment variables, in place.

    So a saved scenario finds the same models wherever it is run.
    """
    for name in first:
        if not Path(name).is_dir():
            raise InputError(f"--model-path {name}: no such folder")
    given, arena = table.get("model_path", []), table.get("arena")
    is_gazebo = isinstance(arena, str) and arena.endswith(GAZEBO_FILES)
    if first and not is_gazebo:
        raise InputError("--model-path: only for a Gazebo world as the arena (.world, .sdf)")
    if is_gazebo and isinstance(given, list) and all(isinstance(one, str) for one in given):
        named = [str(Path(name).absolute()) for name in first]
        around = [str(folder) for folder in folders_of(os.environ)]
        table["model_path"] = list(dict.fromkeys((*named, *given, *around)))


def _full_path(folder: Path, name: str) -> str:
    """Compute the full path of a file that is named relative to a folder."""
    try:
        return str((folder / name).resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a null byte, a loop of links
        raise InputError(f"{short_value(name)}: cannot be the name of a file: {error}") from None


def resolve(name_or_path: str | Path) -> Path:
    """Find the file of a scenario.

    Args:
        name_or_path: name of a scenario of the package, or a file.

    Returns:
        The file.

    Raises:
        InputError: there is no such scenario; the error lists the names.
    """
    text, known = str(name_or_path), scenario_files()
    if text in known:
        return known[text]
    path = Path(text)
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        missing = isinstance(error, FileNotFoundError | NotADirectoryError)
        what = "no such file" if missing else getattr(error, "strerror", None) or str(error)
    else:
        if stat.S_ISREG(mode):
            return path
        directory = stat.S_ISDIR(mode)
        what = "is a directory, not a scenario file" if directory else "not a regular file"
        if not directory:
            raise InputError(f"{text}: {what}")
    if path.suffix or len(path.parts) > 1:
        raise InputError(f"{text}: {what}; the scenarios of the package: {', '.join(known)}")
    raise InputError(f"unknown scenario '{text}'{did_you_mean(text, known)}")


def read_toml(path: Path) -> dict[str, Any]:
    """Read the tables of a scenario file.

    Args:
        path: a TOML file; the table ``versions`` of a saved run is left out.

    Returns:
        The tables as they are in the file, not validated.

    Raises:
        InputError: the file cannot be read or is not TOML.
    """
    try:
        text = read_bytes(path, SCENARIO_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (byte {error.start} is not UTF-8)") from None
    try:
        table = parse_toml(text)
    except InputError as error:
        raise InputError(f"{path}, {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: nested more than {NESTING} deep") from None
    except (ValueError, MemoryError) as error:
        raise InputError(f"{path}: not usable TOML: {error}") from None
    check_values(table, str(path))
    table.pop("versions", None)
    return table


def apply_override(table: dict[str, Any], text: str) -> None:
    """Set one key of the tables, in place.

    Args:
        table: the tables of a scenario file.
        text: ``a.b=value``; an index selects an element of a list, as in ``goal.0=3``.

    Raises:
        InputError: the text does not have this form, or a part of the key is not a table.
    """
    key, equals, value = text.partition("=")
    text = shorten(text)
    key = MOVED_KEYS.get(".".join(part.strip() for part in key.split(".")), key)
    parts = [part.strip() for part in key.split(".")]
    if len(parts) > NESTING:
        raise InputError(f"--set {text}: the key has more than {NESTING} parts")
    check_values(dict.fromkeys(parts), f"--set {text}")
    if not equals or not all(parts):
        raise InputError(f"--set {text}: write it as key=value, e.g. --set 'goal=[3.0,2.5]'")
    node: Any = table
    for depth, part in enumerate(parts[:-1]):
        node = _descend(node, part, f"--set {text}: {'.'.join(parts[: depth + 1])}")
    _assign(node, parts[-1], parse_value(value, text), f"--set {text}: {key.strip()}")


def parse_value(value: str, text: str) -> Any:
    """Read a value from the command line.

    Args:
        value: a value as in TOML, or a bare word, which becomes a string.
        text: the whole override, for the error.

    Returns:
        The value.

    Raises:
        InputError: the value is neither.
    """
    try:
        parsed = parse_toml(f"value = {value}")
    except InputError as error:
        raise InputError(f"--set {shorten(text)}: {error}") from None
    except RecursionError:
        deep = f"nested more than {NESTING} deep"
        raise InputError(f"--set {text}: not a TOML value on the right: {deep}") from None
    except ValueError:
        if _BARE_WORD.match(value.strip()):
            return value.strip()
        raise InputError(
            f'--set {text}: not a TOML value on the right (number, [list], "text", true)'
        ) from None
    if set(parsed) != {"value"}:
        raise InputError(f"--set {text}: one value at a time")
    check_values(parsed["value"], f"--set {text}")
    return parsed["value"]


def check_values(value: Any, where: str) -> None:
    """Check that values are small enough to be validated and quoted.

    Args:
        value: a value as TOML has it, with all values in it.
        where: where it comes from, for the error.

    Raises:
        InputError: it is nested too deep, or it has a name, text or integer that is too long.
    """
    level = [value]
    for _ in range(NESTING):
        inner: list[Any] = []
        for one in level:
            if isinstance(one, dict):
                for key in one:
                    check_limit(len(key), NAME_CHARACTERS, f"{where}: length of the key '{key}'")
                inner += one.values()
            elif isinstance(one, list):
                inner += one
            elif isinstance(one, str):
                check_limit(len(one), TEXT_CHARACTERS, f"{where}: length of a text")
            elif isinstance(one, int):
                check_limit(one.bit_length(), INTEGER_BITS, f"{where}: bits of an integer")
        level = inner
        if not level:
            return
    raise InputError(f"{where}: nested more than {NESTING} deep")


def from_table(table: Mapping[str, Any], *, source: str) -> Scenario:
    """Validate the tables of a scenario file.

    Args:
        table: the scenario's own keys and the sections of ``Config``.
        source: name of the tables in an error text, such as the file's name.

    Returns:
        The scenario. The names of arena and planner are not checked yet.

    Raises:
        InputError: a table is not valid. The text has one line, with the key and the choices.
    """
    sections = {field.name for field in fields(Config)}
    own = {field.name for field in fields(Scenario)} - {"config"}
    for key in table:
        if key not in sections | own:
            hint = did_you_mean(key, sections | own)
            raise InputError(f"{source}: unknown key '{key}'{hint}")
    data = {key: value for key, value in table.items() if key in own}
    data["config"] = {key: value for key, value in table.items() if key in sections}
    try:
        # In JSON, strict validation accepts a list where a tuple is expected.
        return _adapter().validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error)}") from None


@cache
def _adapter() -> TypeAdapter[Scenario]:
    return TypeAdapter(Scenario)


def _check_names(scenario: Scenario, *, source: str) -> None:
    """Raise InputError for an arena, planner or prior map that cannot be used."""
    name, arena = scenario.config.planner.name, scenario.arena
    if name not in planner_names():
        hint = did_you_mean(name, planner_names())
        raise InputError(f"{source}: planner.name: unknown planner '{name}'{hint}")
    if scenario.config.planner.options:
        try:
            registry.check_options(name, dict(scenario.config.planner.options))
        except ValueError as error:
            raise InputError(f"{source}: planner.options: {error}") from None
    if scenario.config.slam.prior_map:
        # The map is read only for its errors, which are then reported before anything runs. The
        # robot itself builds the grid with its search fields.
        known_cells(Path(scenario.config.slam.prior_map), scenario.config.slam.max_cells)
    elif not scenario.config.slam.extend_map:
        raise InputError(f"{source}: slam.extend_map: false needs a slam.prior_map")
    if arena.endswith(ARENA_FILES):
        if not Path(arena).is_file():
            raise InputError(f"{source}: arena: no such file: {arena}")
    elif arena not in arena_files():
        hint = did_you_mean(arena, arena_files())
        raise InputError(f"{source}: arena: unknown arena '{arena}'{hint}")


def _descend(node: Any, part: str, where: str) -> Any:
    """Find the table or value under a key or index. A missing table is created."""
    if isinstance(node, dict):
        return node.setdefault(part, {})
    if isinstance(node, list):
        return node[_index(node, part, where)]
    raise InputError(f"{where} is a value, not a table")


def _assign(node: Any, part: str, value: Any, where: str) -> None:
    if isinstance(node, dict):
        node[part] = value
    elif isinstance(node, list):
        node[_index(node, part, where)] = value
    else:
        raise InputError(f"{where.rpartition('.')[0]} is a value, not a table")


def _index(node: list[Any], part: str, where: str) -> int:
    if not part.isdecimal() or len(part) > 9 or int(part) >= len(node):
        raise InputError(f"{where}: index must be 0 to {len(node) - 1}")
    return int(part)
