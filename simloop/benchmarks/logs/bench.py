"""Map the recorded logs of a folder in parallel processes, and measure each trajectory."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simloop.benchmarks.logs.thin import LEAST_M, MOST_M, thin
from simloop.common.errors import InputError, did_you_mean, printable
from simloop.common.pool import local_workers, run_all
from simloop.common.profiler import reset_peak_memory
from simloop.evaluation.provenance import machine, versions
from simloop.replay import session
from simloop.replay.laser_log import LaserLog
from simloop.replay.read_log import LOG_SUFFIXES
from simloop.replay.report import page

Row = dict[str, Any]

_SNIFFED_BYTES = 2**20  # of a text file, to tell whether it is a log
_KINDS = (b"FLASER", b"ROBOTLASER", b"RAWLASER", b"ODOM", b"PARAM")
_NOT_IN_ROWS = ("stages", "versions")


@dataclass(frozen=True, slots=True)
class Task:
    """A log to map.

    Attributes:
        name: The log's name.
        file: The log's file.
        thin_m: Distance between two scans of the log if it is thinned; None to use every scan.
        page: The page to write; None for no page.
    """

    name: str
    file: Path
    thin_m: float | None = None
    page: Path | None = None

    @property
    def label(self) -> str:
        """Name for people, with the step of a thinned log."""
        return label(self.name, self.thin_m)


def label(name: str, thin_m: float | None) -> str:
    """Name a log for people.

    Args:
        name: Its name.
        thin_m: Distance between two scans if it is thinned; None if not.

    Returns:
        The name, with the step of a thinned log.
    """
    return name if thin_m is None else f"{name}, {thin_m:g} m"


def find_logs(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """List the logs of a folder.

    Args:
        folder: The folder. Folders within it are not searched.

    Returns:
        The files by name, in the order of their names; and what was left out, one sentence each.

    Raises:
        InputError: If the folder cannot be read, or has no log.
    """
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file())
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None
    logs = [path for path in files if _is_log(path)]
    others = [path.name for path in files if path not in logs]
    if not logs:
        raise InputError(f"{folder}: has no log; a log ends in one of {', '.join(LOG_SUFFIXES)}")
    stems = [_stem(path) for path in logs]
    found = {
        stem if stems.count(stem) == 1 else path.name: path
        for stem, path in zip(stems, logs, strict=True)
    }
    notes = []
    if others:
        notes.append(f"{folder}: not taken for logs: {', '.join(others)}")
    return found, notes


def choose(logs: dict[str, Path], only: Sequence[str]) -> dict[str, Path]:
    """Choose logs by name.

    Args:
        logs: All logs by name.
        only: Names of logs or of their files, or beginnings of names; empty: all.

    Returns:
        The chosen logs, in the order of ``logs``.

    Raises:
        InputError: If a name fits no log.
    """
    chosen: set[str] = set()
    for wanted in only:
        exact = {name for name, path in logs.items() if wanted in (name, path.name)}
        fitting = exact or {name for name in logs if name.startswith(wanted)}
        if not fitting:
            raise InputError(f"--only {wanted}: no such log{did_you_mean(wanted, logs)}")
        chosen |= fitting
    return {name: path for name, path in logs.items() if name in chosen or not only}


def parse_steps(texts: Sequence[str]) -> list[float]:
    """Read the values of ``--thin``.

    Args:
        texts: Numbers as texts.

    Returns:
        The numbers, m.

    Raises:
        InputError: If one is not a number within the limits.
    """
    steps = []
    for text in texts:
        step = float("nan")
        with suppress(ValueError):
            step = float(text)
        if not LEAST_M <= step <= MOST_M or "_" in text:
            raise InputError(f"--thin {text}: must be a number from {LEAST_M:g} to {MOST_M:g} m")
        steps.append(step)
    return steps


def tasks_of(logs: dict[str, Path], steps: Sequence[float], report: Path | None) -> list[Task]:
    """List what is to be mapped: each log as it is, then thinned.

    Args:
        logs: The logs by name.
        steps: Steps of the thinned logs, m.
        report: Directory of the pages; None for no pages.

    Returns:
        The tasks.
    """
    tasks = [Task(name, file, step) for name, file in logs.items() for step in (None, *steps)]
    if report is None:
        return tasks
    ends = ["" if task.thin_m is None else f"-{task.thin_m:g}m" for task in tasks]
    return [
        replace(task, page=report / f"{task.name}{end}.html")
        for task, end in zip(tasks, ends, strict=True)
    ]


def run(tasks: Sequence[Task], workers: int, stop: Callable[[], bool]) -> Iterator[Row]:
    """Map the logs, each in a process.

    Args:
        tasks: The logs.
        workers: Number of processes.
        stop: Called several times a second; after it returns True, only what is finished counts.

    Yields:
        A row for each log, in the order in which they are finished; see `map_log`.
    """
    where = local_workers(workers)
    done = run_all(tasks, map_log, where, when_lost=_lost, stop=stop, finish_started=False)
    with closing(done):
        for _, row in done:
            yield row


def _lost(task: Task) -> Row:
    return _row(task, "its process died twice, perhaps for lack of memory")


def map_log(task: Task) -> Row:
    """Map a log and measure the trajectory.

    Args:
        task: The log.

    Returns:
        ``name``, ``file``, ``thin_m``, ``error``, and if the log could be mapped its ``way_m`` and
        the figures of the replay.
    """
    reset_peak_memory()
    try:
        log, relations = session.load(task.file, None)
        if task.thin_m is not None:
            log = thin(log, task.thin_m)
        replay = session.run(log, relations)
        if task.page is not None:
            page.write(task.page, task.label, replay)
    except InputError as error:
        return _row(task, str(error))
    except Exception as error:  # one log must not cost the others their rows
        return _row(task, f"{type(error).__name__}: {error}")
    figures = {key: value for key, value in replay.figures.items() if key not in _NOT_IN_ROWS}
    return {**_row(task, None), "way_m": _way_m(log), **figures}


def _row(task: Task, error: str | None) -> Row:
    message = None if error is None else printable(error)
    return {"name": task.name, "file": str(task.file), "thin_m": task.thin_m, "error": message}


def _way_m(log: LaserLog) -> float:
    """Return the length of the way by the reference, or by odometry if there is none."""
    poses = log.odom
    if log.reference is not None and np.isfinite(log.reference).all():
        poses = log.reference
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def figures_of(tasks: Sequence[Task], rows: Sequence[Row]) -> dict[str, Any]:
    """Collect the figures of the benchmark.

    Args:
        tasks: All tasks.
        rows: The rows of those that were finished, in any order.

    Returns:
        What ``simloop bench logs --json`` writes: ``logs``, a row for each log in the order of the
        tasks; ``ok``, whether every log was mapped with a result of use; ``interrupted``.
    """
    order = {(task.name, task.thin_m): number for number, task in enumerate(tasks)}
    return {
        "logs": sorted(rows, key=lambda row: order[row["name"], row["thin_m"]]),
        "ok": len(rows) == len(tasks) and not any(failure(row) for row in rows),
        "interrupted": len(rows) < len(tasks),
        "versions": versions(),
        "machine": machine(),
    }


def failure(row: Row) -> str | None:
    """Tell why the result of a log is of no use.

    Args:
        row: The log's row.

    Returns:
        The reason; None if the result is of use.
    """
    if row["error"] is not None:
        return str(row["error"])
    return None if row["worthless"] is None else f"the result is worthless: {row['worthless']}"


def _is_log(path: Path) -> bool:
    """Return whether a file's name is that of a log; texts must also look like one."""
    name = path.name.lower()
    if not name.endswith(LOG_SUFFIXES):
        return False
    if not name.removesuffix(".gz").endswith(".txt"):
        return True
    try:
        with gzip.open(path) if name.endswith(".gz") else open(path, "rb") as file:
            return any(line.startswith(_KINDS) for line in file.read(_SNIFFED_BYTES).splitlines())
    except (OSError, EOFError):
        return True  # it cannot be read, and its row tells why


def _stem(path: Path) -> str:
    """Return a log's file name without its endings."""
    stem = path.name
    ending = next((one for one in LOG_SUFFIXES[::-1] if stem.lower().endswith(one)), "")
    return stem[: len(stem) - len(ending)] or stem
