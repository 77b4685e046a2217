"""One independent stream of random numbers for each part of a run that draws any."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class RandomStreams(NamedTuple):
    """The random generators of a run, so that no part's draws depend on another part's.

    The order of the fields is part of what a seed means: a new stream goes to the end.

    Attributes:
        imu: Noise and biases of the IMU.
        lidar: Noise and drop-outs of the LiDAR.
        planner: The robot's planner.
        faults: Which beams a fault removes.
        movers: How moving obstacles walk.
        goal: How a moving goal walks, and the noise of its readings.
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
