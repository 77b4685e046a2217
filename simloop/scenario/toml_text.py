"""Parse TOML whose keys have few parts: the parser's time and memory grow with their square."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from simloop.common.errors import InputError
from simloop.common.limits import NESTING

_MOST_PARTS = 20_000  # of all keys of three and more parts together

# Texts and comments, which may hold any number of dots, then what a dotted key consists of. A long
# key is found whatever else is wrong with the file. No part is tried twice at the same place.
_TOKEN = re.compile(
    r'''
    (?P<text> """(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5}|\Z)
        | \'\'\'(?:[^\']|\'(?!\'\'))*+(?:\'{3,5}|\Z)
        | "(?:[^"\\\n]|\\[^\n])*+"?
        | '[^'\n]*+'?
    )
    | (?P<dot> \.)
    | (?P<part> [\w-]++ | [ \t]++)
    | (?P<end> \#[^\n]*+ | [^\w\-. \t"'\#]++ )
    ''',
    re.DOTALL | re.VERBOSE,
)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Args:
        text: The text.

    Returns:
        The tables.

    Raises:
        InputError: A dotted key has more than ``limits.NESTING`` parts, or all together have too
            many. The text has one line, without the name of the file.
        ValueError: It is not TOML, as from ``tomllib``.
        RecursionError: Its values are nested too deep.
    """
    _check_keys(text)
    return tomllib.loads(text)


def _check_keys(text: str) -> None:
    dots = parts = 0
    for token in _TOKEN.finditer(text):
        if token.lastgroup == "dot":
            dots += 1
            parts += dots > 1  # a number has one dot
            if dots >= NESTING or parts > _MOST_PARTS:
                line = text.count("\n", 0, token.start()) + 1
                most = f"a key has more than {NESTING} parts"
                if dots < NESTING:
                    most = f"all keys together have more than {_MOST_PARTS:,} parts"
                raise InputError(f"line {line}: {most}")
        elif token.lastgroup == "end":
            dots = 0
