"""Charts of the drives: the driven paths in each world, arrivals, and clearance along a drive."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from simloop.benchmarks.papers.figures import Cell
from simloop.benchmarks.papers.papers import LEAD
from simloop.campaign.work import Row
from simloop.common.html_images import drawn
from simloop.messages import FloatArray
from simloop.scenario.build import World, build_world
from simloop.scenario.load import load
from simloop.scenario.scenario import Scenario

_LEAD_COLOUR, _ARRIVED, _FAILED, _SOLID = "#c0302b", "#2b6cb0", "#d97706", "#b8bec6"
_MOVING = "#6b46c1"
_MOST_PATHS, _DPI = 5, 110


def driven(world: str, rows: Mapping[str, Sequence[Row]], columns: int = 6) -> str:
    """Draw the driven paths in a world, one panel for each planner.

    A world that is drawn from the seed is shown for the first seed only.

    Args:
        world: Name of the scenario.
        rows: Planner -> rows of its runs, by seed.
        columns: Largest number of panels in a row.

    Returns:
        HTML image; paths that do not arrive are dashed.
    """
    first = next(iter(rows.values()))[0]["seed"]
    scenario = load(world, seed=first)
    built = build_world(scenario)
    columns = min(columns, len(rows))
    lines = math.ceil(len(rows) / columns)
    width, height = built.floor.bounds_m[2:] - built.floor.bounds_m[:2]
    side = 2.6 if len(rows) > 4 else 3.4
    tall = min(1.6, max(0.3, height / width)) * side + 0.45
    figure = Figure(figsize=(side * columns, tall * lines), layout="constrained", dpi=_DPI)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in axes[len(rows) :]:
        axis.set_axis_off()
    for axis, (planner, mine) in zip(axes, rows.items(), strict=False):
        _draw_floor(axis, built, scenario)
        shown = [row for row in mine if not scenario.drawn or row["seed"] == first]
        for row in shown[:_MOST_PATHS]:
            _draw_run(axis, row, planner)
        arrived = sum(bool(row["success"]) for row in mine)
        axis.set_title(f"{planner}: {arrived} of {len(mine)}", fontsize=8)
    return drawn(figure, f"driven paths in {world}")


def arrivals(cells: Sequence[Cell]) -> str:
    """Draw the share of arrivals of each planner, one panel for each world.

    Args:
        cells: Cells of several worlds.

    Returns:
        HTML image.
    """
    worlds = list(dict.fromkeys(cell["world"] for cell in cells))
    names = list(dict.fromkeys(cell["planner"] for cell in cells))
    size = (1.6 + 2.4 * len(worlds), 0.7 + 0.2 * len(names))
    figure = Figure(figsize=size, layout="constrained", dpi=_DPI)
    axes = figure.subplots(1, len(worlds), sharey=True, squeeze=False)[0]
    for axis, world in zip(axes, worlds, strict=True):
        for cell in (cell for cell in cells if cell["world"] == world):
            place, share = names.index(cell["planner"]), cell["arrivals"] / cell["runs"]
            low, high = cell["arrival_interval"]
            colour = _LEAD_COLOUR if cell["planner"] == LEAD else _ARRIVED
            axis.plot([low, high], [place, place], color=colour, lw=1.6, alpha=0.5)
            axis.plot(share, place, "o", color=colour, ms=4)
        axis.set(xlim=(-0.03, 1.03), ylim=(len(names) - 0.5, -0.5))
        axis.set_title(world, fontsize=9)
        axis.grid(alpha=0.25, axis="x")
        axis.tick_params(labelsize=7)
        axis.set_xlabel("share that arrives", fontsize=8)
    axes[0].set_yticks(range(len(names)), names, fontsize=7)
    return drawn(figure, "share of runs that arrive, with 95 % intervals")


def clearances(world: str, rows: Sequence[Row]) -> list[FloatArray]:
    """Measure the distance to the nearest obstacle along driven paths.

    Args:
        world: Name of a scenario whose obstacles stand still and are the same for each seed.
        rows: Rows of runs, each with a path.

    Returns:
        For each run (N, 2): the way driven, m, and the distance from the vehicle's centre to the
        nearest obstacle there, m.
    """
    floor = build_world(load(world, seed=rows[0]["seed"])).floor
    found = []
    for path in (np.array(row["path_m"]) for row in rows):
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        found.append(np.column_stack([way, floor.clearance_m(path)]))
    return found


def clearance(along: Sequence[FloatArray], safe_m: float) -> str:
    """Draw the distance to the nearest obstacle along drives (Sabiha 2022, online, Fig. 18).

    Args:
        along: Way and distance of each run, see `clearances`.
        safe_m: The distance that the paper keeps, m.

    Returns:
        HTML image.
    """
    figure = Figure(figsize=(6.4, 2.6), layout="constrained", dpi=_DPI)
    axis = figure.subplots()
    for values in along[:_MOST_PATHS]:
        axis.plot(*values.T, color=_LEAD_COLOUR, lw=1.0, alpha=0.7)
    axis.axhline(safe_m, color="black", lw=0.8, ls="--")
    axis.text(0.0, safe_m, f" d_safe {safe_m:.2f} m", fontsize=7, va="bottom")
    axis.set(xlabel="way, m", ylabel="from the centre to the\nnearest obstacle, m", ylim=(0, None))
    axis.grid(alpha=0.25)
    return drawn(figure, "distance to the nearest obstacle along the drive")


def _draw_floor(axis: Any, world: World, scenario: Scenario) -> None:
    """Draw obstacles, start, goal and the movers at their first places."""
    for section in world.floor.sections:
        _draw_outline(axis, section.vertices_m, section.radius_m)
    for mover in world.movers:
        axis.add_patch(
            Circle(mover.start_m, 0.5 * mover.diameter_m, fc=_MOVING, ec="none", alpha=0.5)
        )
        if mover.keys_txy:
            axis.plot(*np.array(mover.keys_txy)[:, 1:].T, color=_MOVING, lw=0.7, ls=":")
    x0, y0, x1, y1 = world.floor.bounds_m
    axis.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fc="none", ec=_SOLID, lw=0.6))
    axis.plot(*scenario.start[:2], "o", color="black", ms=3)
    axis.plot(*scenario.goal, "*", color="black", ms=7)
    axis.set(xlim=(x0, x1), ylim=(y0, y1), xticks=[], yticks=[])
    axis.set_aspect("equal")


def _draw_outline(axis: Any, vertices: FloatArray, radius_m: float) -> None:
    """Draw a convex outline that is grown by a radius."""
    if len(vertices) > 2:
        axis.add_patch(Polygon(vertices, fc=_SOLID, ec="none"))
    if radius_m > 0.0:
        for x, y in vertices:
            axis.add_patch(Circle((x, y), radius_m, fc=_SOLID, ec="none"))


def _draw_run(axis: Any, row: Row, planner: str) -> None:
    """Draw the driven path of one run, and the way of a moving goal."""
    if not row.get("path_m"):
        return
    arrived = (_LEAD_COLOUR if planner == LEAD else _ARRIVED) if row["success"] else _FAILED
    style = "-" if row["success"] else "--"
    axis.plot(*np.array(row["path_m"]).T, color=arrived, lw=1.1, ls=style, alpha=0.8)
    if row.get("goal_path_m"):
        axis.plot(*np.array(row["goal_path_m"]).T, color=_MOVING, lw=0.8, ls=":")
