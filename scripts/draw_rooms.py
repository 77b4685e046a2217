"""Draw the structure of the code: packages in the layers of the import rules, and their imports.

    python scripts/draw_rooms.py            # writes docs/images/rooms.png

The layers are read from ``pyproject.toml``, the imports from the code itself.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import grimp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "images" / "rooms.png"
ROBOT = {
    "robot", "localiser", "navigation", "control", "graph_slam", "tracker", "tlbo_planner", "ekf",
    "slam_grid", "planners", "perception", "estimation", "mapping",
}  # fmt: skip
DOORS = {
    "loop",
    "robot",
    "localiser",
    "sensors",
    "ekf",
    "slam_grid",
    "tlbo_planner",
    "tracker",
    "messages",
    "truth",
}
ROBOT_COLOUR, WORLD_COLOUR, SHARED_COLOUR = "#dcecd9", "#dfe7f3", "#f2eee2"
SHARED = {"messages", "geometry", "common", "config"}


def layers() -> list[list[str]]:
    """Read the layers of the import rules.

    Returns:
        The rooms (packages and modules) of each layer, top layer first.
    """
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    rows = next(c["layers"] for c in contracts if c["type"] == "layers")
    return [[room.strip().removeprefix("simloop.") for room in row.split("|")] for row in rows]


def arrows(rooms: set[str]) -> dict[tuple[str, str], int]:
    """Count the imports between rooms, except imports of the shared packages.

    Args:
        rooms: Names of packages and of top-level modules.

    Returns:
        (importer, imported) -> number of imports.
    """
    graph = grimp.build_graph("simloop", cache_dir=None)
    found: dict[tuple[str, str], int] = {}
    for importer in graph.modules:
        for imported in graph.find_modules_directly_imported_by(importer):
            ends = [name.split(".")[1] if "." in name else "" for name in (importer, imported)]
            if ends[0] != ends[1] and set(ends) <= rooms and ends[1] not in SHARED:
                found[ends[0], ends[1]] = found.get((ends[0], ends[1]), 0) + 1
    return found


def colour_of(room: str) -> str:
    """Choose a room's colour.

    Args:
        room: Its name.

    Returns:
        The colour of the robot's side, of the simulator's side, or of the shared packages.
    """
    if room in SHARED:
        return SHARED_COLOUR
    return ROBOT_COLOUR if room in ROBOT else WORLD_COLOUR


def draw(rows: list[list[str]], imports: dict[tuple[str, str], int], picture: Path) -> None:
    """Draw rooms and arrows.

    Args:
        rows: The rooms of each layer, top layer first.
        imports: From `arrows`.
        picture: The file to write.
    """
    figure, axes = plt.subplots(figsize=(10, 12.5))
    places: dict[str, tuple[float, float]] = {}
    for level, row in enumerate(rows):
        for k, room in enumerate(row):
            places[room] = (10.0 * (k + 1) / (len(row) + 1), -1.0 * level)
    for (importer, imported), count in imports.items():
        style = {"arrowstyle": "-|>", "mutation_scale": 7, "color": "#7d8590"}
        bend = 0.12 if places[importer][0] <= places[imported][0] else -0.12
        axes.add_patch(
            FancyArrowPatch(
                places[importer],
                places[imported],
                connectionstyle=f"arc3,rad={bend}",
                lw=0.3 + 0.12 * min(count, 10),
                alpha=0.35,
                shrinkA=12,
                shrinkB=12,
                **style,
            )
        )
    for room, (x, y) in places.items():
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.85, y - 0.2),
                1.7,
                0.4,
                boxstyle="round,pad=0.04",
                fc=colour_of(room),
                ec="#4a5568",
                lw=1.0,
                zorder=3,
            )
        )
        text = f"{room}.py" if room in DOORS else f"{room}/"
        axes.text(x, y, text, ha="center", va="center", fontsize=9.5, zorder=4)
    axes.text(
        0.1,
        0.62,
        "green: the robot's own software   blue: simulator, judge, tools   "
        "yellow: shared by all   arrows: imports, always downwards (to yellow: not drawn)",
        fontsize=9,
        color="#4a5568",
    )
    axes.set_xlim(0, 10)
    axes.set_ylim(-len(rows) + 0.4, 0.9)
    axes.axis("off")
    figure.savefig(picture, dpi=110, bbox_inches="tight", facecolor="white")


def main() -> None:
    """Draw the picture of the documentation."""
    rows = layers()
    imports = arrows({room for row in rows for room in row})
    draw(rows, imports, PICTURE)
    print(f"{PICTURE.relative_to(ROOT)}: {sum(map(len, rows))} rooms, {len(imports)} arrows")


if __name__ == "__main__":
    main()
