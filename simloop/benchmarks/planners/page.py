"""Report of a comparison: one HTML page without external files."""

from __future__ import annotations

import importlib
from contextlib import closing
from pathlib import Path
from typing import Any

from simloop.benchmarks.planners import paper_tables
from simloop.benchmarks.planners.bench import LEAD, Result
from simloop.benchmarks.planners.bench_figures import rank
from simloop.benchmarks.planners.paper_tables import PaperTable
from simloop.benchmarks.planners.tasks import load_scene
from simloop.benchmarks.planners.weights import PRINTED, study
from simloop.common.files import check_directory, write_text
from simloop.common.html_images import check_libraries, filled
from simloop.common.pool import local_workers, run_all

_TEMPLATE = Path(__file__).with_name("page.html.j2")


def check(directory: Path) -> None:
    """Check that the report can be written.

    Args:
        directory: Directory of the report.

    Raises:
        InputError: The directory cannot be used, or a library is not installed.
    """
    check_directory(directory, "--report")
    check_libraries("--report", ("jinja2", "matplotlib", "sklearn"))


def measure_tables(workers: int) -> list[PaperTable]:
    """Measure the papers' tables in parallel processes.

    Args:
        workers: Number of processes.

    Returns:
        The tables, paper by paper.
    """
    makers = range(len(paper_tables.TABLES))
    done = run_all(makers, _make_tables, local_workers(workers), when_lost=_raise_lost)
    with closing(done):
        found = dict(done)
    return [table for number in makers for table in found[number]]


def _make_tables(number: int) -> list[PaperTable]:
    return paper_tables.TABLES[number]()


def _raise_lost(number: int) -> list[PaperTable]:
    raise RuntimeError(f"{paper_tables.TABLES[number].__name__}: its worker process died twice")


def write(directory: Path, result: Result, figures: dict[str, Any]) -> Path:
    """Measure the report's own parts (paper tables, weights) and write ``index.html``.

    Args:
        directory: Directory of the report; it is created.
        result: The measurements.
        figures: Figures of ``result``.

    Returns:
        The written file.
    """
    tables = measure_tables(result.request.workers or 2)
    weights = study(load_scene("S1")[0].instance)
    text = render(result, figures, tables, weights)
    directory.mkdir(parents=True, exist_ok=True)
    file = directory / "index.html"
    write_text(file, text)
    return file


def render(result: Result, figures: dict[str, Any], tables: list[PaperTable], weights: Any) -> str:
    """Fill the page's template.

    Args:
        result: The measurements.
        figures: Figures of ``result``.
        tables: The papers' tables.
        weights: The weight study.

    Returns:
        HTML text.
    """
    charts = importlib.import_module("simloop.benchmarks.planners.charts")
    pictures = {
        scene: {
            "paths": charts.paths(result, scene),
            "curves": charts.curves(result, scene),
            "spread": charts.spread(result, scene),
        }
        for scene in result.scenes()
        if result.planners(scene)
    }
    values = {
        "lead": LEAD,
        "figures": figures,
        "pictures": pictures,
        "ordered": {
            scene: sorted(named.items(), key=lambda item: rank(item[1]))
            for scene, named in figures["scenes"].items()
        },
        "tables": tables,
        "weights": weights,
        "weights_picture": charts.weights(weights),
        "printed": PRINTED,
    }
    return filled(_TEMPLATE, values, _figure)


def _figure(value: Any, digits: int = 3) -> str:
    """Format the text of a table's cell."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.3g}"
    return str(value)
