"""Repeat failed and slow runs to record them or to draw pictures of them.

A run is the same whether it is recorded or not. A campaign therefore records nothing while it runs,
and later repeats only the runs that need a closer look.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import ERROR, Row
from simloop.common.errors import InputError

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
    slow = sorted((run for run in runs if run[1]["success"]), key=lambda run: -run[1]["sim_time_s"])
    return [*failures(runs, most), *slow][:most]


def record(runs: Sequence[Done], folder: Path) -> Iterator[Path]:
    """Repeat runs and record them.

    Args:
        runs: The runs.
        folder: Folder of the recordings; it is created if it does not exist. A recording that
            already exists is kept.

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
            scenario, partial = spec.load(), file.with_suffix(".partial")
            world = build_world(scenario)
            with watch(scenario, world, Outputs(recording=partial)) as watched:
                Simulation(scenario, watched.listeners, world=world).run()
            partial.replace(file)
        yield file


def picture(spec: RunSpec, folder: Path) -> Path | None:
    """Repeat a run and draw its contact sheet: eight moments in one picture.

    Args:
        spec: The run.
        folder: Folder of the pictures.

    Returns:
        The contact sheet's file, or None if this machine cannot draw it.
    """
    from simloop.loop import Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import watch
    from simloop.scenario.build import build_world

    scenario = spec.load()
    world = build_world(scenario)
    try:
        with watch(scenario, world, Outputs(snapshots=folder / file_name(spec))) as watched:
            Simulation(scenario, watched.listeners, world=world).run()
    except (InputError, OSError, RuntimeError):
        return None
    sheets = sorted((folder / file_name(spec)).glob("*sheet*"))
    return sheets[0] if sheets else None


def file_name(spec: RunSpec) -> str:
    """Name the files of a run.

    Args:
        spec: The run.

    Returns:
        A file name without suffix: scenario, planner, sweep and seed, safe for any file system.
    """
    scenario, planner, sweep = spec.cell
    parts = [Path(scenario).stem, planner, sweep, f"seed{spec.seed}"]
    return re.sub(r"[^A-Za-z0-9_.=-]+", "-", "_".join(part for part in parts if part))
