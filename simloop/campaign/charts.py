"""Draw the charts of a campaign's report: success rates, and distributions of the figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from simloop.campaign.summary import FIGURES, CellSummary, cells_of, figure_of, name_of
from simloop.campaign.work import Row
from simloop.common.html_images import drawn

_COLOURS = ("#2b6cb0", "#c0302b", "#2f855a", "#d97706", "#6b46c1", "#4a5568")
_LABELS = {
    "sim_time_s": "time, s",
    "path_ratio": "path length / shortest",
    "min_clearance_m": "smallest clearance, m",
    "ate_rmse_m": "position error, m RMS",
    "energy_j": "energy, J",
}
_MOST_LINES = 12


def success(summaries: Sequence[CellSummary]) -> str:
    """Draw a bar with the success rate of each cell and its 95 % interval.

    Args:
        summaries: The cells' summaries.

    Returns:
        The chart as an HTML ``img`` element.
    """
    figure = Figure(figsize=(7.5, 0.7 + 0.32 * len(summaries)), layout="constrained")
    axis = figure.subplots()
    places = np.arange(len(summaries))[::-1]
    share = np.array([one.success for one in summaries])
    low = share - [one.low for one in summaries]
    high = np.array([one.high for one in summaries]) - share
    axis.barh(places, share, color="#bcd3ea", height=0.6)
    axis.errorbar(
        share, places, xerr=np.abs([low, high]), fmt="o", color="#2b6cb0", ms=4, capsize=3
    )
    axis.set_yticks(places, [name_of(one.cell) for one in summaries], fontsize=8)
    axis.set_xlim(0.0, 1.02)
    axis.set_xlabel("share of runs that reached the goal, 95 % interval", fontsize=8)
    return drawn(figure, "success rates")


def distributions(rows: Sequence[Row]) -> str:
    """Draw the cumulative distribution of each figure over the successful runs.

    There is a panel for each figure and a line for each cell. A line shows the share of runs
    whose figure is not greater than x. Only the first cells are drawn if there are many.

    Args:
        rows: Rows of one campaign.

    Returns:
        The chart as an HTML ``img`` element.
    """
    cells = list(cells_of([row for row in rows if row["success"]]).items())[:_MOST_LINES]
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    axes = figure.subplots(2, 3).ravel()
    for axis, name in zip(axes, FIGURES, strict=False):
        for number, (cell, mine) in enumerate(cells):
            values = np.sort([v for row in mine if (v := figure_of(row, name)) is not None])
            share = np.arange(1, len(values) + 1) / max(1, len(values))
            colour, style = _COLOURS[number % 6], "-" if number < 6 else "--"
            axis.step(values, share, where="post", color=colour, ls=style, label=name_of(cell))
        axis.set_xlabel(_LABELS[name], fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_ylim(0.0, 1.02)
    # The last panel has no figure of its own: it holds the legend.
    handles, labels = axes[0].get_legend_handles_labels()
    axes[-1].legend(handles, labels, fontsize=7, loc="center")
    axes[-1].set_axis_off()
    return drawn(figure, "distributions")
