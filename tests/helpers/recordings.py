"""Reads recordings back with the recording library's own reader."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from simloop.recording.stream import TIMELINE


def read(path: Path) -> dict[str, list]:
    """Read the chunks of a recording by entity, as tables."""
    from rerun.chunk import RrdReader

    found: dict[str, list] = defaultdict(list)
    for chunk in RrdReader(str(path)).stream():
        found[chunk.entity_path].append(chunk.to_record_batch())
    return found


def column(tables: list, component: str) -> tuple[np.ndarray, list]:
    """Read times, ns, and values of one component in order, without static rows."""
    times, values = [], []
    for table in tables:
        if TIMELINE in table.schema.names and component in table.schema.names:
            times += table.column(TIMELINE).cast("int64").to_pylist()
            values += table.column(component).to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], [values[i] for i in order]


def scalars(tables: list) -> tuple[np.ndarray, np.ndarray]:
    """Read times (N,), ns, and values (N, k) of a plot with k lines."""
    times, values = column(tables, "Scalars:scalars")
    return times, np.array(values)


def line_names(tables: list) -> list[str]:
    """Read the names of a plot's lines."""
    (table,) = [t for t in tables if "SeriesLines:names" in t.schema.names]
    return table.column("SeriesLines:names").to_pylist()[0]
