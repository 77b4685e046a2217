"""Compile the mapper's kernels on a small synthetic log, so that no timing includes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simloop.common.compile_listener import Report, listening, silent
from simloop.graph_slam.mapper import GraphMapper
from simloop.graph_slam.settings import MappingConfig


def warm_up(report: Report = silent) -> int:
    """Map a square room for a few scans, and discard the map.

    Args:
        report: called for each kernel that is compiled.

    Returns:
        Number of kernels that were compiled.
    """
    config = replace(MappingConfig(), submap_m=0.7, cluster_keyframes=2, closure_m=0.1)
    side = np.linspace(-2.0, 2.0, 60)
    end = np.full_like(side, 2.0)
    walls = np.concatenate(
        [np.stack(pair, axis=1) for pair in ((side, end), (side, -end), (end, side), (-end, side))]
    )
    with listening(report) as listener:
        mapper = GraphMapper(config)
        for step in range(10):
            pose = np.array([0.35 * (step % 2), 0.0, 0.0])
            points = walls - pose[:2]
            mapper.step(points, np.zeros_like(points), pose)
        mapper.finish()
        mapper.map()
    return listener.count
