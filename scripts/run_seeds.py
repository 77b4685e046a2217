"""Run many seeds of one scenario and summarise success, time, clearance and accuracy.

    python scripts/run_seeds.py experiment --seeds 0:50 --workers 2 --json seeds.json

The exit code is 0 if every run reached its goal without a contact, 1 if not, 2 for a wrong input.
"""

from __future__ import annotations

import json
import math
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from simloop.campaign.spec import Request
from simloop.campaign.sweeps import parse_seeds
from simloop.campaign.work import check_worlds
from simloop.cli.apart import check_apart
from simloop.cli.common import INTERRUPTED, NumberOfWorkers, check_json
from simloop.cli.main import run_command
from simloop.cli.stopping import leaving_at_once, stopping
from simloop.cli.world import print_notes
from simloop.common import pool
from simloop.common.errors import InputError
from simloop.common.files import write_text
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.scenario.inputs import input_files
from simloop.scenario.load import load, resolve

_BOUNDS = {"sim_time_s": "s", "path_ratio": "x shortest", "ate_rmse_m": "m", "yaw_deg": "deg",
           "min_clearance_m": "m", "plan_ms_p99": "ms", "nees_mean": "", "spl": ""}  # fmt: skip


def run_one(job: tuple[str, list[str], int]) -> dict[str, Any]:
    """Run one seed.

    Args:
        job: Scenario, overrides and seed.

    Returns:
        The metrics of the run, with ``path_ratio`` and ``yaw_deg`` added. For a seed that cannot
        be run, ``outcome`` is the error.
    """
    name, overrides, seed = job
    try:
        figures = Simulation(load(name, overrides, seed=seed)).run().metrics
    except InputError as error:
        return {"seed": seed, "outcome": str(error), "contact_count": 0}
    shortest, yaw = figures["shortest_path_m"], figures["yaw_rmse_rad"]
    figures["path_ratio"] = figures["path_length_m"] / shortest if shortest else None
    figures["yaw_deg"] = None if yaw is None else math.degrees(yaw)
    return figures


def summarise(runs: list[dict[str, Any]]) -> str:
    """Summarise many runs as text.

    Args:
        runs: The metrics of each run.

    Returns:
        Counts and failed seeds; then mean, least and greatest values of the runs that arrived.
    """
    reached = [run for run in runs if run["outcome"] == Outcome.REACHED]
    contacts = sum(run["contact_count"] for run in runs)
    lines = [f"{len(reached)}/{len(runs)} reached, {contacts} contacts"]
    lines += [f"  seed {run['seed']}: {run['outcome']}" for run in runs if run not in reached]
    for key, unit in _BOUNDS.items():
        values = [run[key] for run in reached if run.get(key) is not None]
        if values:
            mean, low, high = np.mean(values), min(values), max(values)
            worst = max(reached, key=lambda run: run.get(key) or -math.inf)["seed"]
            lines.append(
                f"  {key:16} mean {mean:8.4f}  least {low:8.4f}  "
                f"greatest {high:8.4f} {unit} (seed {worst})"
            )
    return "\n".join(lines)


def main(
    scenario: Annotated[str, typer.Argument(help="A scenario's name, or a TOML file.")],
    seeds: Annotated[str, typer.Option(metavar="A:B", help="From A to B - 1.")] = "0:50",
    workers: NumberOfWorkers = 1,
    overrides: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> int:
    """Run many seeds of one scenario.
    \f

    Args:
        scenario: The scenario.
        seeds: The range of the seeds.
        workers: Number of processes; 0: the number of cores.
        overrides: Settings as ``key=value``.
        json_file: File for the metrics of each run; None: no file.

    Returns:
        The exit code.

    Raises:
        InputError: The scenario, a setting or the seeds are wrong, or the file cannot be written.
    """
    with leaving_at_once():
        request = Request((scenario,), parse_seeds(seeds), (), tuple(overrides or ()))
        request.check()
        check_json(json_file)
        (cell,) = request.cells()
        check_apart({"--json": json_file}, input_files(cell.load(), resolve(scenario)))
        print_notes(Console(stderr=True), check_worlds([cell], request.seeds))
        jobs = [(scenario, list(request.overrides), seed) for seed in range(*request.seeds)]
        where = pool.local_workers(pool.processes(workers))
        note = "stopping: the runs under way are finished; once more to end at once"
        with stopping(note) as stop:
            done = pool.run_all(jobs, run_one, where, when_lost=_lost, stop=stop)
            with closing(done):
                runs = [run for _, run in done]
            stopped = stop()
    runs.sort(key=lambda run: run["seed"])
    print(summarise(runs))
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        write_text(json_file, json.dumps(runs, indent=1) + "\n")
    if stopped:
        return INTERRUPTED
    good = all(run["outcome"] == Outcome.REACHED and not run["contact_count"] for run in runs)
    return 0 if good else 1


def _lost(job: tuple[str, list[str], int]) -> dict[str, Any]:
    return {"seed": job[2], "outcome": "its worker process died twice", "contact_count": 0}


if __name__ == "__main__":
    run_command(main)
