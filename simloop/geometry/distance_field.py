"""Compiled look-ups in a distance field, shared by whoever asks how close a place is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray, WorldView

FREE_M = 1e3  # what lies outside the field is taken to be free


class Field(NamedTuple):
    """A distance field as kernels take it: distance (rows, cols) of the cells' centres, m."""

    distance: NDArray[np.float32]
    x0: float
    y0: float
    resolution: float


def field_of(view: WorldView) -> Field:
    """The view's field; x0, y0 is the centre of cell (0, 0)."""
    half = 0.5 * view.resolution_m
    x0, y0 = view.origin_m.tolist()
    return Field(view.distance_m, x0 + half, y0 + half, view.resolution_m)


@njit(cache=True)
def distance_at(field: Field, x: float, y: float) -> float:
    """Bilinear distance, m, to the nearest obstacle at (x, y); ``FREE_M`` outside the field."""
    u, v = (x - field.x0) / field.resolution, (y - field.y0) / field.resolution
    j, i = math.floor(u), math.floor(v)
    if i < 0 or j < 0 or i + 1 >= field.distance.shape[0] or j + 1 >= field.distance.shape[1]:
        return FREE_M
    a, b = u - j, v - i
    low = (1.0 - a) * field.distance[i, j] + a * field.distance[i, j + 1]
    high = (1.0 - a) * field.distance[i + 1, j] + a * field.distance[i + 1, j + 1]
    return (1.0 - b) * low + b * high


@njit(cache=True)
def footprint_clearance(field: Field, x: float, y: float, yaw: float, offsets: FloatArray) -> float:
    """Least distance, m, over the footprint's disc centres (n,) m along the heading of a pose."""
    least = FREE_M
    cos, sin = math.cos(yaw), math.sin(yaw)
    for k in range(offsets.shape[0]):
        least = min(least, distance_at(field, x + offsets[k] * cos, y + offsets[k] * sin))
    return least
