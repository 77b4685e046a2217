"""The exact optimum of J among discs, for comparison with the other planners.

J is w1 length + w2 turning (Sabiha 2022, online TLBO, Eq. 12). The best path of a point among discs
that are grown by the safe distance consists of straight segments, each tangent to two circles (or
through an end), and of arcs about the circles (tangent graph, Liu & Arimoto 1992). A directed
tangent fixes the sense of rotation in which it leaves one circle and reaches the next. Dijkstra's
algorithm therefore runs over directed tangents; the arc of radius R and angle phi between two of
them costs w1 R phi + w2 phi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.reference.tangents import (
    AX,
    AY,
    BX,
    BY,
    HEADING,
    TAIL,
    TAIL_SENSE,
    best_chain,
    free_tangents,
    sweep_between,
)


@dataclass(frozen=True, slots=True, eq=False)
class ExactPath:
    """The best path. Cost, length and turning are those of the true arcs, not of their samples.

    Attributes:
        points_m: (N, 2) points, arcs sampled, m, map frame.
        cost: J = length_weight x length_m + turning_weight x turning_rad.
        length_m: Length, m.
        turning_rad: Summed turning, rad.
    """

    points_m: FloatArray
    cost: float
    length_m: float
    turning_rad: float


def exact_path(
    discs: FloatArray,
    bounds: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    *,
    safe_m: float,
    length_weight: float = 0.65,
    turning_weight: float = 0.35,
    arc_step_rad: float = 0.02,
) -> ExactPath | None:
    """Find the path of least J among discs.

    Args:
        discs: (K, 3) x, y, radius, m, map frame.
        bounds: (4,) x_min, y_min, x_max, y_max of the whole path, m, map frame.
        start: (>= 2,) x, y, m, map frame.
        goal: (>= 2,) x, y, m, map frame.
        safe_m: Distance that the path keeps from every disc, m.
        length_weight: w1, cost of a metre.
        turning_weight: w2, cost of a radian.
        arc_step_rad: Angle between the samples of an arc, rad.

    Returns:
        The best path; None if start and goal are not connected.
    """
    discs = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    centre = np.vstack([start[:2], goal[:2], discs[:, :2]])
    radius = np.concatenate([[0.0, 0.0], discs[:, 2] + safe_m])
    within = np.array(bounds, dtype=np.float64)
    ends, lines = free_tangents(centre, radius, within)
    chain, cost = best_chain(
        ends, lines, centre, radius, within, float(length_weight), float(turning_weight)
    )
    if not len(chain):
        return None
    return _unroll(ends[chain], lines[chain], cost, centre, radius, arc_step_rad)


def _unroll(
    ends: NDArray[np.int64],
    lines: FloatArray,
    cost: float,
    centre: FloatArray,
    radius: FloatArray,
    arc_step: float,
) -> ExactPath:
    """Join a chain of tangents by arcs, and sample the arcs."""
    points = [lines[:1, AX : AY + 1]]
    length, turning = 0.0, 0.0
    for n, line in enumerate(lines):
        if n > 0:
            k, sense = int(ends[n, TAIL]), int(ends[n, TAIL_SENSE])
            sweep = sweep_between(lines[n - 1, HEADING], line[HEADING], sense)
            first = lines[n - 1, HEADING] - 0.5 * sense * math.pi
            angles = first + sense * np.linspace(0.0, sweep, 2 + int(sweep / arc_step))[1:-1]
            points.append(centre[k] + radius[k] * np.column_stack([np.cos(angles), np.sin(angles)]))
            length += radius[k] * sweep
            turning += sweep
            points.append(line[None, AX : AY + 1])
        length += math.hypot(line[BX] - line[AX], line[BY] - line[AY])
        points.append(line[None, BX:])
    return ExactPath(np.concatenate(points), float(cost), float(length), float(turning))
