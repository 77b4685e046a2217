"""The one error that means: the user's input is wrong, and here is what to write instead."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Wrong input, in one line that names where, what and the choices. Exit code 2."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


def did_you_mean(given: str, choices: Iterable[str]) -> str:
    """`` (did you mean 'x'?); choices: a, b, c``: the end of an unknown name's message."""
    names = sorted(choices)
    close = difflib.get_close_matches(given, names, n=1, cutoff=0.6)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return f"{hint}; choices: {', '.join(names) or 'none'}"
