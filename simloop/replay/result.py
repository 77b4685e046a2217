"""The result of a replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """What came out of a log, as far as it was replayed.

    Attributes:
        log: the log.
        trajectory: (n, 3) base_link in map at each scan that was replayed; NaN where lost.
        keyframes: indices of the scans that became keyframes.
        keyframe_points: hits (k, 2) of each keyframe, in its base_link, m.
        closures: for each loop closure the positions (2, 2) of its two keyframes in map, m.
        map: the map, made or given.
        figures: what is reported, as in the JSON.
    """

    log: LaserLog
    trajectory: FloatArray
    keyframes: Sequence[int]
    keyframe_points: Sequence[FloatArray]
    closures: Sequence[FloatArray]
    map: GridMap
    figures: dict[str, Any]
