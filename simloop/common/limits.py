"""Largest sizes that simloop reads or makes.

Every reader and every generator checks them before it takes memory, so that a wrong or hostile
file ends in one line instead of a full memory.
"""

from __future__ import annotations

from simloop.common.errors import InputError

TEXT_BYTES = 64 * 2**20
"""Size of a text file that is read as a whole: worlds, scenarios, map descriptions."""

MAP_YAML_BYTES = 2**20
"""Size of a map's YAML file, which is a few lines."""

PICTURE_BYTES = 256 * 2**20
"""Size of a picture or of an array file."""

LOG_BYTES = 2**30
"""Size of a recorded log, after unpacking."""

LOG_SCANS = 500_000
"""Scans of a recorded log: more than three hours at 40 Hz."""

LOG_ODOMETRY = 2_000_000
"""Odometry lines of a recorded log: more than five hours at 100 Hz."""

LOG_READINGS = 80_000_000
"""Ranges of a recorded log, all scans together; each takes four bytes."""

LOG_LINES = 10_000_000
"""Lines of a recorded log."""

LOG_LINE_BYTES = 4 * 2**20
"""Length of a line of a recorded log."""

LOG_UNPACKED_TIMES = 100
"""How many times larger than its file a packed log may be: texts of numbers reach about 10."""

RELATIONS = 1_000_000
"""Relations between poses in a file."""

PIXELS = 100_000_000
"""Pixels of a picture: 10 km x 10 km at 1 m, 500 m x 500 m at 5 cm."""

CELLS = 50_000_000
"""Cells of a grid: 350 m x 350 m at 5 cm."""

SHAPES = 20_000
"""Solids of a world."""

ARENA_SIDE_M = 500.0
"""Length of a side of an arena, m."""

ELEMENTS = 1_000_000
"""Elements of an XML file, without those that a reader leaves out."""

NESTING = 64
"""Depth of nested tables, lists or elements of a file."""

NAME_CHARACTERS = 200
"""Length of a name that a file or an option gives."""

JOURNAL_BYTES = 4 * 2**30
"""Size of a campaign's journal: a million runs without driven paths have some 2 GiB."""

MJCF_ELEMENTS = 100_000
"""Elements of an MJCF arena, with all copies that ``<replicate>`` makes."""

MJCF_GEOMS = 10_000
"""Geoms of an MJCF arena. MuJoCo's time to read them grows with the square of their number."""

MJCF_BODIES = 4_000
"""Bodies of an MJCF arena, and copies that a ``<replicate>`` makes."""

MJCF_OTHERS = 10_000
"""Elements of any other kind in an MJCF arena, e.g. sites, joints, materials."""

MJCF_CLASSES = 1_000
"""Default classes of an MJCF arena. Each takes 36 kB."""

MJCF_NUMERIC = 10_000
"""Numbers in all ``<numeric>`` of an MJCF arena."""

MJCF_REACH_M = 100_000.0
"""Largest coordinate or size in an MJCF arena, m. In single precision it is exact to 8 mm."""

LOOSE_BODIES = 100
"""Bodies of a world that can be pushed. MuJoCo's matrices have the square of their number."""

TEXTURE_PIXELS = 2**25
"""Pixels of all textures of an MJCF arena together."""

ATTRIBUTE_CHARACTERS = 2**22
"""Length of an attribute of an MJCF arena, e.g. of a mesh's vertices."""

HEIGHT_POINTS = 2**21
"""Points of the height fields of an MJCF arena."""

MESH_BYTES = 32 * 2**20
"""Size of a mesh, texture or height field of an MJCF arena, as a file."""

SCENARIO_BYTES = 2**20
"""Size of a scenario file: the largest shipped one has 8 kB."""

INTEGER_BITS = 14_000
"""Bits of an integer in a file: Python does not print longer ones. No setting takes one near it."""

TEXT_CHARACTERS = 10_000
"""Length of a text in a scenario, e.g. of its description."""

MOVERS = 4_000
"""Things that move by themselves: their collisions with each other are checked pair by pair."""


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
