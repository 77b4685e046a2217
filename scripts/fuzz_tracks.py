"""Drop random vehicles on random ground, drive them randomly, and report the failures.

    python scripts/fuzz_tracks.py [--steps 1000000] [--seed 0]

The exit code is 1 if an episode failed. The printed seed reproduces the failure.
"""

from __future__ import annotations

import argparse

from simloop.certify.fuzz import episodes
from simloop.cli.edge import run_script


def main() -> int:
    """Run the episodes and print the failures.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    steps = failed = count = 0
    for episode in episodes(options.seed, options.steps):
        steps, count = steps + episode.steps, count + 1
        if episode.failure:
            failed += 1
            print(f"seed {episode.seed}: {episode.failure}", flush=True)
    print(f"{steps:,} steps in {count} episodes from seed {options.seed}: {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    run_script(main)
