"""One independent stream of random numbers for each random part of a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class RandomStreams(NamedTuple):
    """The random generators of a run. No part's draws depend on another part's.

    The meaning of a seed depends on the order of the fields: a new stream must come last.

    Attributes:
        imu: Noise and biases of the IMU.
        lidar: Noise and drop-outs of the LiDAR.
        planner: The robot's planner.
        faults: Beams that a fault removes.
        movers: Motion of the moving obstacles.
        goal: Motion of a moving goal, and the noise of its readings.
        camera: Noise and drop-outs of the depth camera.
    """

    imu: np.random.Generator
    lidar: np.random.Generator
    planner: np.random.Generator
    faults: np.random.Generator
    movers: np.random.Generator
    goal: np.random.Generator
    camera: np.random.Generator

    @classmethod
    def from_seed(cls, seed: int) -> RandomStreams:
        """Spawn all streams of a run.

        Args:
            seed: The scenario's seed.

        Returns:
            Independent generators, the same for the same seed.
        """
        return cls(*np.random.default_rng(seed).spawn(len(cls._fields)))
