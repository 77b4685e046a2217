"""Print the figures of the benchmark in the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from simloop.benchmarks.papers.page import figure
from simloop.common.terminal import print_table


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """Print one table for each world.

    Args:
        console: Console to print to.
        figures: The figures of `figures.figures_of`.
    """
    header = ["planner", "arrivals", "95 %", "contacts", "hits", "time s", "path ratio",
              "frame ms p50", "p99", "evaluations", "cpu s", ""]  # fmt: skip
    worlds = dict.fromkeys(cell["world"] for cell in figures["cells"])
    for world in worlds:
        rows = [
            [
                cell["planner"], f"{cell['arrivals']}/{cell['runs']}",
                " to ".join(f"{100.0 * end:.0f}" for end in cell["arrival_interval"]),
                str(cell["contacts"]), str(cell["hits"]), figure(cell["time_median_s"], 1),
                figure(cell["path_ratio"], 3), figure(cell["frame_ms_p50"], 1),
                figure(cell["frame_ms_p99"], 1), figure(cell["evaluations"], 0),
                figure(cell["cpu_s"], 1), "; ".join([*cell["errors"], cell["reason"]]).strip("; "),
            ]
            for cell in figures["cells"]
            if cell["world"] == world
        ]  # fmt: skip
        print_table(console, world, header, rows)
