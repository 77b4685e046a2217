"""Define the result of a replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Result of the replayed part of a log.

    Attributes:
        log: the log.
        trajectory: (n, 3) base_link in map at each replayed scan, m, m, rad; NaN where lost.
        keyframes: indices of the scans that became keyframes.
        keyframe_points: hits (k, 2) of each keyframe, in its base_link, m.
        closures: for each loop closure the positions (2, 2) of its two keyframes in map, m.
        map: the map that was made or given.
        figures: the reported figures, as in the JSON.
    """

    log: LaserLog
    trajectory: FloatArray
    keyframes: Sequence[int]
    keyframe_points: Sequence[FloatArray]
    closures: Sequence[FloatArray]
    map: GridMap
    figures: dict[str, Any]
