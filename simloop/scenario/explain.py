"""Explains errors in scenario files in one line."""

from __future__ import annotations

import json
import typing
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from simloop.common.errors import did_you_mean
from simloop.config import Config, TracksConfig
from simloop.scenario.scenario import Scenario
from simloop.worlds.terrain import Terrain


def _first_line(error: ValidationError) -> str:
    """The first of the errors as one line, with a count of the others."""
    details = error.errors(include_url=False)
    line = _describe(details[0])
    return line if len(details) == 1 else f"{line} (and {len(details) - 1} more)"


def _describe(detail: ErrorDetails) -> str:
    location = [part for part in detail["loc"] if part != "config"]
    key, kind, given = ".".join(map(str, location)), detail["type"], detail["input"]
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        choices = _keys_at(location[:-1])
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
        return f"{key}: must be a finite number, not {_short(given)}"
    text = (
        detail["msg"]
        .replace("Input should be", "must be")
        .replace("valid array", "list")
        .replace("an object", "a table")
    )
    text = text[0].lower() + text[1:]
    return f"{key}: {text}, not {_short(given)}"


def _keys_at(location: Sequence[int | str]) -> list[str]:
    """The keys that a table at this place may have."""
    holder: Any = Scenario
    for part in location:
        holders = (Scenario, Config, Terrain, TracksConfig)
        hints = {key: hint for one in holders for key, hint in typing.get_type_hints(one).items()}
        holder = _dataclass_in(hints.get(str(part))) if not isinstance(part, int) else holder
    return [field.name for field in fields(holder)] if is_dataclass(holder) else []


def _dataclass_in(hint: Any) -> Any:
    """The dataclass inside ``Optional`` or ``tuple[..., ...]``, or the hint itself."""
    if isinstance(hint, UnionType) or typing.get_origin(hint) is tuple:
        return next((arg for arg in typing.get_args(hint) if is_dataclass(arg)), None)
    return hint


def _short(value: Any) -> str:
    return _clip(str(value) if isinstance(value, float) else json.dumps(value, default=str))


def _clip(text: str, length: int = 60) -> str:
    return text if len(text) <= length else text[: length - 3] + "..."
