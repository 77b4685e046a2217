"""Standard test functions for the update rules: minimum 0 at 0, Rosenbrock's at (1, 1, ...)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray

NAMES = ("sphere", "rosenbrock", "rastrigin", "ackley")


@njit(cache=True)
def _costs(kind: int, x: FloatArray, out: FloatArray) -> None:
    """Values (n,) of one of `NAMES`, by its index, at points (n, d)."""
    n, d = x.shape
    for k in range(n):
        total, cosines = 0.0, 0.0
        for j in range(d):
            v = x[k, j]
            if kind == 1:
                if j < d - 1:
                    total += 100.0 * (x[k, j + 1] - v * v) ** 2 + (1.0 - v) ** 2
            elif kind == 2:
                total += v * v - 10.0 * math.cos(2.0 * math.pi * v) + 10.0
            else:
                total += v * v
                cosines += math.cos(2.0 * math.pi * v)
        if kind == 3:
            total = 20.0 + math.e - 20.0 * math.exp(-0.2 * math.sqrt(total / d))
            total -= math.exp(cosines / d)
        out[k] = total


class StandardFunction:
    """An `Objective`: one of the functions in `NAMES`.

    The box is [-reach, 1.5 reach] in each dimension, so that the minimum at 0 is not its centre.
    """

    def __init__(self, name: str, dimensions: int, reach: float = 4.0) -> None:
        self._kind = NAMES.index(name)
        self.low = np.full(dimensions, -reach)
        self.high = np.full(dimensions, 1.5 * reach)

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """Evaluate points.

        Args:
            x: (n, d) points.
            out: (n,) takes the values.
            bounds: (n,) not used: every value is computed in full.
        """
        _costs(self._kind, x, out)
