"""Run many seeds of one scenario and summarise success, time, clearance and accuracy.

    python scripts/run_seeds.py experiment --seeds 0:50 --workers 2 --json seeds.json

The exit code is 0 if every run reached its goal without a contact, 1 if not, 2 for a wrong input.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.scenario.load import load

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


def main() -> int:
    """Run the command.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario")
    parser.add_argument("--seeds", default="0:50", help="A:B, from A to B - 1")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    first, _, last = options.seeds.partition(":")
    try:
        seeds = range(int(first), int(last))
        load(options.scenario, options.overrides)
    except (InputError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    jobs = [(options.scenario, options.overrides, seed) for seed in seeds]
    if options.workers > 1:
        with ProcessPoolExecutor(options.workers) as pool:
            runs = list(pool.map(run_one, jobs))
    else:
        runs = [run_one(job) for job in jobs]
    print(summarise(runs))
    if options.json:
        options.json.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")
    good = all(run["outcome"] == Outcome.REACHED and not run["contact_count"] for run in runs)
    return 0 if good and runs else 1


if __name__ == "__main__":
    sys.exit(main())
