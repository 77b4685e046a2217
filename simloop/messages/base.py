"""The base of all messages. The arrays of a message are read-only."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_ARRAYS = ("FloatArray", "NDArray[")


class BaseMessage:
    """Base of the messages. It makes every array of a message read-only."""

    __slots__ = ()

    def __post_init__(self) -> None:
        kind: Any = self.__class__
        for get in _array_getters(kind):
            get(self).setflags(False)  # argument write; as a keyword it costs twice as much
        for get in _tuple_getters(kind):
            for array in get(self):
                array.setflags(False)


@cache
def _array_getters(kind: Any) -> tuple[Any, ...]:
    """List the getters of the fields that hold an array, by their annotations.

    The getters are the slots' own descriptors, because they run for every message, ten thousand
    times in a run.
    """
    return tuple(getattr(kind, name).__get__ for name in _fields_of(kind, _ARRAYS))


@cache
def _tuple_getters(kind: Any) -> tuple[Any, ...]:
    """List the getters of the fields that hold a tuple of arrays."""
    kinds = tuple(f"tuple[{array}" for array in _ARRAYS)
    return tuple(getattr(kind, name).__get__ for name in _fields_of(kind, kinds))


def _fields_of(kind: Any, annotations: tuple[str, ...]) -> list[str]:
    return [field.name for field in fields(kind) if str(field.type).startswith(annotations)]
