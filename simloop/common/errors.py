"""Define the error for wrong input, and suggest the right name in its message."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_MESSAGE = 1000
"""Characters of a message, at most."""


class InputError(ValueError):
    """Error for wrong input. The command line prints the message and ends with exit code 2.

    The message is one line. It says where the input is wrong, what is wrong, and what is allowed.
    """

    def __init__(self, message: str) -> None:
        """Make the error.

        Args:
            message: The message. It may quote the input: line breaks become spaces, control
                characters are shown as escapes, and a long message is cut in its middle.
        """
        super().__init__(printable(message))


def printable(text: str, most: int = LONGEST_MESSAGE) -> str:
    """Make one line of a text that is safe to show in a terminal.

    Args:
        text: Any text, e.g. with parts of a file.
        most: Largest number of characters.

    Returns:
        The text in one line. What cannot be printed, e.g. the escapes that move a terminal's
        cursor, is written as in Python; the middle of a long text is left out.
    """
    half = most // 2
    if len(text) > 4 * most:  # splitting a huge text would take its memory again
        text = f"{text[: 2 * most]}{text[-2 * most :]}"
    line = " ".join(text.split())
    line = "".join(one if one.isprintable() else ascii(one)[1:-1] for one in line)
    return line if len(line) <= most else f"{line[: half - 3]} ... {line[-half + 2 :]}"


def did_you_mean(given: str, choices: Iterable[str]) -> str:
    """Make the end of a message about an unknown name.

    Args:
        given: The name that the user wrote.
        choices: The allowed names.

    Returns:
        `` (did you mean 'x'?); choices: a, b, x``. Without the question if no name is similar.
    """
    names = sorted(choices)
    # Comparing is quadratic in the length, and no name is this long.
    close = difflib.get_close_matches(given[:200], names, n=1, cutoff=0.6)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return f"{hint}; choices: {', '.join(names) or 'none'}"
