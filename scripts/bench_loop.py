"""Measure the speed of the closed loop, as ``simloop bench loop`` does."""

from __future__ import annotations

import sys

from simloop.cli.main import main

if __name__ == "__main__":
    sys.argv[1:] = ["bench", "loop", *sys.argv[1:]]
    main()
