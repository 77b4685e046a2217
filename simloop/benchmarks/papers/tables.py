"""Measure the papers' own tables and the weight study, one part at a time, and keep each part.

A part is written to the benchmark's folder as soon as it is measured, so that an interrupted
benchmark goes on with the next one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simloop.benchmarks.planners import weights
from simloop.benchmarks.planners.paper_runs import PaperTable
from simloop.benchmarks.planners.paper_tables import abed_tables, mohamed_tables, wu_tables
from simloop.benchmarks.planners.sabiha_tables import sabiha_tables
from simloop.benchmarks.planners.tasks import load_scene
from simloop.common import pool
from simloop.common.files import write_text
from simloop.common.pool import Workers
from simloop.evaluation.provenance import versions

Part = Any
"""A measured part: a list of tables, or the weight study, as JSON holds it."""

PARTS = ("sabiha", "wu", "mohamed", "abed", "weights")
"""The parts, each of which one worker measures."""

ABED_RUNS = 10
"""Runs of each method in Abed's worlds; the paper does not state its number."""

_DIGITS = 6
_FORMAT = 1
"""Number of the format of a kept part; a part of another format is measured again."""


def measure(name: str) -> Part:
    """Measure a part.

    Args:
        name: One of `PARTS`.

    Returns:
        The part.
    """
    if name == "weights":
        return _plain(asdict(weights.study(load_scene("S1")[0].instance)))
    makers: dict[str, Callable[[], list[PaperTable]]] = {
        "sabiha": sabiha_tables,
        "wu": wu_tables,
        "mohamed": mohamed_tables,
        "abed": partial(abed_tables, ABED_RUNS),
    }
    return [_plain(asdict(table)) for table in makers[name]()]


def files(folder: Path) -> dict[str, Path]:
    """List the files of the tables.

    Args:
        folder: The folder of the tables.

    Returns:
        Name -> file, in the order of `PARTS`, whether or not they exist.
    """
    return {name: _file(folder, name) for name in PARTS}


def read(folder: Path) -> dict[str, Part]:
    """Read the parts that are measured already.

    Args:
        folder: The benchmark's folder.

    Returns:
        Name -> part, in the order of `PARTS`. A part of another format or of other package
        versions, or a file that is damaged, is left out.
    """
    found = {}
    for name in PARTS:
        try:
            kept = json.loads(_file(folder, name).read_text(encoding="utf-8"))
            if (kept["format"], kept["versions"]) == (_FORMAT, versions()):
                found[name] = kept["part"]
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return found


def measure_missing(
    folder: Path,
    workers: Workers,
    stop: Callable[[], bool] = lambda: False,
    work: Callable[[str], Part] = measure,
) -> Iterator[tuple[str, Part]]:
    """Measure the parts that the folder lacks, and keep each as soon as it is finished.

    Args:
        folder: The benchmark's folder; it exists.
        workers: The workers.
        stop: Called several times a second; once it returns True, no further part starts.
        work: Function that measures a part.

    Yields:
        Name and part, in the order in which they are finished.

    Raises:
        RuntimeError: If the worker of a part died twice.
    """
    kept = read(folder)
    todo = [name for name in PARTS if name not in kept]
    done = pool.run_all(todo, work, workers, when_lost=_raise_lost, stop=stop)
    with closing(done):
        for name, part in done:
            text = json.dumps({"format": _FORMAT, "versions": versions(), "part": part})
            write_text(_file(folder, name), text + "\n")
            yield name, part


def study_of(part: Part) -> weights.Study:
    """Convert the weight study back from JSON.

    Args:
        part: The part ``weights``.

    Returns:
        The study.
    """
    return weights.Study(**{**_arrays(part), "pls": weights.Pls(**_arrays(part["pls"]))})


def tables_of(tables: dict[str, Part], source: str) -> list[Part]:
    """Choose the tables of a paper.

    Args:
        tables: The parts.
        source: The start of the tables' source.

    Returns:
        Its tables, in order.
    """
    every: Sequence[Part] = [
        table for name in PARTS if name != "weights" for table in tables.get(name, ())
    ]
    return [table for table in every if table["source"].startswith(source)]


def _file(folder: Path, name: str) -> Path:
    return folder / f"tables_{name}.json"


def _arrays(table: dict[str, Any]) -> dict[str, Any]:
    """Convert lists to arrays."""
    return {
        key: np.array(value) if isinstance(value, list) else value for key, value in table.items()
    }


def _raise_lost(name: str) -> Part:
    raise RuntimeError(f"the tables of {name}: the worker process died twice")


def _plain(value: Any) -> Any:
    """Convert arrays and numpy numbers for JSON, rounded to six decimals."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return round(value, _DIGITS) if isinstance(value, float) else value
