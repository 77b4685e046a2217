"""Write the worlds of the papers into their scenario files, and measure their narrow passages.

    python scripts/paper_scenarios.py             # the narrowest passage on each paper's path
    python scripts/paper_scenarios.py --write     # write start, goal, bounds and obstacles anew

The scenes are defined in ``simloop/benchmarks/planners/paper_scenes.py``, in the papers' units.
The scale is read from each file's description, so a file is written anew after its scale has been
changed there. Movers and a moving goal are not written. A test compares them with the scenes, too.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simloop.benchmarks.planners.paper_scenes import PAPER_SCENES, online_scene, paper_scene
from simloop.cli.edge import run_script
from simloop.evaluation.shortest_path import shortest_path
from simloop.messages import FloatArray, WorldView
from simloop.scenario.catalog import scenario_files
from simloop.worlds.floor_plan import Section, rasterise
from simloop.worlds.layout import walls_about

# Scenario: scene, and whether walls stand along its bounds.
WORLDS = {
    "paper_sabiha_four": ("sabiha4", True),
    "paper_mohamed_5": ("abed5", False),
    "paper_mohamed_50": ("abed50", False),
    "paper_mohamed_150": ("abed150", False),
    "paper_mohamed_strip": ("strip20x60", True),
    "paper_wu": ("wu180", True),
    "paper_abed_narrow": ("narrow", True),
    "paper_abed_trap": ("trap", True),
    "paper_abed_local_minimum": ("local_minimum", True),
    "paper_abed_maze": ("maze", True),
    "paper_abed_moving": ("moving_obstacles", True),
    "paper_abed_moving_goal": ("moving_goal", True),
}
EDGE_M = 0.5
"""Least distance of start and goal from the bounds. The strip's ends are on its own bounds."""
_SCALE = re.compile(r"1 unit of the paper(?: \([^)]*\))? = ([\d.]*\d) m")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The fixed part of a scene, in units of the paper.

    Attributes:
        ends: (2, 2) start and goal.
        bounds: (4,) x_min, y_min, x_max, y_max.
        view: discs and convex polygons, as planners receive them.
        boxes: (B, 4) x_min, y_min, x_max, y_max of the polygons, cut off at the bounds, if they are
            boxes.
        safe: distance that the paper's path keeps.
    """

    ends: FloatArray
    bounds: FloatArray
    view: WorldView
    boxes: FloatArray
    safe: float


def scene_of(scenario: str, unit_m: float) -> Scene:
    """Collect the fixed part of a scenario's scene.

    Args:
        scenario: One of ``WORLDS``.
        unit_m: Metres in one unit of the paper.

    Returns:
        The scene.
    """
    name = WORLDS[scenario][0]
    if name in PAPER_SCENES:
        one = paper_scene(name)
        view, goal, boxes, safe = one.world, one.goal, one.boxes_m, one.safe_m
        start = one.start[:2]
    else:
        online = online_scene(name)
        view, goal, boxes, safe = online.fixed, online.goal.at(0), np.zeros((0, 4)), online.safe_m
        start = online.start[:2]
    ends, edge = np.array([start, goal]), EDGE_M / unit_m
    low = np.minimum(view.bounds_m[:2], ends.min(axis=0) - edge)
    high = np.maximum(view.bounds_m[2:], ends.max(axis=0) + edge)
    boxes = np.clip(boxes, np.tile(low, 2), np.tile(high, 2))
    bounds = np.concatenate((low, high))
    return Scene(ends, bounds, view, boxes, safe)


def scale_of(text: str) -> float:
    """Read the scale from a description.

    Args:
        text: The text of a scenario file.

    Returns:
        Metres in one unit of the paper.
    """
    found = _SCALE.search(text)
    if found is None:
        raise SystemExit("the description must say: 1 unit of the paper = ... m")
    return float(found[1])


def narrowest(scenario: str, unit_m: float) -> tuple[float, float]:
    """Measure the narrowest passage on the shortest path that keeps the paper's distance.

    A passage is the shortest line between two obstacles (or an obstacle and a wall) that the path
    crosses.

    Args:
        scenario: One of ``WORLDS``.
        unit_m: Metres in one unit of the paper.

    Returns:
        The passage's width, inf if the path crosses none, and the path's length, in units of the
        paper.
    """
    scene, walls = scene_of(scenario, unit_m), WORLDS[scenario][1]
    sections = [Section("disc", np.array([[x, y]]), r) for x, y, r in scene.view.discs_xyr_m]
    sections += [Section("polygon", np.array(corners)) for corners in scene.view.polygons_m]
    if walls:
        x0, y0, x1, y1 = scene.bounds.tolist()
        sections += [wall.sections("wall")[0] for wall in walls_about((x0, y0, x1, y1), 1.0)]
    # Only the outlines count, so the raster may be coarse.
    plan = rasterise(sections, scene.bounds, float(np.ptp(scene.bounds)) / 10.0)
    path = shortest_path(plan, scene.ends[0], scene.ends[1], scene.safe)
    if path is None:
        raise SystemExit(f"{scenario}: there is no path")
    widths = [math.inf]
    for one, other in itertools.combinations(sections, 2):
        distance, a, b = min(
            (_nearest(one, other), _nearest(other, one)), key=lambda found: found[0]
        )
        if _crosses(a, b, path.xy_m):
            widths.append(distance - one.radius_m - other.radius_m)
    return min(widths), path.length_m


def _nearest(one: Section, other: Section) -> tuple[float, FloatArray, FloatArray]:
    """Find one outline's corner (2,) that is nearest to the other, and the other's point (2,)."""
    p, a = one.vertices_m[:, None], other.vertices_m[None]
    along = np.roll(other.vertices_m, -1, axis=0)[None] - a
    square = np.maximum(np.sum(along**2, axis=-1), 1e-12)
    share = np.clip(np.sum((p - a) * along, axis=-1) / square, 0.0, 1.0)
    points = a + share[..., None] * along
    apart = np.hypot(*np.moveaxis(p - points, -1, 0))
    i, j = np.unravel_index(np.argmin(apart), apart.shape)
    return float(apart[i, j]), one.vertices_m[i], points[i, j]


def _crosses(a: FloatArray, b: FloatArray, path: FloatArray) -> bool:
    """Tell whether the segment from a (2,) to b (2,) crosses a path (N, 2)."""
    p, q = path[:-1], path[1:]
    apart = _side(a, b, p) * _side(a, b, q) < 0.0
    return bool(np.any(apart & (_side(p, q, a) * _side(p, q, b) < 0.0)))


def _side(a: FloatArray, b: FloatArray, point: FloatArray) -> FloatArray:
    """Compute a number that is positive where the point is to the left of a -> b."""
    along, to = b - a, point - a
    return along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]


def geometry(scenario: str, unit_m: float) -> str:
    """Write start, goal, bounds and obstacles as TOML.

    Args:
        scenario: One of ``WORLDS``.
        unit_m: Metres in one unit of the paper.

    Returns:
        The lines of the scenario file, in metres, to the millimetre.
    """
    scene, walls = scene_of(scenario, unit_m), WORLDS[scenario][1]
    (x, y), goal = unit_m * scene.ends
    yaw = math.atan2(goal[1] - y, goal[0] - x)
    bounds = np.round(unit_m * scene.bounds, 3)
    lines = [
        f"start = {_row(x, y, yaw)}",
        f"goal = {_row(*goal)}",
        f"bounds_m = {_row(*bounds)}",
        "obstacles = [",
    ]
    for cx, cy, radius in unit_m * scene.view.discs_xyr_m:
        lines.append(_obstacle("cylinder", (cx, cy), f"size_m = {_row(2.0 * radius)}"))
    lines += [_box(*box) for box in unit_m * scene.boxes]
    for corners in () if len(scene.boxes) else scene.view.polygons_m:
        middle = np.round(unit_m * corners.mean(axis=0), 3)
        rows = ", ".join(_row(*corner) for corner in unit_m * corners - middle)
        lines.append(_obstacle("polygon", middle, f"vertices_m = [{rows}]"))
    if walls:
        lines.append("  # Walls.")
        for wall in walls_about(tuple(bounds.tolist())):
            size = f"size_m = {_row(*wall.size_m)}"
            lines.append(_obstacle("box", wall.position_m, size))
    return "\n".join([*lines, "]"])


def _box(x0: float, y0: float, x1: float, y1: float) -> str:
    middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    return _obstacle("box", middle, f"size_m = {_row(x1 - x0, y1 - y0)}")


def _obstacle(shape: str, position: FloatArray | tuple[float, ...], rest: str) -> str:
    return f'  {{ shape = "{shape}", position_m = {_row(*position)}, {rest} }},'


def _row(*numbers: float) -> str:
    """Write numbers as a TOML array, to the millimetre or milliradian."""
    return f"[{', '.join(str(round(float(number), 3) + 0.0) for number in numbers)}]"


def rewrite(path: Path, scenario: str) -> None:
    """Replace the geometry in a scenario file.

    Args:
        path: The file. It has a description with the scale and a line that begins with ``start``.
        scenario: One of ``WORLDS``.
    """
    text = path.read_text(encoding="utf-8")
    body = geometry(scenario, scale_of(text))
    old = re.compile(r"^start = .*?(?:^obstacles = \[.*?^\]|\Z)", re.MULTILINE | re.DOTALL)
    path.write_text(old.sub(lambda _: body, text, count=1), encoding="utf-8")


def main() -> None:
    """Print the narrowest passages, or write the files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the geometry into the files")
    write = parser.parse_args().write
    files = scenario_files()
    for scenario in WORLDS:
        if write:
            rewrite(files[scenario], scenario)
        unit_m = scale_of(files[scenario].read_text(encoding="utf-8"))
        width, length = narrowest(scenario, unit_m)
        print(
            f"{scenario:25} 1 unit = {unit_m:g} m; path {length:.2f} units = "
            f"{unit_m * length:.2f} m; narrowest passage {width:.3f} units = "
            f"{unit_m * width:.2f} m"
        )


if __name__ == "__main__":
    run_script(main)
