"""Show the figures of recorded logs: a table, and a page with links to the pages of the logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from simloop.benchmarks.logs.bench import Row, Task, failure, label
from simloop.common.files import make_directory, write_text
from simloop.common.html_images import filled
from simloop.common.terminal import print_lines, print_table

INDEX = "index.html"
"""Name of the page with the table, in the directory of ``--report``."""

_TEMPLATE = Path(__file__).with_name("index.html.j2")
_COLUMNS: dict[str, tuple[str, str]] = {  # heading: key of the row, format
    "scans": ("scans", "d"),
    "way m": ("way_m", ".0f"),
    "time s": ("log_time_s", ".0f"),
    "odometry ATE m": ("odometry_only_reference.ate_rmse_m", ".3g"),
    "ATE m": ("reference.ate_rmse_m", ".3f"),
    "max m": ("reference.ate_max_m", ".2f"),
    "RPE 5 m": ("reference.rpe_5m_median_m", ".3f"),
    "RPE 20 m": ("reference.rpe_20m_median_m", ".3f"),
    "relations m": ("relations.translation_mean_m", ".3f"),
    "of": ("relations", ""),
    "unmatched": ("scans_unmatched", "d"),
    "closures": ("closures", "d"),
    "ms p50": ("ms_per_scan_p50", ".1f"),
    "p99": ("ms_per_scan_p99", ".1f"),
    "x real time": ("real_time_factor", ".0f"),
    "MB": ("peak_memory_mb", ".0f"),
}


def header() -> list[str]:
    """Return the headings of the table.

    Returns:
        The texts.
    """
    return ["log", "a scan each", *_COLUMNS]


def cells(row: Row) -> list[str]:
    """Format a row of the table.

    Args:
        row: A log's row.

    Returns:
        One text for each heading; a dash where there is no figure.
    """
    every = "-" if row["thin_m"] is None else f"{row['thin_m']:g} m"
    return [row["name"], every, *(_cell(row, *column) for column in _COLUMNS.values())]


def _cell(row: Row, key: str, form: str) -> str:
    if key == "relations":
        relations = row.get(key)
        count = relations and relations["count"]
        return f"{count}/{count + relations['left_out']}" if relations else "-"
    value: Any = row
    for part in key.split("."):
        value = None if value is None else value.get(part)
    return "-" if value is None else format(value, form)


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """Print the table, and below it why results are missing.

    Args:
        console: Console to print to.
        figures: As from `simloop.benchmarks.logs.bench.figures_of`.
    """
    rows = figures["logs"]
    print_table(console, "recorded logs", header(), [cells(row) for row in rows])
    print_lines(console, failures(rows))


def failures(rows: Sequence[Row]) -> list[str]:
    """Describe the logs without a result of use.

    Args:
        rows: The rows.

    Returns:
        A sentence for each.
    """
    named = ((label(row["name"], row["thin_m"]), failure(row)) for row in rows)
    return [f"{name}: {why}" for name, why in named if why]


def write_index(directory: Path, tasks: Sequence[Task], figures: dict[str, Any]) -> None:
    """Write the page with the table.

    Args:
        directory: Directory of the report; it is created.
        tasks: The tasks, with their pages.
        figures: As from `simloop.benchmarks.logs.bench.figures_of`.

    Raises:
        InputError: If the file cannot be written.
    """
    pages = {(task.name, task.thin_m): task.page.name for task in tasks if task.page is not None}
    rows = [
        (None if row["error"] else pages[row["name"], row["thin_m"]], cells(row))
        for row in figures["logs"]
    ]
    values = {
        "figures": figures,
        "header": header(),
        "rows": rows,
        "failures": failures(figures["logs"]),
    }
    make_directory(directory)
    write_text(directory / INDEX, filled(_TEMPLATE, values))
