"""Explain errors in scenario files in one line: the key, what is wrong, and the choices."""

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
    """Describe the first of a validation's errors in one line, with the number of the others.

    Args:
        error: pydantic's error for a scenario.

    Returns:
        Key, what is wrong, and the choices, if there are some.
    """
    details = error.errors(include_url=False)
    line = _describe(details[0])
    return line if len(details) == 1 else f"{line} (and {len(details) - 1} more)"


def _describe(detail: ErrorDetails) -> str:
    """Describe one error in a line, with its key as in a file, that is without ``config``."""
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
    if kind == "too_small":
        return f"{key}: {detail['msg']}, not {short_value(given)}"
    if kind == "too_long":
        limits = detail.get("ctx", {})
        given, most = limits.get("actual_length"), limits.get("max_length")
        return f"{key}: {given} entries are given; at most {most} are allowed"
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
    """List the valid keys of a table in a scenario file.

    Args:
        location: keys and list indices that lead to the table; empty for the top of the file.

    Returns:
        The names of the keys; none if the location is not a table.
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
    """Find the dataclass in each field of a dataclass; Config's sections count as a scenario's."""
    hints = typing.get_type_hints(holder)
    if holder is Scenario:
        hints |= typing.get_type_hints(hints["config"])
    return {key: _dataclass_in(hint) for key, hint in hints.items()}


def _dataclass_in(hint: Any) -> Any:
    """Find the dataclass that a type is or contains, for example ``tuple[Ramp, ...] | None``."""
    if is_dataclass(hint):
        return hint
    return next(filter(None, map(_dataclass_in, typing.get_args(hint))), None)


def short_value(value: Any) -> str:
    """Format a value as in a file, and shorten it.

    Args:
        value: a value of any type.

    Returns:
        Its text, at most 60 characters.
    """
    return shorten(str(value) if isinstance(value, float) else json.dumps(value, default=str))


def shorten(text: str, length: int = 60) -> str:
    """Cut off a text that is too long.

    Args:
        text: the text.
        length: the largest number of characters.

    Returns:
        The text, with "..." at its end if it was cut.
    """
    return text if len(text) <= length else text[: length - 3] + "..."
