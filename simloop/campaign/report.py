"""Write a campaign's report: one HTML page that contains all its pictures."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from simloop.campaign import closer_look
from simloop.campaign.spec import RunSpec
from simloop.campaign.summary import FIGURES, name_of, summarise
from simloop.campaign.thresholds import Verdict
from simloop.campaign.work import Row
from simloop.common.errors import InputError
from simloop.common.files import write_text
from simloop.common.html_images import check_libraries, embedded, filled

_TEMPLATE = Path(__file__).with_name("page.html.j2")
_PICTURES = 4
_FAILURES_LISTED = 200


def check() -> None:
    """Check that the libraries for the report are installed.

    Raises:
        InputError: If one is missing.
    """
    try:
        check_libraries("the report")
    except InputError as error:
        raise InputError(f"{error}, or give --no-report") from None


def write(
    folder: Path,
    runs: Sequence[tuple[RunSpec, Row]],
    verdicts: Sequence[Verdict],
    stop: Callable[[], bool] = lambda: False,
) -> Path:
    """Draw pictures of the worst runs and write ``report.html``.

    Args:
        folder: Folder of the report.
        runs: Each run with its row.
        verdicts: The verdicts on these runs.
        stop: Called several times a second. Once it returns True, no further picture is drawn.

    Returns:
        The report's file.

    Raises:
        InputError: If the file cannot be written.
    """
    file = folder / "report.html"
    write_text(file, render(runs, verdicts, _pictures(closer_look.worst(runs, _PICTURES), stop)))
    return file


def render(
    runs: Sequence[tuple[RunSpec, Row]],
    verdicts: Sequence[Verdict],
    pictures: Sequence[tuple[RunSpec, Row, str]],
) -> str:
    """Make the text of the report.

    Args:
        runs: Each run with its row.
        verdicts: The verdicts on these runs.
        pictures: The worst runs, each with its row and a picture as an HTML ``img`` element. The
            element is empty if no picture could be drawn.

    Returns:
        The HTML page.
    """
    charts = importlib.import_module("simloop.campaign.charts")
    rows = [row for _, row in runs]
    summaries = summarise(rows)
    failed = [run for run in runs if not run[1]["success"]]
    values = {
        "runs": len(runs),
        "reached": len(runs) - len(failed),
        "summaries": summaries,
        "figures": FIGURES,
        "verdicts": verdicts,
        "failed": failed[:_FAILURES_LISTED],
        "left_out": max(0, len(failed) - _FAILURES_LISTED),
        "pictures": pictures,
        "success": charts.success(summaries),
        "distributions": charts.distributions(rows),
        "name_of": name_of,
    }
    return filled(_TEMPLATE, values)


def _pictures(
    runs: Sequence[tuple[RunSpec, Row]], stop: Callable[[], bool]
) -> list[tuple[RunSpec, Row, str]]:
    found = []
    with tempfile.TemporaryDirectory() as place:
        for spec, row in runs:
            sheet = closer_look.picture(spec, Path(place), stop)
            found.append((spec, row, "" if sheet is None else _as_jpeg(sheet)))
    return found


def _as_jpeg(sheet: Path) -> str:
    """Convert a contact sheet to JPEG, a tenth of the PNG's size with the same look on the page."""
    import cv2

    image = cv2.imread(str(sheet))
    assert image is not None
    return embedded(cv2.imencode(".jpg", image)[1].tobytes(), "jpeg", "eight moments of the run")
