"""SplitMix64: a small random generator for compiled kernels (Steele, Lea, Flood 2014).

It is seeded from the numpy Generator of the caller, so one seed determines all random numbers.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

State = NDArray[np.uint64]


def make_state(rng: np.random.Generator) -> State:
    """Draw the state of a new generator.

    Args:
        rng: Generator that the seed is drawn from.

    Returns:
        (1,) uint64 state; the kernels advance it in place.
    """
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@njit(cache=True)
def uniform(state: State) -> float:
    """Draw a number in [0, 1) with 53 random bits.

    Args:
        state: (1,) the generator's state; advanced.

    Returns:
        The number drawn.
    """
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def below(state: State, n: int) -> int:
    """Draw an integer in [0, n).

    Args:
        state: (1,) the generator's state; advanced.
        n: Upper limit, exclusive.

    Returns:
        The integer drawn.
    """
    return int(uniform(state) * n)


@njit(cache=True)
def normal(state: State) -> float:
    """Draw from the standard normal distribution (Box-Muller; the second of the pair is dropped).

    Args:
        state: (1,) the generator's state; advanced twice.

    Returns:
        The number drawn.
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    return radius * math.cos(2.0 * math.pi * uniform(state))
