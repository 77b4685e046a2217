"""Define the error for wrong input, and suggest the right name in its message."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Error for wrong input. The command line prints the message and ends with exit code 2.

    The message is one line. It says where the input is wrong, what is wrong, and what is allowed.
    """

    def __init__(self, message: str) -> None:
        """Make the error.

        Args:
            message: The message. Line breaks in it become spaces.
        """
        super().__init__(" ".join(message.split()))


def did_you_mean(given: str, choices: Iterable[str]) -> str:
    """Make the end of a message about an unknown name.

    Args:
        given: The name that the user wrote.
        choices: The allowed names.

    Returns:
        `` (did you mean 'x'?); choices: a, b, x``. Without the question if no name is similar.
    """
    names = sorted(choices)
    close = difflib.get_close_matches(given, names, n=1, cutoff=0.6)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return f"{hint}; choices: {', '.join(names) or 'none'}"
