"""Largest sizes that simloop reads or makes.

Every reader and every generator checks them before it takes memory, so that a wrong or hostile
file ends in one line instead of a full memory.
"""

from __future__ import annotations

from simloop.common.errors import InputError

TEXT_BYTES = 64 * 2**20
"""Size of a text file that is read as a whole: worlds, scenarios, map descriptions."""

PICTURE_BYTES = 256 * 2**20
"""Size of a picture or of an array file."""

LOG_BYTES = 2**30
"""Size of a recorded log, after unpacking."""

PIXELS = 100_000_000
"""Pixels of a picture: 10 km x 10 km at 1 m, 500 m x 500 m at 5 cm."""

CELLS = 50_000_000
"""Cells of a grid: 350 m x 350 m at 5 cm."""

SHAPES = 20_000
"""Solids of a world."""

ARENA_SIDE_M = 500.0
"""Length of a side of an arena, m."""

NESTING = 64
"""Depth of nested tables, lists or elements of a file."""

NAME_CHARACTERS = 200
"""Length of a name that a file or an option gives."""


MOVERS = 4_000
"""Things that move by themselves: their collisions with each other are checked pair by pair."""

LOOSE = 200
"""Movable bodies: physics solves their contacts in one dense system."""


def check_limit(value: float, most: float, what: str, unit: str = "") -> None:
    """Check a size before memory is taken for it.

    Args:
        value: The size that is asked for.
        most: The largest size allowed.
        what: Where and what it is, e.g. ``room.pgm: pixels``, for the error message.
        unit: Unit of both, for the message.

    Raises:
        InputError: If the size is larger than allowed, or not a number.
    """
    if not value <= most:
        unit = f" {unit}" if unit else ""
        raise InputError(f"{what}: {value:,.15g}{unit}; at most {most:,.15g}{unit} are allowed")
