"""Try random short runs of the whole loop, and report those that fail.

    python scripts/fuzz_runs.py [--seed 0] [--first 0] [--count 100] [--most-s 280]

A failure is an exception, a belief or a command that is no number, or a run that takes too long.
Each is printed with the command that repeats it. The exit code is 1 if a run failed.
"""

from __future__ import annotations

import argparse
import faulthandler
import sys
import time
from collections import Counter

from simloop.benchmarks.random_runs import draw_case, run_case
from simloop.cli.edge import run_script


def main() -> int:
    """Try the runs and print the failures.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="seed of the series")
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--count", type=int, default=100, help="number of runs")
    parser.add_argument("--most-s", type=float, default=1e9, help="stop after this time, s")
    parser.add_argument("--patience-s", type=float, default=60.0, help="time for one run, s")
    options = parser.parse_args()
    began, outcomes, failed, simulated_s = time.monotonic(), Counter[str](), 0, 0.0
    number = options.first
    while number < options.first + options.count and time.monotonic() - began < options.most_s:
        case = draw_case(options.seed, number)
        # A kernel that never returns cannot be interrupted: the process ends and shows where it is.
        faulthandler.dump_traceback_later(4.0 * options.patience_s, exit=True)
        print(f"\r{number}", end="", file=sys.stderr, flush=True)
        result = run_case(case, options.patience_s)
        faulthandler.cancel_dump_traceback_later()
        outcomes[result.outcome] += 1
        simulated_s += result.seconds
        if result.failure:
            failed += 1
            print(f"\nrun {number}: {result.failure}\n    {case.command()}", flush=True)
        number += 1
    shares = ", ".join(f"{name} {count}" for name, count in outcomes.most_common())
    print(
        f"\nruns {options.first} to {number - 1} of seed {options.seed}: {failed} failed; "
        f"{simulated_s:.0f} simulated seconds in {time.monotonic() - began:.0f} s; {shares}"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    run_script(main)
