"""Explains errors in scenario files in one line: the key, what is wrong, and the choices."""

from __future__ import annotations

import json
import typing
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from simloop.common.errors import did_you_mean
from simloop.config import Config
from simloop.scenario.scenario import Scenario


def one_line(error: ValidationError) -> str:
    """The first of a validation's errors in one line, with the number of the others.

    Args:
        error: what pydantic raised for a scenario.

    Returns:
        Key, what is wrong, and the choices where there are some.
    """
    details = error.errors(include_url=False)
    line = _describe(details[0])
    return line if len(details) == 1 else f"{line} (and {len(details) - 1} more)"


def _describe(detail: ErrorDetails) -> str:
    """One error in a line, with its key as it stands in a file, where no ``config`` is written."""
    location = [part for part in detail["loc"] if part != "config"]
    key, kind, given = ".".join(map(str, location)), detail["type"], detail["input"]
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        choices = keys_at(location[:-1])
        return f"{key}: unknown key{did_you_mean(str(location[-1]), choices)}"
    if kind in ("missing", "missing_argument"):
        if isinstance(location[-1], int):
            return f"{key.rpartition('.')[0]}: too few values, {location[-1]} given"
        return f"{key}: this key is required"
    if kind == "keys_clash":
        return detail["msg"]
    if kind == "value_error":
        return f"{key}: {detail['msg'].removeprefix('Value error, ')}"
    if kind == "finite_number":
        return f"{key}: must be a finite number, not {short_value(given)}"
    text = (
        detail["msg"]
        .replace("Input should be", "must be")
        .replace("valid array", "list")
        .replace("an object", "a table")
    )
    text = text[0].lower() + text[1:]
    return f"{key}: {text}, not {short_value(given)}"


def keys_at(location: Sequence[int | str]) -> list[str]:
    """The keys that a table in a scenario file may have.

    Args:
        location: keys and list indices that lead to the table; empty for the top of the file.

    Returns:
        The names of the keys; none where the location is no table.
    """
    holder: Any = Scenario
    for part in location:
        if not isinstance(part, int):
            holder = _tables_of(holder).get(part) if is_dataclass(holder) else None
    if not is_dataclass(holder):
        return []
    names = [field.name for field in fields(holder)]
    if holder is not Scenario:
        return names
    return [name for name in names if name != "config"] + [field.name for field in fields(Config)]


def _tables_of(holder: Any) -> dict[str, Any]:
    """The dataclass in each field of a dataclass; the sections of Config count as a scenario's."""
    hints = typing.get_type_hints(holder)
    if holder is Scenario:
        hints |= typing.get_type_hints(hints["config"])
    return {key: _dataclass_in(hint) for key, hint in hints.items()}


def _dataclass_in(hint: Any) -> Any:
    """The dataclass that a type is, or that it holds, as ``tuple[Ramp, ...] | None`` does."""
    if is_dataclass(hint):
        return hint
    return next(filter(None, map(_dataclass_in, typing.get_args(hint))), None)


def short_value(value: Any) -> str:
    """A value as it is written in a file, shortened.

    Args:
        value: of any type.

    Returns:
        Its text, at most 60 characters.
    """
    return shorten(str(value) if isinstance(value, float) else json.dumps(value, default=str))


def shorten(text: str, length: int = 60) -> str:
    """A text that is cut off if it is too long.

    Args:
        text: to be shortened.
        length: the most characters that are kept.

    Returns:
        The text, with "..." at its end if it was cut.
    """
    return text if len(text) <= length else text[: length - 3] + "..."
