"""Report of a replay: one HTML page without external files."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from simloop.common.files import make_directory, write_text
from simloop.common.html_images import check_libraries, filled
from simloop.replay.result import MEASURES, Replay, measure_lines

PAGE = "index.html"
"""Name of the page in the directory of ``--report``."""

_TEMPLATE = Path(__file__).with_name("page.html.j2")
_NOT_IN_TABLE = ("notes", "worthless", "stages", "versions", *MEASURES)


def check() -> None:
    """Check that the libraries for the page are installed.

    Raises:
        InputError: if one is missing.
    """
    check_libraries("--report")


def write(file: Path, name: str, replay: Replay) -> None:
    """Write the page.

    Args:
        file: the page; its directory is created.
        name: name of the log, for the title.
        replay: the result.

    Raises:
        InputError: if the file cannot be written.
    """
    make_directory(file.parent)
    write_text(file, render(name, replay))


def render(name: str, replay: Replay) -> str:
    """Fill the page's template.

    Args:
        name: name of the log, for the title.
        replay: the result.

    Returns:
        HTML text.
    """
    charts = importlib.import_module("simloop.replay.report.charts")
    figures = replay.figures
    values = {
        "name": name,
        "figures": figures,
        "table": {key: value for key, value in figures.items() if key not in _NOT_IN_TABLE},
        "measured": measure_lines(figures),
        "maps": charts.maps(replay),
        "beside": charts.beside(replay)[0],
        "thinned_to": charts.drawn_scans(replay),
        "unfitted": len(replay.unfitted),
        "errors": charts.errors(replay),
    }
    return filled(_TEMPLATE, values, figure)


def figure(value: Any) -> str:
    """Format a number of a table.

    Args:
        value: a number, a text, or None.

    Returns:
        The text of the cell; a dash for None.
    """
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
