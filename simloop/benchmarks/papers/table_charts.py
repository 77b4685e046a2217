"""Charts beside the papers' tables: planned paths, convergence, and values of single runs."""

from __future__ import annotations

import math
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from simloop.benchmarks.planners.charts import draw_world
from simloop.benchmarks.planners.paper_scenes import PAPER_SCENES, online_scene, paper_scene
from simloop.benchmarks.planners.scenes import Instance
from simloop.benchmarks.planners.trials import moving_instance
from simloop.common.html_images import drawn

_SAFE, _UNSAFE, _DPI = "#2b6cb0", "#d97706", 110


def pictures(table: dict[str, Any]) -> list[str]:
    """Draw what belongs to a table.

    Args:
        table: A table of `tables.measure`.

    Returns:
        HTML images: paths, convergence, values; only those that the table has data for.
    """
    found = table["pictures"]
    drawings = [
        _panels(found["panels"]) if found["panels"] else "",
        _curves(found["curves"]) if any(found["curves"].values()) else "",
        _samples(found["samples"]) if found["samples"] else "",
    ]
    return [drawing for drawing in drawings if drawing]


def _panels(panels: list[dict[str, Any]], most: int = 6) -> str:
    """Draw planned paths, one panel for each algorithm."""
    columns = min(most, len(panels))
    rows = math.ceil(len(panels) / columns)
    side = 2.3 if len(panels) > 4 else 3.0
    bounds = [_scene(panel["scene"]).world.bounds_m for panel in panels]
    tallest = max((y1 - y0) / (x1 - x0) for x0, y0, x1, y1 in bounds)
    size = (side * columns, (min(1.5, tallest) * side + 0.25) * rows)
    figure = Figure(figsize=size, layout="constrained", dpi=_DPI)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    for axis, panel in zip(axes, panels, strict=False):
        one = _scene(panel["scene"])
        draw_world(axis, one)
        for path, safe in zip(panel["paths_m"], panel["safe"], strict=True):
            colour, style = (_SAFE, "-") if safe else (_UNSAFE, "--")
            axis.plot(*np.array(path).T, color=colour, ls=style, lw=1.0, alpha=0.8)
        axis.plot(*one.start[:2], "o", color="black", ms=3)
        axis.plot(*one.goal, "*", color="black", ms=6)
        axis.set_title(panel["label"], fontsize=8)
    return drawn(figure, "planned paths")


def _scene(name: str) -> Instance:
    """Find a paper's scene; of a world with motion, its first moment."""
    if name in PAPER_SCENES:
        return paper_scene(name)
    return moving_instance(online_scene(name))


def _curves(curves: dict[str, Any]) -> str:
    """Draw the best J so far over the evaluations."""
    figure = Figure(figsize=(6.4, 3.0), layout="constrained", dpi=_DPI)
    axis = figure.subplots()
    for number, (label, points) in enumerate(curves.items()):
        if points:
            colour = matplotlib.colormaps["tab10"](number % 10)
            axis.plot(*np.array(points).T, color=colour, lw=1.6, label=label)
    axis.set(xscale="log", yscale="log", xlabel="evaluations", ylabel="best J so far, median")
    for formatter in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.tick_params(which="both", labelsize=7)
    axis.grid(alpha=0.25, which="both")
    axis.legend(fontsize=7)
    return drawn(figure, "convergence")


def _samples(samples: dict[str, Any]) -> str:
    """Draw the values of each run as box plots with all points."""
    figure = Figure(figsize=(4.4 * len(samples), 2.8), layout="constrained", dpi=_DPI)
    axes = figure.subplots(1, len(samples), squeeze=False)[0]
    for axis, (name, by_label) in zip(axes, samples.items(), strict=True):
        values = [np.array(one) for one in by_label.values()]
        axis.boxplot(values, tick_labels=list(by_label), showfliers=False,
                     medianprops={"color": "black"})  # fmt: skip
        for place, one in enumerate(values, start=1):
            spread = np.linspace(-0.18, 0.18, len(one))
            axis.plot(place + spread, one, "o", ms=2.5, color=_SAFE, alpha=0.5)
        axis.set_ylabel(name, fontsize=8)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.25, axis="y")
    return drawn(figure, "values of each run")
