"""Run and record the paper's experiment, as ``simloop run experiment --out runs/demo``."""

from __future__ import annotations

import sys

from simloop.cli.main import main

if __name__ == "__main__":
    sys.argv[1:] = ["run", "experiment", "--out", "runs/demo", *sys.argv[1:]]
    main()
