"""Charts of a comparison, as SVG or HTML text for the report page."""

from __future__ import annotations

import io
import math
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from simloop.benchmarks.planners.bench import LEAD, Result, is_metaheuristic
from simloop.benchmarks.planners.bench_figures import gaps_of
from simloop.benchmarks.planners.scenes import Instance
from simloop.benchmarks.planners.weights import NAMES, Study
from simloop.common.html_images import drawn
from simloop.evaluation.statistics import convergence, ecdf

_LEAD_COLOUR, _SAFE, _UNSAFE, _SOLID = "#c0302b", "#2b6cb0", "#d97706", "#b8bec6"
_GRID_POINTS = 60
_MOST_PATHS = 6
_LEAST_GAP = 1e-3


def paths(result: Result, scene: str, columns: int = 6) -> str:
    """Draw the paths on the first instance of a scene, one panel for each planner.

    Args:
        result: The measurements.
        scene: Name of the scene.
        columns: Number of panels in a row.

    Returns:
        HTML image; unsafe paths are dashed.
    """
    one = next(task.instance for task in result.tasks if task.scene == scene)
    names = result.planners(scene)
    rows = math.ceil(len(names) / columns)
    figure = Figure(figsize=(2.2 * columns, 2.35 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes, names, strict=False):
        draw_world(axis, one)
        mine = [trial for trial in result.trials_of(scene, name) if trial.instance == one.name]
        for trial in mine[:_MOST_PATHS]:
            good = trial.verdict.success
            colour = (_LEAD_COLOUR if name == LEAD else _SAFE) if good else _UNSAFE
            axis.plot(*trial.path_m.T, color=colour, lw=1.0, ls="-" if good else "--", alpha=0.8)
        axis.plot(*one.start[:2], "o", color="black", ms=3)
        axis.plot(*one.goal, "*", color="black", ms=6)
        axis.set_title(name, fontsize=8)
    return drawn(figure, "paths")


def draw_world(axis: Any, one: Instance) -> None:
    """Draw the obstacles of a task, and the safe distance around discs.

    Args:
        axis: A matplotlib axis.
        one: The task.
    """
    world = one.world
    for x, y, r in world.discs_xyr_m:
        axis.add_patch(Circle((x, y), r + one.safe_m, fc="none", ec=_SOLID, lw=0.4))
        axis.add_patch(Circle((x, y), r, fc=_SOLID, ec="none"))
    for corners in world.polygons_m:
        axis.add_patch(Polygon(corners, fc=_SOLID, ec="none"))
    if world.distance_m.size:
        rows, cols = world.distance_m.shape
        low, step = world.origin_m, world.resolution_m
        extent = (low[0], low[0] + cols * step, low[1], low[1] + rows * step)
        blocked = np.where(world.distance_m <= 0.0, 0.28, np.nan)
        axis.imshow(blocked, origin="lower", extent=extent, cmap="gray_r", vmin=0, vmax=1)
    x0, y0, x1, y1 = world.bounds_m
    axis.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fc="none", ec=_SOLID, lw=0.6))
    ends = np.array([one.start[:2], one.goal])
    axis.set_xlim(min(x0, ends[:, 0].min()), max(x1, ends[:, 0].max()))
    axis.set_ylim(min(y0, ends[:, 1].min()), max(y1, ends[:, 1].max()))
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])


def curves(result: Result, scene: str) -> str:
    """Draw convergence (median gap over evaluations) and the ECDF of evaluations to the targets.

    Args:
        result: The measurements.
        scene: Name of the scene.

    Returns:
        SVG; empty if no best J is known or no planner has a history.
    """
    known = {name: best for name, best in result.best_costs(scene).items() if best is not None}
    names = [name for name in result.planners(scene) if _has_curve(name)]
    if not known or not names:
        return ""
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    most = result.request.budget
    grid = np.geomspace(max(10.0, most / 200), most, _GRID_POINTS)
    for number, name in enumerate(names):
        trials = [trial for trial in result.trials_of(scene, name) if trial.instance in known]
        histories = [trial.history for trial in trials]
        best = [known[trial.instance] for trial in trials]
        style = _style(number, name)
        gap = convergence(histories, best, grid)
        shown = np.where(np.isfinite(gap), np.maximum(gap, _LEAST_GAP), np.nan)
        left.plot(grid, shown, **style)
        right.plot(grid, ecdf(histories, best, grid), **style)
    left.set(xscale="log", yscale="log", xlabel="evaluations", ylabel="median gap, %")
    right.set(xscale="log", xlabel="evaluations", ylabel="share of runs x targets", ylim=(0, 1))
    right.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    for axis in (left, right):
        axis.grid(alpha=0.25)
    return _svg(figure)


