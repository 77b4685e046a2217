"""Define the result of a replay, and put into words how good its trajectory is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simloop.evaluation.trajectories import in_both
from simloop.mapping.grid_map import GridMap
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog

MEASURES = {
    "relations": "relations",
    "odometry_only": "relations, odometry alone",
    "reference": "reference",
    "odometry_only_reference": "reference, odometry alone",
}
"""Keys of the figures that measure a trajectory, with their names for people."""

_LEFT_OUT = {
    "in_gaps": "in gaps",
    "outside": "outside the log's times",
    "lost": "where the robot is lost",
}


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
        relations: (m, 5) relations that measured the trajectory; None if there were none.
        unfitted: indices of the scans that fitted nowhere, or at which the robot was lost.
        scan_ms: (n,) time that each scan took, ms.
        range_max_m: longer ranges were ignored.
    """

    log: LaserLog
    trajectory: FloatArray
    keyframes: Sequence[int]
    keyframe_points: Sequence[FloatArray]
    closures: Sequence[FloatArray]
    map: GridMap
    figures: dict[str, Any]
    relations: FloatArray | None
    unfitted: Sequence[int]
    scan_ms: FloatArray
    range_max_m: float

    def compared(self) -> tuple[FloatArray, NDArray[np.bool_]] | None:
        """Find what of the trajectory can be compared with the log's reference.

        Returns:
            (n, 3) the reference at each replayed scan, and (n,) at which of them both have a pose;
            None if there are fewer than two.
        """
        if self.log.reference is None:
            return None
        reference = self.log.reference[: len(self.trajectory)]
        both = in_both(reference, self.trajectory)
        return (reference, both) if np.count_nonzero(both) > 1 else None


def measure_lines(figures: dict[str, Any]) -> list[str]:
    """Describe how good a trajectory is, by all that measured it.

    Args:
        figures: as in ``Replay.figures``.

    Returns:
        One line for each of ``MEASURES`` that is there, e.g. ``relations: mean 0.037 m over 1678
        of 1685 (7 in gaps)``.
    """
    lines = []
    for key, name in MEASURES.items():
        measured = figures.get(key)
        if measured is not None:
            words = relations_words if "left_out" in measured else _reference_words
            lines.append(f"{name}: {words(measured)}")
    return lines


def relations_words(figures: dict[str, Any]) -> str:
    """Describe the error by relations, and how many relations were left out.

    Args:
        figures: as from ``RelationErrors.figures``.

    Returns:
        E.g. ``mean 0.037 m over 1678 of 1685 (7 in gaps)``.
    """
    count, total = figures["count"], figures["count"] + figures["left_out"]
    left_out = [f"{figures[key]} {words}" for key, words in _LEFT_OUT.items() if figures[key]]
    said = f" ({', '.join(left_out)})" if left_out else ""
    if not count:
        return f"none of {total} can be used{said}"
    return f"mean {figures['translation_mean_m']:.3f} m over {count} of {total}{said}"


def _reference_words(figures: dict[str, Any]) -> str:
    """Describe the error against a reference."""
    said = f"ATE {figures['ate_rmse_m']:.3f} m (max {figures['ate_max_m']:.2f} m)"
    for length in (5, 20):
        median = figures[f"rpe_{length}m_median_m"]
        if median is not None:
            said += f", RPE over {length} m {median:.3f} m"
    return f"{said}, {figures['poses']} poses"
