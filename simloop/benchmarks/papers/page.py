"""Report of the benchmark: one HTML page without external files."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simloop.benchmarks.papers import tables as measured
from simloop.benchmarks.papers.entries import EVERY, Drives
from simloop.benchmarks.papers.figures import Cell
from simloop.benchmarks.papers.findings import findings
from simloop.benchmarks.papers.papers import LEAD, PAPERS, Paper
from simloop.benchmarks.planners.page import check
from simloop.benchmarks.planners.weights import PRINTED
from simloop.campaign.work import Row
from simloop.common.files import write_text
from simloop.common.html_images import filled
from simloop.config import PlannerConfig

__all__ = ["check", "render", "write"]

_TEMPLATE = Path(__file__).with_name("page.html.j2")
_WITH_WEIGHTS, _ROOM = "sabiha_online", "experiment"


def write(
    directory: Path, request: Drives, rows: Mapping[str, Row], figures: dict[str, Any]
) -> Path:
    """Write ``index.html``.

    Args:
        directory: Directory of the report; it is created.
        request: The request.
        rows: The row of each finished run, by ``RunSpec.key``.
        figures: The figures of these runs.

    Returns:
        The written file.

    Raises:
        InputError: The file cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    file = directory / "index.html"
    write_text(file, render(request, rows, figures))
    return file


def render(request: Drives, rows: Mapping[str, Row], figures: dict[str, Any]) -> str:
    """Fill the page's template.

    Args:
        request: The request.
        rows: The row of each finished run, by ``RunSpec.key``.
        figures: The figures of these runs.

    Returns:
        HTML text.
    """
    charts = importlib.import_module("simloop.benchmarks.papers.drive_charts")
    by_world = _rows_by_world(request, rows)
    every = [cell for cell in figures["cells"] if cell["group"] == EVERY]
    values = {
        "lead": LEAD,
        "figures": figures,
        "every": _by_world(every),
        "arrivals": charts.arrivals(every) if every else "",
        "drawings": {
            world: charts.driven(world, mine, 6 if len(mine) > 6 else 3)
            for world, mine in by_world.items()
        },
        "papers": [_section(paper, figures, by_world) for paper in PAPERS],
    }
    return filled(_TEMPLATE, values, figure)


def figure(value: Any, digits: int = 2) -> str:
    """Format a number of a table.

    Args:
        value: A number, a text, or None.
        digits: Number of decimals.

    Returns:
        The text of the cell; a dash for None.
    """
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:,.0f}"
    return str(value)


def _section(
    paper: Paper, figures: dict[str, Any], by_world: Mapping[str, Mapping[str, list[Row]]]
) -> dict[str, Any]:
    """Collect what the page shows of a paper."""
    table_charts = importlib.import_module("simloop.benchmarks.papers.table_charts")
    worlds = [*dict.fromkeys(drive.world for drive in paper.drives), *paper.shown]
    cells = {(cell["world"], cell["planner"]): cell for cell in figures["cells"]}
    tables = measured.tables_of(figures["tables"], paper.tables)
    return {
        "paper": paper,
        "tables": [
            {
                "table": table,
                "pictures": table_charts.pictures(table),
                "why": paper.why.get(table["title"], "") if table["differs"] else "",
            }
            for table in tables
        ],
        "worlds": {
            world: [cell for cell in figures["cells"] if cell["world"] == world]
            for world in worlds
            if world in by_world
        },
        "findings": findings(paper, cells),
        "weights": _weights(paper, figures),
        "clearance": _clearance(paper, by_world),
    }


def _weights(paper: Paper, figures: dict[str, Any]) -> dict[str, Any] | None:
    """Draw the weight study of the lead paper."""
    if paper.key != _WITH_WEIGHTS or figures["weights"] is None:
        return None
    charts = importlib.import_module("simloop.benchmarks.planners.charts")
    study = measured.study_of(figures["weights"])
    return {"study": study, "picture": charts.weights(study), "printed": PRINTED}


def _clearance(
    paper: Paper, by_world: Mapping[str, Mapping[str, list[Row]]]
) -> dict[str, Any] | None:
    """Measure and draw the clearance of the lead planner's drives in the lead paper's room."""
    rows = [row for row in by_world.get(_ROOM, {}).get(LEAD, ()) if row.get("path_m")]
    if paper.key != _WITH_WEIGHTS or not rows:
        return None
    charts = importlib.import_module("simloop.benchmarks.papers.drive_charts")
    along = charts.clearances(_ROOM, rows)
    safe_m = PlannerConfig().safe_distance_m
    return {
        "picture": charts.clearance(along, safe_m),
        "least_m": min(float(values[:, 1].min()) for values in along),
        "safe_m": safe_m,
    }


def _by_world(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """Group cells by world; in each world the planner that arrives most, then fastest, is first."""
    found: dict[str, list[Cell]] = {}
    for cell in cells:
        found.setdefault(cell["world"], []).append(cell)
    for mine in found.values():
        mine.sort(key=lambda cell: (-cell["arrivals"] / cell["runs"], cell["time_median_s"] or 1e9))
    return found


def _rows_by_world(request: Drives, rows: Mapping[str, Row]) -> dict[str, dict[str, list[Row]]]:
    """Group rows by world and planner, in the order of the request."""
    found: dict[str, dict[str, list[Row]]] = {}
    for entry in request.chosen():
        mine = [rows[spec.key] for spec in request.runs_of(entry) if spec.key in rows]
        if mine:
            found.setdefault(entry.world, {})[entry.planner] = mine
    return found
