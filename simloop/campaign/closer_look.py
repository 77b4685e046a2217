"""Failures and worst runs once more, watched: a recording or pictures of each.

A run is the same whoever watches it, so nothing need be recorded while thousands are made.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import Row
from simloop.common.errors import InputError

Done = tuple[RunSpec, Row]


def failures(runs: Sequence[Done], most: int) -> list[Done]:
    """Those that did not arrive, the first ``most`` of them; errors have nothing to show."""
    return [run for run in runs if not run[1]["success"] and run[1]["outcome"] != "error"][:most]


def worst(runs: Sequence[Done], most: int) -> list[Done]:
    """Failures first, then those that took longest."""
    slow = sorted((run for run in runs if run[1]["success"]), key=lambda run: -run[1]["sim_time_s"])
    return [*failures(runs, most), *slow][:most]


def record(runs: Sequence[Done], folder: Path) -> Iterator[Path]:
    """A recording of each into ``folder``; what is there already is left as it is."""
    from simloop.loop import Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import watch
    from simloop.scenario.build import build_world

    folder.mkdir(parents=True, exist_ok=True)
    for spec, _ in runs:
        file = folder / f"{name_of(spec)}.rrd"
        if not file.exists():
            scenario, partial = spec.load(), file.with_suffix(".partial")
            world = build_world(scenario)
            with watch(scenario, world, Outputs(recording=partial)) as watched:
                Simulation(scenario, watched.listeners, world=world).run()
            partial.replace(file)
        yield file


def picture(spec: RunSpec, folder: Path) -> Path | None:
    """The sheet of eight moments of a run; None where none can be drawn."""
    from simloop.loop import Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import watch
    from simloop.scenario.build import build_world

    scenario = spec.load()
    world = build_world(scenario)
    try:
        with watch(scenario, world, Outputs(snapshots=folder / name_of(spec))) as watched:
            Simulation(scenario, watched.listeners, world=world).run()
    except (InputError, OSError, RuntimeError):
        return None
    sheets = sorted((folder / name_of(spec)).glob("*sheet*"))
    return sheets[0] if sheets else None


def name_of(spec: RunSpec) -> str:
    """A file's name for a run."""
    scenario, planner, sweep = spec.cell
    parts = [Path(scenario).stem, planner, sweep, f"seed{spec.seed}"]
    return re.sub(r"[^A-Za-z0-9_.=-]+", "-", "_".join(part for part in parts if part))
