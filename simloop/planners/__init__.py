"""The planners: one protocol, many methods, each chosen by name."""

from __future__ import annotations

import importlib
from typing import Any

_CLASSES = {"tlbo": "simloop.tlbo_planner:TlboPlanner"}


def available() -> tuple[str, ...]:
    """The names that ``planner.name`` may have."""
    return tuple(_CLASSES)


def planner_class(name: str) -> Any:
    """The planner's class, imported only now. Raises KeyError for an unknown name."""
    module, _, attribute = _CLASSES[name].partition(":")
    return getattr(importlib.import_module(module), attribute)
