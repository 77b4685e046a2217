"""A small generator for compiled kernels (SplitMix64: Steele, Lea, Flood 2014).

It is seeded from the numpy Generator that a stage is handed, so that one seed still rules all.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

State = NDArray[np.uint64]


def make_state(rng: np.random.Generator) -> State:
    """(1,) state, drawn from ``rng``."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@njit(cache=True)
def uniform(state: State) -> float:
    """In [0, 1), 53 bits."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def below(state: State, n: int) -> int:
    """An integer in [0, n)."""
    return int(uniform(state) * n)


@njit(cache=True)
def normal(state: State) -> float:
    """Standard normal (Box-Muller, one of the pair)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    return radius * math.cos(2.0 * math.pi * uniform(state))
