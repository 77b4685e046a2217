"""What a replay found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A log's scans, as far as they were replayed.

    trajectory: (n, 3) base_link in map, NaN where lost. keyframes: the scans whose hits (k, 2) are
    in keyframe_points. closures: (2, 2) ends of each.
    """

    log: LaserLog
    trajectory: FloatArray
    keyframes: Sequence[int]
    keyframe_points: Sequence[FloatArray]
    closures: Sequence[FloatArray]
    map: GridMap
    figures: dict[str, Any]
