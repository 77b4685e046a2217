"""Save scenarios as TOML, with every key and its effective value."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from simloop.scenario.scenario import Scenario


def to_table(scenario: Scenario) -> dict[str, Any]:
    """Make the tables of a scenario: the inverse of ``load.from_table``.

    Args:
        scenario: any scenario.

    Returns:
        Every key with its effective value; keys with the value None are left out.
    """
    table = asdict(scenario)
    sections = table.pop("config")
    return {key: value for key, value in table.items() if value is not None} | sections


def to_toml(scenario: Scenario, versions: Mapping[str, str] | None = None) -> str:
    """Write a scenario as TOML, which ``load`` reads back to an equal scenario.

    Args:
        scenario: any scenario.
        versions: versions of the packages, saved in a table of their own.

    Returns:
        The text of the file.
    """
    table = to_table(scenario)
    if versions:
        table["versions"] = dict(versions)
    plain = {key: value for key, value in table.items() if not _is_table(value)}
    lines = [f"{key} = {_toml_value(value)}" for key, value in plain.items()]
    for key, value in table.items():
        if not _is_table(value):
            continue
        header, bodies = (
            (f"[[{key}]]", value) if isinstance(value, tuple) else (f"[{key}]", [value])
        )
        for body in bodies:
            pairs = [(name, item) for name, item in body.items() if item is not None]
            lines += ["", header, *(f"{name} = {_toml_value(item)}" for name, item in pairs)]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON escapes all characters that TOML requires to be escaped, except DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, dict):
        pairs = (f"{key} = {_toml_value(item)}" for key, item in value.items() if item is not None)
        return f"{{ {', '.join(pairs)} }}"
    return f"[{', '.join(map(_toml_value, value))}]"
