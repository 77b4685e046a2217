"""Turn messages into what a recording plots: columns of values, outlines and grey maps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simloop.messages import Estimate, FloatArray, Health, Plan, PoseFix, SmoothPath, TrackCommand
from simloop.truth import TrackTruth, Truth

_HEALTH = {"ok": 0.0, "degraded": 1.0, "lost": 2.0}
_CHI2_95_2DOF = 5.991
_ROUND = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 33)) for f in (np.cos, np.sin)], axis=1)

Column = Callable[[list[Any]], FloatArray]
Series = tuple[type, tuple[str, ...], Column]
"""A kind of message, the names of a plot's lines, and the function that reads their values."""


def _column(read: Callable[[Any], Any]) -> Column:
    return lambda messages: np.array([read(m) for m in messages], dtype=np.float64)


_SERIES: dict[str, Series] = {
    "speed/true": (Truth, ("true",), _column(lambda m: m.velocity_body[0])),
    "speed/believed": (Estimate, ("believed",), _column(lambda m: m.state[3])),
    "speed/asked": (TrackCommand, ("asked",), _column(lambda m: m.speed_mps)),
    "yaw_rate/true": (Truth, ("true",), _column(lambda m: m.velocity_body[5])),
    "yaw_rate/believed": (Estimate, ("believed",), _column(lambda m: m.state[4])),
    "yaw_rate/asked": (TrackCommand, ("asked",), _column(lambda m: m.yaw_rate_radps)),
    "current": (Truth, ("left", "right"), _column(lambda m: m.motor_current_a)),
    "voltage": (Truth, ("left", "right"), _column(lambda m: m.motor_voltage_v)),
    "energy": (Truth, ("drawn",), _column(lambda m: m.energy_j)),
    "tracks/slip": (TrackTruth, ("left", "right"), _column(lambda m: m.slip_mps)),
    "tracks/icr": (TrackTruth, ("y left", "y right", "x"), _column(lambda m: m.icr_m)),
    "tracks/shear_work": (TrackTruth, ("taken",), _column(lambda m: m.shear_work_j)),
    "contacts": (
        Truth,
        ("contacts", "hits while standing"),
        _column(lambda m: (m.contact_count, m.hit_count)),
    ),
    "filter": (Estimate, ("gyro bias", "gauge ratio"), _column(lambda m: m.state[5:7])),
    "filter/icr": (Estimate, ("y offset", "x"), _column(lambda m: m.state[7:9])),
    "health": (Health, ("0 ok, 1 degraded, 2 lost",), _column(lambda m: _HEALTH[m.state])),
    "match": (PoseFix, ("score", "taken"), _column(lambda m: (m.score, m.ok))),
    "clearance": (SmoothPath, ("least",), _column(lambda m: np.min(m.clearance_m, initial=np.inf))),
    "plan_cost": (
        Plan,
        ("cost of the path", "length, m", "turning, rad"),
        # Without the turn at the start, which the exact optimum beside it does not know either.
        _column(lambda m: (m.path_cost, m.length_m, m.turning_rad)),
    ),
    "plan_effort": (
        Plan,
        ("evaluations", "generations"),
        _column(lambda m: (m.evaluations, m.generations)),
    ),
}
DERIVED = {
    "track/true": ("left, true", "right, true"),
    "track/asked": ("left, asked", "right, asked"),
    "error_position": ("error",),
    "error_yaw": ("error",),
    "nees": ("pose",),
    "plan_cost_exact": ("exact, among discs",),
    "plan_gap_percent": ("gap",),
}
"""Values computed from several messages: entity -> names of its lines."""


def plotted_series(road_wheels: int) -> dict[str, Series]:
    """List the plots whose values come from one message each.

    Args:
        road_wheels: Number of road wheels of each track.

    Returns:
        Entity below ``plots/`` -> its series.
    """
    names = tuple(f"{side} {i}" for side in ("left", "right") for i in range(road_wheels))
    load = (TrackTruth, names, _column(lambda m: m.wheel_load_n))
    return {**_SERIES, "tracks/wheel_load": load}


def lifted(points: FloatArray, height: float) -> FloatArray:
    """Place points at a height.

    Args:
        points: (N, 2) points, m.
        height: Their height, m.

    Returns:
        (N, 3) points, m.
    """
    return np.column_stack([points, np.full(len(points), height)])


def nees(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Compute the normalised estimation error squared, e^T P^-1 e.

    Args:
        error: (N, n) errors.
        covariance: (N, n, n) covariances.

    Returns:
        (N,) NEES; its mean is n for a consistent filter (Bar-Shalom et al. 2001, Sec. 5.4).
    """
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.sum(error * solved, axis=1)


def circles(discs_xyr_m: FloatArray) -> list[FloatArray]:
    """Compute the outlines of discs.

    Args:
        discs_xyr_m: (K, 3) centres and radii, m.

    Returns:
        K closed outlines (33, 2), m.
    """
    return [disc[:2] + disc[2] * _ROUND for disc in discs_xyr_m]


def mover_strips(
    position_m: FloatArray, velocity_mps: FloatArray, radius_m: FloatArray
) -> list[FloatArray]:
    """Compute strips for moving obstacles: discs, and lines to their predicted places in 1 s.

    Args:
        position_m: (K, 2) centres, m.
        velocity_mps: (K, 2) velocities, m/s.
        radius_m: (K,) radii, m.

    Returns:
        2 K strips (n, 2): the outlines, then the lines.
    """
    ways = np.stack([position_m, position_m + velocity_mps], axis=1)
    return [*circles(np.column_stack([position_m, radius_m])), *ways]


def ellipses(centres: FloatArray, covariance: FloatArray, scale: float) -> FloatArray:
    """Compute the 95 % ellipses of two-dimensional normal distributions.

    Args:
        centres: (N, 2) means, m.
        covariance: (N, 2, 2) covariances, m^2.
        scale: Factor by which the ellipses are enlarged.

    Returns:
        (N, 33, 2) closed outlines, m.
    """
    # The half axes are the square roots of the eigenvalues, times the 95 % quantile.
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors * (scale * np.sqrt(_CHI2_95_2DOF * np.maximum(values, 0.0)))[:, None, :]
    return centres[:, None, :] + np.einsum("nij,kj->nki", axes, _ROUND)


def occupancy_percent(log_odds: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert log odds to the occupancy values of ROS.

    Args:
        log_odds: (rows, cols) log odds; 0 is unknown.

    Returns:
        The same shape: 0 free to 100 occupied, 255 unknown.
    """
    percent = np.round(100.0 / (1.0 + np.exp(-log_odds))).astype(np.uint8)
    percent[log_odds == 0.0] = 255
    return percent
