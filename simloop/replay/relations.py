"""Relative relations as ground truth (Kuemmerle et al. 2009, "On measuring the accuracy of SLAM").

A relation says where the robot stood at t2 as seen from where it stood at t1. An error is the
motion from the true place to the estimated one, in the frame of the true one; its translation's
length and its rotation's size are averaged over all relations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.geometry.se2 import wrap_angles
from simloop.messages import FloatArray
from simloop.replay.laser_log import LaserLog

MOST_GAP_S = 1.0
"""Poses are interpolated between scans that lie no further apart: no one knows what was between."""


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Means over ``count`` relations; ``left_out``: those in a gap of the log or outside it."""

    translation_mean_m: float
    translation_std_m: float
    rotation_mean_deg: float
    count: int
    left_out: int

    def figures(self) -> dict[str, float | int]:
        """As they stand in the JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


def read_relations(path: Path) -> FloatArray:
    """(m, 5) t1, t2, dx, dy, dyaw of lines 't1 t2 x y z roll pitch yaw' or 't1 t2 dx dy dyaw'."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise InputError(f"--relations {path}: {reason}") from None
    rows = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) not in (5, 8) or not all(map(math.isfinite, row)):
            raise InputError(
                f"--relations {path}, line {number}: wants t1 t2 x y z roll pitch yaw, "
                "or t1 t2 dx dy dyaw"
            )
        rows.append([*row[:4], row[-1]])
    if not rows:
        raise InputError(f"--relations {path}: holds no relation")
    return np.array(rows)


def on_the_relations_clock(log: LaserLog, relations: FloatArray) -> FloatArray:
    """(n,) the scans' times on that of the log's clocks in which most of the relations lie."""

    def held(clock: FloatArray) -> int:
        times = relations[:, :2]
        return int(np.count_nonzero((times >= clock.min()) & (times <= clock.max())))

    rising = [clock for clock in (log.t_s, *log.clocks_s) if np.all(np.diff(clock) > 0.0)]
    return max(rising, key=held)


def poses_at(t_s: FloatArray, poses: FloatArray, when_s: FloatArray) -> FloatArray:
    """(m, 3) poses at ``when_s`` (m,) between those (n, 3) at ``t_s`` (n,); NaN in gaps, outside.

    Straight in x and y, the short way in yaw; exactly at a scan it is that scan's, gap or not.
    """
    after = np.clip(np.searchsorted(t_s, when_s, side="left"), 0, len(t_s) - 1)
    exact = t_s[after] == when_s
    before = np.where(exact, after, after - 1)
    inside = exact | ((when_s > t_s[0]) & (when_s < t_s[-1]))
    before = np.maximum(before, 0)
    span = t_s[after] - t_s[before]
    known = inside & (span <= MOST_GAP_S)
    share = np.where(span > 0.0, (when_s - t_s[before]) / np.where(span > 0.0, span, 1.0), 0.0)
    step = poses[after] - poses[before]
    step[:, 2] = wrap_angles(step[:, 2])
    out = poses[before] + share[:, None] * step
    out[:, 2] = wrap_angles(out[:, 2])
    out[~known] = np.nan
    return out


def relation_errors(t_s: FloatArray, poses: FloatArray, relations: FloatArray) -> RelationErrors:
    """The errors of a trajectory, poses (n, 3) of base_link at ``t_s`` (n,)."""
    first, second = (poses_at(t_s, poses, relations[:, k]) for k in (0, 1))
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = (second - first)[:, :2].T
    off = np.hypot(cos * dx + sin * dy - relations[:, 2], cos * dy - sin * dx - relations[:, 3])
    known = np.isfinite(off)
    count = int(np.count_nonzero(known))
    if count == 0:
        raise InputError("no relation lies within the log's times: another log's, or its clock's?")
    turned = wrap_angles(second[known, 2] - first[known, 2] - relations[known, 4])
    return RelationErrors(
        float(off[known].mean()),
        float(off[known].std()),
        math.degrees(float(np.abs(turned).mean())),
        count,
        len(relations) - count,
    )


def rows_to_text(relations: Sequence[Sequence[float]]) -> str:
    """Relations as lines that ``read_relations`` takes."""
    return "".join(" ".join(f"{number:.9g}" for number in row) + "\n" for row in relations)