def _has_curve(name: str) -> bool:
    """Whether a planner improves its path with the number of evaluations."""
    return is_metaheuristic(name) or name in (LEAD, "tlbo_precise", "informed_rrt_star", "bit_star")


def _style(number: int, name: str) -> dict[str, Any]:
    """Choose the line style of a planner; the lead planner is highlighted."""
    if name == LEAD:
        return {"color": _LEAD_COLOUR, "lw": 2.4, "label": name, "zorder": 9}
    colour = matplotlib.colormaps["tab20"](number % 20)
    dashes = ("-", "--", ":")[number // 7 % 3]
    return {"color": colour, "lw": 1.2, "ls": dashes, "label": name}


def spread(result: Result, scene: str) -> str:
    """Draw the gaps of each planner as box plots, the best median on top.

    Args:
        result: The measurements.
        scene: Name of the scene.

    Returns:
        SVG; empty if no best J is known.
    """
    best = result.best_costs(scene)
    gaps = {name: gaps_of(result.trials_of(scene, name), best) for name in result.planners(scene)}
    gaps = {name: values for name, values in gaps.items() if values}
    if not gaps:
        return ""
    order = sorted(gaps, key=lambda name: -float(np.median(gaps[name])))
    figure = Figure(figsize=(8.0, 0.6 + 0.2 * len(order)), layout="constrained")
    axis = figure.subplots()
    shown = [np.maximum(gaps[name], _LEAST_GAP) for name in order]
    boxes = axis.boxplot(shown, orientation="horizontal", tick_labels=order, patch_artist=True,
                         flierprops={"ms": 2}, medianprops={"color": "black"})  # fmt: skip
    for name, box in zip(order, boxes["boxes"], strict=True):
        box.set(facecolor=_LEAD_COLOUR if name == LEAD else "#dbe4ee")
    axis.set(xscale="log", xlabel="gap, %")
    axis.tick_params(labelsize=7)
    axis.grid(alpha=0.25, axis="x")
    return _svg(figure)


def weights(done: Study) -> str:
    """Draw Pareto front, scores, loadings and importance (Sabiha 2022, online TLBO, Figs. 7-10).

    Args:
        done: The weight study.

    Returns:
        SVG.
    """
    figure = Figure(figsize=(12.0, 3.4), layout="constrained")
    front, scores, loadings, importance = figure.subplots(1, 4)
    front.scatter(done.length_m, done.turning_rad, c=done.w1, cmap="viridis", s=18)
    best = np.argsort(done.length_m[done.front])
    on = np.column_stack([done.length_m, done.turning_rad])[done.front][best]
    front.plot(*on.T, color=_LEAD_COLOUR, lw=1.0)
    front.set(xlabel="length, m", ylabel="turning, rad", title="Pareto front (colour: w1)")
    scores.scatter(*done.pls.scores[:, :2].T, c=done.w1, cmap="viridis", s=18)
    scores.set(xlabel="t1", ylabel="t2", title="scores")
    for name, (x, y) in zip(NAMES, done.pls.x_loadings[:, :2], strict=True):
        loadings.annotate(name, (x, y))
        loadings.plot([0, x], [0, y], color=_SAFE)
    x, y = done.pls.y_loadings[:2]
    loadings.annotate("J", (x, y))
    loadings.plot([0, x], [0, y], color=_LEAD_COLOUR)
    loadings.set(xlabel="component 1", ylabel="component 2", title="loadings")
    importance.bar(NAMES, done.pls.vip, color=_SAFE)
    importance.axhline(1.0, color="black", lw=0.6)
    importance.set(title="importance (VIP)")
    return _svg(figure)


def _svg(figure: Figure) -> str:
    """Convert a figure to SVG without XML header and date, so that equal data give equal text."""
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]
