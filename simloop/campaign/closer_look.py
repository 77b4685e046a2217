"""Repeat failed and slow runs to record them or to draw pictures of them.

A run is the same whether it is recorded or not. A campaign therefore records nothing while it runs,
and later repeats only the runs that need a closer look.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import ERROR, Row
from simloop.common.errors import InputError

_LONGEST_NAME = 120  # a file system allows 255 bytes; a hash and a suffix follow

Done = tuple[RunSpec, Row]
"""A run and its row."""


def failures(runs: Sequence[Done], most: int) -> list[Done]:
    """Choose runs that did not reach the goal.

    Args:
        runs: All runs.
        most: Largest number of runs to choose.

    Returns:
        The first of them. Runs with the outcome ``error`` are left out: they cannot be repeated.
    """
    return [run for run in runs if not run[1]["success"] and run[1]["outcome"] != ERROR][:most]


def worst(runs: Sequence[Done], most: int) -> list[Done]:
    """Choose the worst runs.

    Args:
        runs: All runs.
        most: Largest number of runs to choose.

    Returns:
        The failed runs first, then the successful runs that took longest.
    """
    slow = sorted(
        (run for run in runs if run[1]["success"]), key=lambda run: -(run[1].get("sim_time_s") or 0)
    )
    return [*failures(runs, most), *slow][:most]


def record(
    runs: Sequence[Done], folder: Path, stop: Callable[[], bool] = lambda: False
) -> Iterator[Path]:
    """Repeat runs and record them.

    Args:
        runs: The runs.
        folder: Folder of the recordings; it is created if it does not exist. A recording that
            already exists is kept.

        stop: Called several times a second. Once it returns True, the recording under way is
            dropped, and no other begins.

    Yields:
        The file of each recording.

    Raises:
        InputError: If a recording cannot be written.
    """
    from simloop.loop import Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import watch
    from simloop.scenario.build import build_world

    folder.mkdir(parents=True, exist_ok=True)
    for spec, _ in runs:
        file = folder / f"{file_name(spec)}.rrd"
        if not file.exists():
            scenario = spec.load()
            world = build_world(scenario)
            # In a folder of a random name, so that no half recording is ever taken for a whole one.
            with tempfile.TemporaryDirectory(prefix=".", dir=folder) as place:
                partial = Path(place) / file.name
                with watch(scenario, world, Outputs(recording=partial)) as watched:
                    Simulation(scenario, watched.listeners, world=world).run(lambda *_: not stop())
                if stop():
                    return
                partial.replace(file)
        yield file


def picture(spec: RunSpec, folder: Path, stop: Callable[[], bool] = lambda: False) -> Path | None:
    """Repeat a run and draw its contact sheet: eight moments in one picture.

    Args:
        spec: The run.
        folder: Folder of the pictures.
        stop: Called several times a second. Once it returns True, the run ends without a picture.

    Returns:
        The contact sheet's file, or None if this machine cannot draw it.
    """
    from simloop.loop import Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import watch
    from simloop.scenario.build import build_world

    if stop():
        return None
    scenario = spec.load()
    world = build_world(scenario)
    try:
        with watch(scenario, world, Outputs(snapshots=folder / file_name(spec))) as watched:
            Simulation(scenario, watched.listeners, world=world).run(lambda *_: not stop())
    except (InputError, OSError, RuntimeError):
        return None
    if stop():
        return None
    sheets = sorted((folder / file_name(spec)).glob("*sheet*"))
    return sheets[0] if sheets else None


def file_name(spec: RunSpec) -> str:
    """Name the files of a run.

    Args:
        spec: The run.

    Returns:
        A file name without suffix: scenario, planner, sweep and seed, safe for any file system. A
        hash follows where these do not tell the run from all others: the scenario is a file, keys
        are set, or the name is too long or has signs that a file system may refuse.
    """
    scenario, planner, sweep = spec.cell
    parts = [Path(scenario).stem, planner, sweep, f"seed{spec.seed}"]
    whole = "_".join(part for part in parts if part)
    name = re.sub(r"[^A-Za-z0-9_.=-]+", "-", whole)[:_LONGEST_NAME].lstrip("._-")
    if name == whole and parts[0] == scenario and not spec.overrides:
        return name
    return f"{name}_{hashlib.sha256(spec.key.encode('utf-8', 'replace')).hexdigest()[:10]}"
